// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <nlohmann/json.hpp>
#include <unordered_set>

#include "io/camera/read_cameras.h"
#include "io/camera/unknown_keys.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr const char* kKeys[] = {"id",       "img_name", "width", "height", "position",
                                 "rotation", "fx",       "fy",    "cx",     "cy"};

// A coordinate of the principal point. Other programs write shares of the image or offsets from its
// middle under these keys, which are hardly ever places in it.
double inside(const CameraPlace& place, const Json& object, const char* key, uint32_t size) {
  const double value = number(place, object, key);
  if (value > 0 && value < static_cast<double>(size)) return value;
  place.fail(std::string(key) + " is " + decimal(value) + "; it is in pixels, and within the " +
             std::to_string(size) + " of the image");
}

void set_pinhole(const CameraPlace& place, const Json& object, l4d_camera& camera) {
  camera.width = whole_number(place, object, "width", kMaxImageSize);
  camera.height = whole_number(place, object, "height", kMaxImageSize);
  camera.fx = number(place, object, "fx");
  camera.fy = number(place, object, "fy");
  camera.cx = 0.5 * static_cast<double>(camera.width);
  camera.cy = 0.5 * static_cast<double>(camera.height);
  if (!object.contains("cx") && !object.contains("cy")) return;
  camera.cx = inside(place, object, "cx", camera.width);
  camera.cy = inside(place, object, "cy", camera.height);
}

// Whether all entries state their numbers; a note says so where only some do.
bool have_ids(const Json& root, CameraSet* set) {
  const auto has_id = [](const Json& object) { return object.contains("id"); };
  const auto without = std::find_if_not(root.begin(), root.end(), has_id);
  if (without == root.end()) return true;
  if (std::any_of(root.begin(), root.end(), has_id)) {
    set->notes.push_back("Cameras are numbered by their places in the list: entry " +
                         std::to_string(without - root.begin()) + " has no id.");
  }
  return false;
}

}  // namespace

// The cameras.json that 3DGS and what is made of it write beside a model: a list. `rotation` is
// camera to world with x right, y down, z forward, and `position` the centre of the camera. The
// principal point is the middle of the image unless `cx` and `cy` say where it is, in pixels.
// Cameras have the numbers `id`; without these, they are numbered by their places in the list.
CameraSet read_3dgs_cameras(const std::string& path, const Json& root) {
  CameraSet set;
  set.source = "3dgs_cameras";
  const bool has_ids = have_ids(root, &set);
  UnknownKeys unknown(&set);
  std::unordered_set<int> ids;
  for (size_t k = 0; k < root.size(); ++k) {
    const Json& object = root[k];
    CameraPlace place{path, "entry " + std::to_string(k)};
    Camera camera;
    camera.id = static_cast<int>(k);
    if (has_ids) camera.id = take_id(place, object, &ids);
    camera.camera = default_camera();
    set_pinhole(place, object, camera.camera);
    double axes[9], center[3];
    matrix(place, object, "rotation", 3, 3, axes);
    numbers(place, object, "position", 3, center);
    set_pose(camera.camera, axes, center);
    check_camera(place, camera);
    unknown.look(object, kKeys, place.camera);
    set.cameras.push_back(std::move(camera));
  }
  return set;
}

}  // namespace l4d::io
