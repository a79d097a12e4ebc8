// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <nlohmann/json.hpp>

#include "io/camera/read_cameras.h"
#include "io/camera/unknown_keys.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;
constexpr double kHalfTurn = 3.14159265358979323846;  // radians

// What is read, and what changes nothing here: cameras are there for each frame already.
constexpr const char* kRootKeys[] = {
    "camera_type", "render_width",           "render_height",    "fps",       "camera_path",
    "default_fov", "default_transition_sec", "smoothness_value", "keyframes", "is_cycle",
    "seconds"};
constexpr const char* kCameraKeys[] = {"camera_to_world", "fov", "aspect"};

// Whether a camera is of another shape than the images, whose size the path states.
bool has_other_aspect(const CameraPlace& place, const Json& object, const l4d_camera& camera) {
  const double own = static_cast<double>(camera.width) / static_cast<double>(camera.height);
  return !(std::abs(number_or(place, object, "aspect", own) / own - 1) <= 0.01);
}

}  // namespace

// Cameras of a walk through a scene, as the viewer of nerfstudio exports it: `camera_to_world` has
// 16 numbers by rows, with x right, y up, z back; `fov` is that of the height, in degrees.
CameraSet read_camera_path(const std::string& path, const Json& root) {
  const CameraPlace file{path, ""};
  CameraSet set;
  set.source = "camera_path";
  const std::string type = text_or(file, root, "camera_type", "perspective");
  if (type != "perspective") {
    file.fail(L4D_ERR_FEATURE_UNSUPPORTED,
              "its camera_type is not perspective; cameras here are pinholes");
  }
  const uint32_t width = whole_number(file, root, "render_width", kMaxImageSize);
  const uint32_t height = whole_number(file, root, "render_height", kMaxImageSize);
  set.fps = number_or(file, root, "fps", 0);
  if (!(set.fps >= 0 && set.fps <= kMaxFps)) file.fail("fps is not from 0 to 1000000");
  const Json& cameras = member(file, root, "camera_path");
  if (!cameras.is_array()) file.fail("camera_path is not a list");
  UnknownKeys unknown(&set);
  unknown.look(root, kRootKeys, "the file");
  size_t with_other_aspect = 0;
  for (size_t k = 0; k < cameras.size(); ++k) {
    const CameraPlace place{path, "entry " + std::to_string(k) + " of camera_path"};
    double c2w[16];
    numbers(place, cameras[k], "camera_to_world", 16, c2w);
    const double fov = number(place, cameras[k], "fov");
    if (!(fov > 0 && fov < 180)) place.fail("fov is no angle between 0 and 180 degrees");
    Camera camera;
    camera.id = static_cast<int>(k);
    l4d_camera& c = camera.camera = default_camera();
    c.width = width;
    c.height = height;
    c.fx = c.fy = 0.5 * static_cast<double>(height) / std::tan(fov * kHalfTurn / 360);
    c.cx = 0.5 * static_cast<double>(width);
    c.cy = 0.5 * static_cast<double>(height);
    set_opengl_pose(place, "camera_to_world", c2w, c);
    check_camera(place, camera);
    if (has_other_aspect(place, cameras[k], c)) ++with_other_aspect;
    unknown.look(cameras[k], kCameraKeys, place.camera);
    set.cameras.push_back(std::move(camera));
  }
  if (with_other_aspect > 0) {
    set.notes.push_back(
        "Cameras whose aspect differs from render_width / render_height, which is taken: " +
        std::to_string(with_other_aspect) + ".");
  }
  return set;
}

}  // namespace l4d::io
