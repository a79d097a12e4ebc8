// SPDX-License-Identifier: Apache-2.0
// How much worse people find videos of a preset than those of the scene: JOD of ColorVideoVDP, as
// `compare --jod` measures it.
#include "eval/jod/jod.h"

#include <algorithm>
#include <numeric>

#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

constexpr uint32_t kFrames = 30, kQuickFrames = 3;  // in the middle of the scene
constexpr size_t kCameras = 4;

// By camera of the judge's views.
std::vector<double> jods(const Judge& judge, const BenchScene& scene,
                         const std::vector<size_t>& cameras, uint64_t frames,
                         const std::vector<unsigned char>& file) {
  const eval::JodDisplay* display = eval::find_jod_display("standard_4k");
  std::vector<eval::JodMeter> meters;
  for (const size_t k : cameras) {
    const l4d_camera& camera = scene.cameras[k];
    meters.emplace_back(camera.width, camera.height, frames, scene.fps, *display, 0, io::Hold());
  }
  judge.visit_file(file, [&](size_t index, const io::Image& original, const io::Image& render) {
    const auto camera = std::find(cameras.begin(), cameras.end(), judge.camera(index));
    meters[static_cast<size_t>(camera - cameras.begin())].add(render, original);
  });
  std::vector<double> out;
  for (const eval::JodMeter& meter : meters) out.push_back(meter.jod());
  return out;
}

}  // namespace

Json run_jod(Bench& bench) {
  const BenchScene& scene = bench.real();
  const uint32_t all = scene.scene.timeline.num_frames;
  const uint32_t count = std::min(all, bench.quick() ? kQuickFrames : kFrames);
  std::vector<uint32_t> frames(count);
  std::iota(frames.begin(), frames.end(), (all - count) / 2);
  const size_t some = std::min(kCameras, scene.cameras.size());
  std::vector<size_t> cameras;
  for (size_t k = 0; k < some; ++k) cameras.push_back(k * scene.cameras.size() / some);
  const Judge judge(scene, frames, cameras);
  Json rows = Json::array();
  for (const std::string& name : bench.take(EncoderHandle::preset_names())) {
    const Encoded coded = encode(bench, scene, preset(name));
    const std::vector<double> found = jods(judge, scene, cameras, count, coded.file);
    const double sum = std::accumulate(found.begin(), found.end(), 0.0);
    bench.add(rows, {{"name", name},
                     {"bytes", coded.file.size()},
                     {"jod", sum / static_cast<double>(found.size())},
                     {"min_jod", *std::min_element(found.begin(), found.end())}});
  }
  return {{"jod", rows}};
}

}  // namespace l4d::bench
