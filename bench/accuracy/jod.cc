// SPDX-License-Identifier: Apache-2.0
// How much worse people find videos of a preset than those of the scene: JOD of ColorVideoVDP, as
// `compare --jod` measures it.
#include "eval/jod/jod.h"

#include <algorithm>

#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

constexpr uint32_t kFrames = 30, kQuickFrames = 3;  // in the middle of the scene
constexpr size_t kCameras = 4;

// Camera by camera.
eval::CameraViews videos(const BenchScene& scene, uint32_t frames) {
  eval::CameraViews out;
  out.set = scene.set;
  const uint32_t first = (scene.scene.timeline.num_frames - frames) / 2;
  const size_t cameras = std::min(kCameras, scene.cameras.size());
  for (size_t k = 0; k < cameras; ++k) {
    for (uint32_t frame = first; frame < first + frames; ++frame) {
      out.views.push_back({k * scene.cameras.size() / cameras, scene.time_of(frame), frame});
    }
  }
  return out;
}

}  // namespace

Json run_jod(Bench& bench) {
  const BenchScene& scene = bench.real();
  const eval::CameraViews views = videos(
      scene, std::min(scene.scene.timeline.num_frames, bench.quick() ? kQuickFrames : kFrames));
  eval::Observer quiet;
  eval::RenderedScene original({}, &scene.scene, scene.name);
  Json rows = Json::array();
  for (const std::string& name : bench.take(EncoderHandle::preset_names())) {
    const Encoded coded = encode(bench, scene, preset(name));
    eval::RenderedScene stream({}, eval::StreamBytes{coded.file.data(), coded.file.size()}, name);
    const eval::ImageComparison found = eval::compare_images(
        original, stream, views, false, nullptr, 0, quiet, eval::find_jod_display("standard_4k"));
    bench.add(rows, {{"name", name},
                     {"bytes", coded.file.size()},
                     {"jod", found.mean_jod(&eval::CameraJod::jod)},
                     {"min_jod", found.min_jod()}});
  }
  return {{"jod", rows}};
}

}  // namespace l4d::bench
