// SPDX-License-Identifier: Apache-2.0
#include "io/camera/write_cameras.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "io/camera/read_cameras.h"
#include "io/file/file.h"

namespace l4d::io {
namespace {

using OrderedJson = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr size_t kTestEvery = 8;

OrderedJson distortion_of(const Distortion& lens) {
  if (lens.model == Distortion::Model::kFisheye) {
    return {lens.k[0], lens.k[1], lens.k[2], lens.k[3]};
  }
  return {lens.k[0], lens.k[1], lens.p[0], lens.p[1], lens.k[2], lens.k[3], lens.k[4], lens.k[5]};
}

// Relative to the folder of the file, as its readers take it.
std::string from_folder(const fs::path& folder, const std::string& path) {
  return fs::absolute(path).lexically_normal().lexically_proximate(folder).generic_string();
}

void put_frames(const fs::path& folder, const Camera& camera, OrderedJson& out) {
  const std::pair<const char*, const std::string*> paths[] = {
      {"video", &camera.video}, {"images", &camera.images}, {"mask", &camera.mask}};
  for (const auto& [key, path] : paths) {
    if (!path->empty()) out[key] = from_folder(folder, *path);
  }
  if (camera.distortion.model != Distortion::Model::kNone) {
    out["distortion"] = distortion_of(camera.distortion);
    if (camera.distortion.model == Distortion::Model::kFisheye) out["distortion_model"] = "fisheye";
  }
  if (camera.time_offset != 0) out["time_offset"] = camera.time_offset;
}

OrderedJson json_of(const fs::path& folder, const Camera& camera, bool with_size) {
  const l4d_camera& c = camera.camera;
  const double* m = c.world_to_camera;
  OrderedJson w2c = OrderedJson::array();
  for (size_t r = 0; r < 3; ++r) {
    w2c.push_back({m[4 * r], m[4 * r + 1], m[4 * r + 2], m[4 * r + 3]});
  }
  w2c.push_back({0, 0, 0, 1});
  OrderedJson out = {{"id", camera.id}};
  if (!camera.split.empty()) out["split"] = camera.split;
  if (with_size) {
    out["width"] = c.width;
    out["height"] = c.height;
  }
  if (c.near_plane != default_camera().near_plane) out["near"] = c.near_plane;
  out["K"] = {{c.fx, 0, c.cx}, {0, c.fy, c.cy}, {0, 0, 1}};
  out["w2c"] = w2c;
  put_frames(folder, camera, out);
  return out;
}

}  // namespace

void write_cameras(const std::string& path, const CameraSet& set) {
  const fs::path folder = fs::absolute(path).lexically_normal().parent_path();
  const l4d_camera& first = set.cameras.at(0).camera;
  const bool one_size =
      std::all_of(set.cameras.begin(), set.cameras.end(), [&](const Camera& camera) {
        return camera.camera.width == first.width && camera.camera.height == first.height;
      });
  OrderedJson root = OrderedJson::object();
  if (set.fps > 0) root["fps"] = set.fps;
  if (set.frames > 0) root["frames"] = set.frames;
  if (one_size) {
    root["width"] = first.width;
    root["height"] = first.height;
  }
  root["cameras"] = OrderedJson::array();
  for (const Camera& camera : set.cameras) {
    root["cameras"].push_back(json_of(folder, camera, !one_size));
  }
  const std::string text = root.dump(1) + "\n";
  OutputFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

void split_for_tests(CameraSet& set) {
  for (size_t k = 0; k < set.cameras.size(); ++k) {
    set.cameras[k].split = k % kTestEvery == 0 ? "test" : "train";
  }
}

}  // namespace l4d::io
