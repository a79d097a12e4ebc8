// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <unordered_set>

#include "io/camera/read_cameras.h"
#include "io/camera/unknown_keys.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

void set_intrinsics(const CameraPlace& place, const Json& object, l4d_camera& camera) {
  double k[9];
  matrix(place, object, "K", 3, 3, k);
  camera.fx = k[0];
  camera.fy = k[4];
  camera.cx = k[2];
  camera.cy = k[5];
  if (k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    place.fail("K is no matrix of a pinhole camera");
  }
  if (!(std::abs(k[1]) <= 1e-6 * std::abs(k[0]))) {
    place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "K has a skew");
  }
}

// [k1, k2, p1, p2, k3, k4, k5, k6], as OpenCV writes it, of any length up to that; or of a fisheye
// lens [k1, k2, k3, k4].
Distortion distortion_of(const CameraPlace& place, const Json& object) {
  Distortion out;
  const Json none = Json::array();
  const Json& list = object.contains("distortion") ? object.at("distortion") : none;
  const std::string model = text_or(place, object, "distortion_model", "radial");
  if (model != "radial" && model != "fisheye") {
    place.fail("distortion_model is not one of radial, fisheye");
  }
  const bool fisheye = model == "fisheye";
  if (!list.is_array() || list.size() > (fisheye ? 4 : 8)) {
    place.fail(fisheye ? "distortion is not a list of up to 4 numbers"
                       : "distortion is not a list of up to 8 numbers");
  }
  double* const places[] = {&out.k[0], &out.k[1], &out.p[0], &out.p[1],
                            &out.k[2], &out.k[3], &out.k[4], &out.k[5]};
  bool any = false;
  for (size_t i = 0; i < list.size(); ++i) {
    const double value = finite_number(place, list[i], "distortion");
    *(fisheye ? &out.k[i] : places[i]) = value;
    any |= value != 0;
  }
  // A fisheye lens without coefficients is none the less no pinhole.
  if (fisheye) out.model = Distortion::Model::kFisheye;
  if (any && !fisheye) out.model = Distortion::Model::kRadial;
  return out;
}

// Where the frames of a camera are, and how they were taken: all of it is optional.
void read_frames_of(const CameraPlace& place, const Json& object, Camera* camera) {
  const auto path = [&](const char* key) {
    const std::string name = text_or(place, object, key, "");
    std::string file = beside(place.path, name);
    if (camera->outside.empty() && leaves_folder(name)) camera->outside = file;
    return file;
  };
  camera->video = path("video");
  camera->images = path("images");
  camera->mask = path("mask");
  camera->distortion = distortion_of(place, object);
  camera->time_offset = number_or(place, object, "time_offset", 0);
}

constexpr const char* kRootKeys[] = {"fps", "frames", "width", "height", "cameras"};
constexpr const char* kCameraKeys[] = {
    "id",          "split", "video", "images", "mask", "K", "w2c", "distortion", "distortion_model",
    "time_offset", "near",  "width", "height"};

}  // namespace

CameraSet read_cameras_json(const std::string& path, const Json& root) {
  const CameraPlace file{path, ""};
  CameraSet set;
  set.source = "cameras_json";
  set.fps = number_or(file, root, "fps", 0);
  if (!(set.fps >= 0 && set.fps <= kMaxFps)) file.fail("fps is not from 0 to 1000000");
  if (root.contains("frames")) set.frames = whole_number(file, root, "frames", L4D_MAX_FRAMES);

  UnknownKeys unknown(&set);
  unknown.look(root, kRootKeys, "the file");
  const Json& cameras = member(file, root, "cameras");
  if (!cameras.is_array()) file.fail("cameras is not a list");
  std::unordered_set<int> ids;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const Json& object = cameras[i];
    CameraPlace place{path, "entry " + std::to_string(i) + " of cameras"};
    Camera camera;
    camera.id = take_id(place, object, &ids);
    unknown.look(object, kCameraKeys, place.camera);

    camera.split = text_or(place, object, "split", "");
    if (!camera.split.empty() && camera.split != "train" && camera.split != "test" &&
        camera.split != "val") {
      place.fail("split is not one of train, test, val");
    }
    read_frames_of(place, object, &camera);
    camera.camera = default_camera();
    if (object.contains("near")) {
      camera.camera.near_plane = number(place, object, "near");
    }
    camera.camera.width =
        whole_number(place, object.contains("width") ? object : root, "width", kMaxImageSize);
    camera.camera.height =
        whole_number(place, object.contains("height") ? object : root, "height", kMaxImageSize);
    set_intrinsics(place, object, camera.camera);
    double w2c[16];
    matrix(place, object, "w2c", 4, 4, w2c);
    check_last_row(place, "w2c", w2c + 12);
    std::copy(w2c, w2c + 12, camera.camera.world_to_camera);
    check_camera(place, camera);
    set.cameras.push_back(std::move(camera));
  }
  return set;
}

}  // namespace l4d::io
