// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "io/file/file.h"
#include "io/image/image.h"
#include "training/capture/opencv_camera.h"
#include "training/capture/video_capture.h"

// Captures whose cameras are listed in JSON: CMU Panoptic Studio (calibration_NAME.json and
// hdVideos/hd_NAME.mp4), and its sequences as Dynamic 3D Gaussians has them (train_meta.json,
// test_meta.json and ims/).
namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::CameraPlace;
using nlohmann::json;

class JsonFile {
 public:
  JsonFile(const std::string& path, const io::Hold& holder) : place{path, ""} {
    io::InputFile file(path, holder);
    root = io::read_json_file(file, holder, 0, &memory_);
  }
  CameraPlace place;
  json root;

 private:
  std::shared_ptr<void> memory_;
};

// Entry [t][c] of a list of lists.
const json& entry(const CameraPlace& place, const json& root, const char* key, size_t t, size_t c) {
  const json& rows = io::member(place, root, key);
  if (!rows.is_array() || t >= rows.size() || !rows[t].is_array() || c >= rows[t].size()) {
    place.fail(std::string(key) + " has no entry [" + std::to_string(t) + "][" + std::to_string(c) +
               "]");
  }
  return rows[t][c];
}

// The images of camera c, whose names must count its frames.
void set_images(const CameraPlace& place, const fs::path& folder, const json& root, size_t c,
                io::Camera* camera) {
  const size_t frames = io::member(place, root, "fn").size();
  for (size_t t = 0; t < frames; ++t) {
    const json& name = entry(place, root, "fn", t, c);
    if (!name.is_string()) place.fail("a name in fn is no text");
    const fs::path path = name.get<std::string>();
    if (io::leaves_folder(path.string())) place.fail("a name in fn leaves the folder");
    if (t == 0) {
      const std::string stem = path.stem().string();
      if (stem.empty() || stem.size() > 9 ||
          stem.find_first_not_of("0123456789") != std::string::npos) {
        place.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                   "an image whose name is no number: " + path.string());
      }
      camera->images = (folder / "ims" / path.parent_path() /
                        ("%0" + std::to_string(stem.size()) + "d" + path.extension().string()))
                           .string();
      camera->first_image = static_cast<uint32_t>(std::stoul(stem));
    }
    if (folder / "ims" / path != io::numbered_image(*camera, static_cast<uint32_t>(t))) {
      place.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                 "images that are not numbered one after the other: " + path.string());
    }
  }
}

void add_meta(const fs::path& folder, const char* name, const char* split,
              const CaptureOptions& options, io::CameraSet* set) {
  const JsonFile file((folder / name).string(), options.holder);
  const json& root = file.root;
  const uint32_t width = io::whole_number(file.place, root, "w", L4D_MAX_IMAGE_SIDE);
  const uint32_t height = io::whole_number(file.place, root, "h", L4D_MAX_IMAGE_SIDE);
  const json& names = io::member(file.place, root, "fn");
  if (!names.is_array() || names.empty() || !names[0].is_array()) {
    file.place.fail("fn has no images");
  }
  set->frames = static_cast<uint32_t>(names.size());
  for (size_t c = 0; c < names[0].size(); ++c) {
    const int id = static_cast<int>(set->cameras.size());
    const CameraPlace place{file.place.path, "camera " + std::to_string(id)};
    io::Camera camera;
    camera.id = id;
    camera.split = split;
    camera.camera = io::default_camera();
    camera.camera.width = width;
    camera.camera.height = height;
    const json one = {{"k", entry(place, root, "k", 0, c)},
                      {"w2c", entry(place, root, "w2c", 0, c)}};
    for (size_t t = 1; t < names.size(); ++t) {
      if (entry(place, root, "k", t, c) != one["k"] ||
          entry(place, root, "w2c", t, c) != one["w2c"]) {
        place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "it moves in frame " + std::to_string(t));
      }
    }
    double k[9], w2c[16];
    io::matrix(place, one, "k", 3, 3, k);
    io::matrix(place, one, "w2c", 4, 4, w2c);
    io::check_last_row(place, "w2c", w2c + 12);
    set_pinhole(place, k, &camera.camera);
    std::copy_n(w2c, 12, camera.camera.world_to_camera);
    io::check_camera(place, camera);
    set_images(place, folder, root, c, &camera);
    set->cameras.push_back(std::move(camera));
  }
}

// What a camera of the Panoptic Studio saw: a video, or images NAME_00000000.jpg.
void find_images(const fs::path& folder, const std::string& name, io::Camera* camera) {
  const fs::path images = folder / "hdImgs" / name;
  std::error_code error;
  for (const char* ending : io::kImageExtensions) {
    const fs::path pattern = images / (name + "_%08d" + ending);
    for (const uint32_t first : {0U, 1U}) {
      camera->images = pattern.string();
      camera->first_image = first;
      if (fs::exists(io::numbered_image(*camera, 0), error)) return;
    }
  }
  camera->images.clear();
  camera->first_image = 0;
  camera->video = (folder / "hdVideos" / ("hd_" + name + ".mp4")).string();
}

}  // namespace

Capture read_dynamic3dgs_capture(const std::string& folder, const CaptureOptions& options) {
  io::CameraSet set;
  set.source = "dynamic3dgs";
  std::error_code error;
  if (fs::exists(fs::path(folder) / "test_meta.json", error)) {
    add_meta(folder, "test_meta.json", "test", options, &set);
  }
  add_meta(folder, "train_meta.json", "train", options, &set);
  Capture capture = make_video_capture(folder, set, options);
  capture.layout = "dynamic3dgs";
  return capture;
}

Capture read_panoptic_capture(const std::string& file, const CaptureOptions& options) {
  const fs::path folder = fs::path(file).parent_path();
  const JsonFile calibration(file, options.holder);
  io::CameraSet set;
  set.source = "panoptic";
  const json& cameras = io::member(calibration.place, calibration.root, "cameras");
  if (!cameras.is_array()) calibration.place.fail("cameras is no list");
  for (const json& item : cameras) {
    const std::string name = io::text_or(calibration.place, item, "name", "");
    const CameraPlace place{file, "camera " + name};
    if (io::text_or(place, item, "type", "hd") != "hd") continue;  // VGA and Kinect are others
    if (name.empty() || io::leaves_folder(name)) place.fail("its name names no file");
    io::Camera camera;
    camera.id = static_cast<int>(set.cameras.size());
    camera.camera = io::default_camera();
    double size[2], k[9], lens[5], rotation[9], translation[3];
    io::numbers(place, item, "resolution", 2, size);
    io::matrix(place, item, "K", 3, 3, k);
    io::numbers(place, item, "distCoef", 5, lens);
    io::matrix(place, item, "R", 3, 3, rotation);
    io::matrix(place, item, "t", 3, 1, translation);
    for (const double side : size) {
      if (!(side >= 1 && side <= L4D_MAX_IMAGE_SIDE)) place.fail("resolution is out of range");
    }
    camera.camera.width = static_cast<uint32_t>(size[0]);
    camera.camera.height = static_cast<uint32_t>(size[1]);
    set_pinhole(place, k, &camera.camera);
    set_lens(place, std::vector<double>(lens, lens + 5), &camera);
    set_extrinsics(rotation, translation, &camera.camera);
    io::check_camera(place, camera);
    find_images(folder, name, &camera);
    set.cameras.push_back(std::move(camera));
  }
  if (set.cameras.empty()) calibration.place.fail("it has no camera of type hd");
  Capture capture = make_video_capture(file, set, options);
  capture.layout = "panoptic";
  return capture;
}

}  // namespace l4d::train
