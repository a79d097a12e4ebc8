// SPDX-License-Identifier: Apache-2.0
#include <nlohmann/json.hpp>

#include "io/camera/read_cameras.h"

namespace l4d::io {

using Json = nlohmann::json;

// The cameras.json that 3DGS and what is made of it write beside a model: a list. `rotation` is
// camera to world with x right, y down, z forward, and `position` the centre of the camera. The
// principal point is the middle of the image. Cameras are numbered by their places in the list.
CameraSet read_3dgs_cameras(const std::string& path, const Json& root) {
  CameraSet set;
  set.source = "3dgs_cameras";
  for (size_t k = 0; k < root.size(); ++k) {
    const Json& object = root[k];
    const CameraPlace place{path, "entry " + std::to_string(k)};
    Camera camera;
    camera.id = static_cast<int>(k);
    l4d_camera& c = camera.camera = default_camera();
    c.width = whole_number(place, object, "width", kMaxImageSize);
    c.height = whole_number(place, object, "height", kMaxImageSize);
    c.fx = number(place, object, "fx");
    c.fy = number(place, object, "fy");
    c.cx = 0.5 * static_cast<double>(c.width);
    c.cy = 0.5 * static_cast<double>(c.height);
    double axes[9], center[3];
    matrix(place, object, "rotation", 3, 3, axes);
    numbers(place, object, "position", 3, center);
    set_pose(c, axes, center);
    check_camera(place, camera);
    set.cameras.push_back(std::move(camera));
  }
  return set;
}

}  // namespace l4d::io
