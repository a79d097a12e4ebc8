// SPDX-License-Identifier: Apache-2.0
// What each way to encode keeps of the model and of the captured images, and where bytes and
// Gaussians are.
#include <array>

#include "bench/accuracy/sections.h"
#include "io/image/video.h"
#include "l4d/experimental/inspect.h"

namespace l4d::bench {
namespace {

// Images as the cameras saw them, by view of the judge. 8 bits, as they come.
class Captured {
 public:
  Captured(const BenchScene& scene, const Judge& judge) {
    images_.resize(judge.num_views());
    sizes_.resize(judge.num_views());
    const size_t num_cameras = scene.cameras.size();
    for (size_t c = 0; c < num_cameras; ++c) {
      const io::Camera& camera = scene.set.cameras[c];
      io::VideoReader video(camera.video, camera.camera.width, camera.camera.height);
      io::Image image;
      for (size_t i = c; i < images_.size(); i += num_cameras) {
        video.read(judge.frame(i), &image);
        images_[i].resize(image.rgb.size());
        io::to_bytes(image.rgb.data(), image.rgb.size(), images_[i].data());
        sizes_[i] = {image.width, image.height};
      }
    }
  }
  io::Image image(size_t i) const {
    io::Image image(sizes_[i].first, sizes_[i].second);
    io::from_bytes(images_[i].data(), images_[i].size(), image.rgb.data());
    return image;
  }

 private:
  std::vector<std::vector<uint8_t>> images_;
  std::vector<std::pair<uint32_t, uint32_t>> sizes_;
};

// Presets, and the codebooks that were tried before two of them were chosen.
std::vector<Coding> codings() {
  std::vector<Coding> all;
  for (const std::string& name : EncoderHandle::preset_names()) all.push_back(preset(name));
  for (const Coding& c : codebook_codings()) all.push_back(c);
  return all;
}

// Mean PSNR and SSIM against captured images, of test and of training cameras.
struct AgainstCaptured {
  io::FidelityAccumulator sums[2];
  void add(const BenchScene& scene, size_t camera, const io::Image& seen, const io::Image& made) {
    const bool training = scene.set.cameras[camera].split == "train";
    sums[training ? 1 : 0].add(io::mse(seen, made), io::ssim(seen, made, 0));
  }
};

Json final_row(const BenchScene& scene, const Judge& judge, const Captured* captured,
               const AgainstCaptured& uncompressed, const Coding& coding, const Encoded& e) {
  io::FidelityAccumulator sums;
  AgainstCaptured against;
  judge.visit_file(e.file, [&](size_t i, const io::Image& original, const io::Image& decoded) {
    sums.add(io::mse(original, decoded), io::ssim(original, decoded, 0));
    if (captured != nullptr) against.add(scene, judge.camera(i), captured->image(i), decoded);
  });
  const io::Fidelity f = sums.result();
  Json row = {{"name", coding.name},
              {"bytes", e.file.size()},
              {"ratio", e.ratio()},
              {"fidelity_db", std::min(f.psnr, kMaxDecibels)},
              {"min_view_db", std::min(f.min_psnr, kMaxDecibels)},
              {"ssim", f.mean_ssim},
              {"coded_gaussians", e.report.coded_gaussians},
              {"encode_cpu_s", e.cpu_seconds}};
  for (const int split : {0, 1}) {
    if (captured == nullptr) break;
    const std::string name = split == 0 ? "test" : "train";
    const io::Fidelity now = against.sums[split].result(), was = uncompressed.sums[split].result();
    row["psnr_" + name + "_db"] = now.mean_psnr;
    row["psnr_" + name + "_change_db"] = now.mean_psnr - was.mean_psnr;
    row["ssim_" + name] = now.mean_ssim;
    row["ssim_" + name + "_change"] = now.mean_ssim - was.mean_ssim;
  }
  return row;
}

Json section_row(const std::string& name, const Encoded& e) {
  Json row = {{"name", name}};
  for (uint32_t s = 0; s < L4D_SECTION_COUNT; ++s) row[l4d_section_name(s)] = e.sections[s];
  return row;
}

// Gaussians of each temporal level; permanent layers are level 0.
std::array<uint64_t, 32> by_level(const Encoded& e) {
  std::array<uint64_t, 32> n{};
  for (const l4d_layer_info& l : e.layers) n[l.level] += l.num_gaussians;
  return n;
}

// Figures 10 to 12 of the paper: Gaussians, bytes of pages and of codebooks, by layer.
void add_layers(Bench& bench, Json& table, const io::Weights& weights, const Coding& coding,
                const Encoded& e) {
  // Without losses nothing moves to coarser layers, and extents are those of the input.
  Coding bare;
  bare.preset = "lossless";
  bare.settings = {{L4D_ENC_MERGE_FRACTION, 0}, {L4D_ENC_MERGE_COUNT, 0}, {L4D_ENC_ZSTD_LEVEL, 1}};
  const io::Scene& scene = bench.real().scene;
  const Encoded whole = encode(scene, weights, bare);
  const auto all = by_level(whole);
  std::vector<uint32_t> level_of(scene.count());
  size_t at = 0;
  for (const l4d_layer_info& l : whole.layers) {
    for (uint64_t k = 0; k < l.num_gaussians; ++k) level_of[whole.order[at++]] = l.level;
  }
  std::array<uint64_t, 32> left{};
  for (const uint32_t source : e.order) ++left[level_of[source]];
  const auto merged = by_level(e);
  for (uint32_t level = 0; level < 32; ++level) {
    if (all[level] == 0 && merged[level] == 0) continue;
    uint64_t bytes = 0, codebooks = 0;
    for (size_t l = 0; l < e.layers.size(); ++l) {
      if (e.layers[l].level != level) continue;
      bytes += e.layer_bytes[l];
      codebooks += e.layers[l].codebook_bytes;
    }
    bench.add(table, {{"name", coding.name},
                      {"level", level},
                      {"gaussians", all[level]},
                      {"after_pruning", left[level]},
                      {"after_merging", merged[level]},
                      {"layer_bytes", bytes},
                      {"codebook_bytes", codebooks}});
  }
}

}  // namespace

Json run_final(Bench& bench) {
  const BenchScene& scene = bench.real();
  bench.note("rendering the original");
  const Judge judge(scene, scene.frames(bench.quick() ? 2 : 10));
  std::unique_ptr<Captured> captured;
  AgainstCaptured uncompressed;
  Json tables = {{"uncompressed", Json::array()},
                 {"codings", Json::array()},
                 {"sections", Json::array()},
                 {"layers", Json::array()}};
  if (!scene.set.cameras[0].video.empty()) {
    bench.note("reading captured images");
    captured = std::make_unique<Captured>(scene, judge);
    for (size_t i = 0; i < judge.num_views(); ++i) {
      uncompressed.add(scene, judge.camera(i), captured->image(i), judge.original(i));
    }
    for (const int split : {0, 1}) {
      const io::Fidelity f = uncompressed.sums[split].result();
      bench.add(tables["uncompressed"], {{"name", split == 0 ? "test" : "train"},
                                         {"views", f.views},
                                         {"psnr_db", f.mean_psnr},
                                         {"ssim", f.mean_ssim}});
    }
  }
  for (const Coding& coding : bench.take(codings())) {
    const Encoded e = encode(bench, scene, coding);
    bench.add(tables["codings"], final_row(scene, judge, captured.get(), uncompressed, coding, e));
    bench.add(tables["sections"], section_row(coding.name, e));
    if (coding.preset != coding.name) continue;
    if (coding.name == "default" || coding.name == "paper-small") {
      add_layers(bench, tables["layers"], bench.weights(scene, coding.metric), coding, e);
    }
  }
  return tables;
}

}  // namespace l4d::bench
