// SPDX-License-Identifier: Apache-2.0
// How far mean times are off after coding, in the temporal scale of each Gaussian: rooms with 500
// short flashes in sequences of any length, long synthetic scenes, the basketball scene. Prints a
// Markdown table. Arguments: presets (default, archive).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

#include "bench/tables/common.h"
#include "io/synth/synth.h"
#include "l4d/experimental/inspect.h"
#include "libl4dcodec/scene/slice.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

// A room of 5000 Gaussians that stand still for good, and 500 that light up once.
io::Scene flashes(double seconds, double sigma) {
  constexpr size_t kRoom = 5000, kFlashes = 500;
  uint64_t state = 12345;
  const auto uniform = [&state] {  // in [0, 1)
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<double>(state >> 40) * 0x1p-24;
  };
  io::Scene s;
  s.source = "flashes";
  s.timeline.num_frames = static_cast<uint32_t>(std::lround(seconds * 30));
  s.timeline.fps_num = 30;
  s.timeline.fps_den = 1;
  s.flags = L4D_POSITION_AT_MEAN_TIME;
  s.resize(kRoom + kFlashes);
  for (size_t i = 0; i < s.count(); ++i) {
    const bool flash = i >= kRoom;
    for (size_t k = 0; k < 3; ++k) {
      s.position[3 * i + k] = static_cast<float>(uniform() * 4 - 2);
      s.log_scale[4 * i + k] = static_cast<float>(std::log(0.01 + 0.05 * uniform()));
      s.sh[3 * i + k] = static_cast<float>(uniform() - 0.5);
    }
    s.mean_t[i] = static_cast<float>(flash ? seconds * uniform() : seconds / 2);
    s.log_scale[4 * i + 3] = static_cast<float>(flash ? std::log(sigma) : std::log(seconds * 100));
    s.rotor[8 * i] = 1;
    s.opacity[i] = static_cast<float>(0.3 + 0.7 * uniform());
  }
  return s;
}

double sigma_of(const io::Scene& s, size_t i) {
  return 1 / std::sqrt(slice_attributes<double>(&s.rotor[8 * i], &s.log_scale[4 * i]).lambda);
}

void print_row(const std::string& name, const WeightedScene& scene, const char* preset) {
  const EncoderHandle encoder = make_encoder(
      scene, scene.weights.count == 0 ? std::vector<float>() : sh_weights(scene), preset);
  const std::vector<unsigned char> file = encoder.encode();
  const l4d_encode_report report = report_of(encoder);
  const std::vector<uint32_t> order = encoder.order();
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  const GaussianArrays a = d.decode(whole_query());
  uint64_t bytes[L4D_SECTION_COUNT];
  d.check(l4d_decoder_get_sections(d.get(), bytes, L4D_SECTION_COUNT, nullptr, nullptr, 0));
  std::vector<double> error;
  size_t displaced = 0;
  for (const l4d_bucket_span& r : a.spans) {
    l4d_layer_info layer = L4D_INIT(l4d_layer_info);
    d.check(l4d_decoder_get_layer_info(d.get(), r.layer, &layer));
    if (layer.permanent != 0) continue;
    for (uint64_t i = r.first; i < r.first + r.count; ++i) {
      const size_t from = order[static_cast<size_t>(i)];
      const double mean = r.center + static_cast<double>(a.mean_t_local[static_cast<size_t>(i)]);
      error.push_back(std::fabs(mean - static_cast<double>(scene.scene.mean_t[from])) /
                      sigma_of(scene.scene, from));
      displaced += error.back() > 2;
    }
  }
  std::sort(error.begin(), error.end());
  const auto at = [&](double share) {
    const double last = static_cast<double>(error.size() - 1);
    return error.empty() ? 0.0 : error[static_cast<size_t>(share * last)];
  };
  std::printf("| %s | %s | %u | %zu | %.3g | %.3g | %.3g | %.1f %% | %llu | %zu |\n", name.c_str(),
              preset, report.num_layers, error.size(), at(0.5), at(0.99), at(1),
              error.empty()
                  ? 0
                  : 100.0 * static_cast<double>(displaced) / static_cast<double>(error.size()),
              static_cast<unsigned long long>(bytes[L4D_SECTION_MEAN_T]), file.size());
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  using Names = std::vector<const char*>;
  const Names presets = argc > 1 ? Names(argv + 1, argv + argc) : Names{"default", "archive"};
  struct Row {
    const char* name;
    double seconds, sigma;
  };
  const Row rows[] = {{"flashes of 30 ms, 10 s", 10, 0.03},
                      {"flashes of 30 ms, 60 s", 60, 0.03},
                      {"flashes of 30 ms, 600 s", 600, 0.03},
                      {"flashes of 50 ms, 1 h", 3600, 0.05},
                      {"flashes of 100 ms, 24 h", 86400, 0.1}};
  std::puts(
      "| scene | preset | layers | with a mean time | error: median | 99 % | max |"
      " off by more than 2 | bytes of mean times | bytes |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|");
  for (const char* preset : presets) {
    for (const Row& row : rows) {
      print_row(row.name, {flashes(row.seconds, row.sigma), {}}, preset);
    }
    io::SynthOptions options;
    options.seconds = 600;
    options.gaussians = 100000;
    options.effects = {"static", "flicker"};
    print_row("synth, 600 s, static and flicker", {io::synthesize(options), {}}, preset);
    options.effects = {};
    print_row("synth, 600 s, all effects", {io::synthesize(options), {}}, preset);
    if (data_dir().empty()) continue;
    WeightedScene basketball = load_basketball();
    print_row("basketball, weighted", basketball, preset);
    basketball.weights = {};
    print_row("basketball", basketball, preset);
  }
  if (data_dir().empty()) std::puts("SKIPPED: basketball; set L4D_DATA_DIR to see it");
  return 0;
}
