// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/scene.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "io/ply/scene_ply.h"

namespace l4d::bench {
namespace {

void finish(BenchScene& s) {
  for (size_t i = 0; i < s.set.cameras.size(); ++i) {
    s.cameras.push_back(s.set.cameras[i].camera);
    const std::string& split = s.set.cameras[i].split;
    if (split.empty() || split == "train") s.training.push_back(static_cast<uint32_t>(i));
  }
  const l4d_timeline& t = s.scene.timeline;
  s.fps = s.set.fps > 0 ? s.set.fps : static_cast<double>(t.fps_num) / t.fps_den;
}

}  // namespace

eval::CameraViews BenchScene::training_views() const {
  eval::CameraViews all{set, {}};
  for (uint32_t frame = 0; frame < scene.timeline.num_frames; ++frame) {
    for (const uint32_t camera : training) all.views.push_back({camera, time_of(frame), frame});
  }
  return all;
}

std::vector<uint32_t> BenchScene::frames(uint32_t count) const {
  const uint32_t n = scene.timeline.num_frames;
  std::vector<uint32_t> out;
  for (uint32_t i = 0; i < std::min(count, n); ++i) out.push_back(i * (n / std::min(count, n)));
  return out;
}

std::string basketball_dir() {
  const char* set = std::getenv("L4D_DATA_DIR");
  const std::string root = set != nullptr ? set : "../shared/data";
  if (!std::filesystem::exists(root + "/basketball/basketball.ply")) {
    throw io::Error(L4D_ERR_IO, root +
                                    "/basketball/basketball.ply is not there: set L4D_DATA_DIR to"
                                    " the folder of the real scenes, or take --quick");
  }
  return root + "/basketball/";
}

BenchScene load_basketball() {
  const std::string dir = basketball_dir();
  BenchScene s;
  s.name = "basketball";
  s.scene = io::read_scene_ply(dir + "basketball.ply");
  s.set = io::read_cameras(dir + "cameras.json");
  finish(s);
  return s;
}

BenchScene make_synth(const io::SynthOptions& options, uint32_t num_cameras, uint32_t width,
                      uint32_t height) {
  BenchScene s;
  s.name = "synth";
  s.scene = io::synthesize(options);
  s.set = io::orbit_cameras(s.scene, num_cameras, width, height);
  finish(s);
  return s;
}

}  // namespace l4d::bench
