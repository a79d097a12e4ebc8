// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/judge.h"

namespace l4d::bench {
namespace {

eval::CameraViews views_at(const BenchScene& scene, const std::vector<uint32_t>& frames) {
  eval::CameraViews all;
  all.set = scene.set;
  for (const uint32_t frame : frames) {
    for (size_t camera = 0; camera < scene.cameras.size(); ++camera) {
      all.views.push_back({camera, scene.time_of(frame), frame});
    }
  }
  return all;
}

// All renders of the original are kept: benchmarks have the memory.
eval::MeterOptions keep_all() {
  eval::MeterOptions options;
  options.max_render_bytes = UINT64_MAX;
  return options;
}

eval::RenderedScene rendered(const std::vector<unsigned char>& file) {
  return eval::RenderedScene({}, eval::StreamBytes{file.data(), file.size()}, "the stream");
}

}  // namespace

Judge::Judge(const BenchScene& scene, const std::vector<uint32_t>& frames)
    : original_({}, &scene.scene, scene.name),
      meter_(original_, views_at(scene, frames), keep_all(), quiet_) {}

io::Fidelity Judge::of_file(const std::vector<unsigned char>& file, bool with_ssim) const {
  eval::RenderedScene coded = rendered(file);
  return fidelity(coded, with_ssim);
}

io::Fidelity Judge::of_scene(const io::Scene& scene, bool with_ssim) const {
  eval::RenderedScene coded({}, &scene, "the scene");
  return fidelity(coded, with_ssim);
}

io::Fidelity Judge::fidelity(eval::RenderedScene& coded, bool with_ssim) const {
  std::vector<eval::ImageError> errors;
  meter_.visit(coded, quiet_, [&](size_t, const io::Image& original, const io::Image& render) {
    errors.push_back({io::mse(original, render), with_ssim ? io::ssim(original, render, 0) : 1});
  });
  return eval::summarise(errors);
}

void Judge::visit_file(const std::vector<unsigned char>& file,
                       const eval::FidelityMeter::Visit& visit) const {
  eval::RenderedScene coded = rendered(file);
  meter_.visit(coded, quiet_, visit);
}

}  // namespace l4d::bench
