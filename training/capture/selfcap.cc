// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "io/camera/read_cameras.h"
#include "io/file/file.h"
#include "training/capture/opencv_camera.h"
#include "training/capture/opencv_yaml.h"
#include "training/capture/video_capture.h"

// SelfCap and EasyVolcap: intri.yml, extri.yml, videos/NAME.mp4 or images/NAME/%06d.*, sync.json.
namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::CameraPlace;

const std::vector<double>* find(const YamlFile& file, const std::string& key, size_t size) {
  const auto found = file.numbers.find(key);
  return found != file.numbers.end() && found->second.size() == size ? &found->second : nullptr;
}

// What states a rotation twice must mean one. Matrices of programs have four digits and more.
void compare_rotations(const CameraPlace& place, const std::string& name, const double* matrix,
                       const double* vector) {
  constexpr double kMost = 1e-3;
  double of_vector[9], apart = 0;
  rotation_of(vector, of_vector);
  for (size_t k = 0; k < 9; ++k) apart = std::max(apart, std::abs(matrix[k] - of_vector[k]));
  if (apart <= kMost) return;
  place.fail("Rot_" + name + " and R_" + name + " are different rotations: their matrices are " +
             io::decimal(apart) + " apart");
}

class SelfcapReader {
 public:
  SelfcapReader(const std::string& folder, const io::Hold& holder)
      : folder_(folder),
        holder_(holder),
        intrinsics_(read_opencv_yaml((folder_ / "intri.yml").string(), holder)),
        extrinsics_(read_opencv_yaml((folder_ / "extri.yml").string(), holder)) {}

  io::CameraSet read() {
    const CameraPlace file{(folder_ / "intri.yml").string(), ""};
    const auto names = intrinsics_.texts.find("names");
    if (names == intrinsics_.texts.end() || names->second.empty()) file.fail("names is missing");
    io::CameraSet set;
    set.source = "selfcap";
    const auto fps = intrinsics_.numbers.find("fps");
    if (fps != intrinsics_.numbers.end() && !fps->second.empty()) set.fps = fps->second[0];
    std::set<std::string> is_read;
    for (const std::string& name : names->second) {
      if (!is_read.insert(name).second) file.fail("names has " + name + " twice");
      if (io::leaves_folder(name)) file.fail("the name of a camera leaves the folder");
      set.cameras.push_back(camera_of(name, static_cast<int>(set.cameras.size())));
    }
    read_offsets(&set, names->second);
    return set;
  }

 private:
  io::Camera camera_of(const std::string& name, int id) {
    const CameraPlace place{(folder_ / "extri.yml").string(), "camera " + name};
    io::Camera out;
    out.id = id;
    out.camera = io::default_camera();
    l4d_camera& camera = out.camera;
    const std::vector<double>* k = find(intrinsics_, "K_" + name, 9);
    const std::vector<double>* width = find(intrinsics_, "W_" + name, 1);
    const std::vector<double>* height = find(intrinsics_, "H_" + name, 1);
    if (k == nullptr) place.fail("K_" + name + " is no matrix of 3 x 3 in intri.yml");
    if (width == nullptr || height == nullptr) {
      place.fail("H_" + name + " and W_" + name + " are missing in intri.yml");
    }
    set_pinhole(place_of("K_" + name), k->data(), &camera);
    camera.width = whole_number("W_" + name, (*width)[0]);
    camera.height = whole_number("H_" + name, (*height)[0]);
    read_lens(name, &out);
    double rotation[9];
    const std::vector<double>* matrix = find(extrinsics_, "Rot_" + name, 9);
    const std::vector<double>* vector = find(extrinsics_, "R_" + name, 3);
    const std::vector<double>* t = find(extrinsics_, "T_" + name, 3);
    if (t == nullptr || (matrix == nullptr && vector == nullptr)) {
      place.fail("Rot_" + name + " or R_" + name + ", and T_" + name + " are missing");
    }
    if (matrix != nullptr) {
      if (vector != nullptr) compare_rotations(place, name, matrix->data(), vector->data());
      std::copy_n(matrix->begin(), 9, rotation);
    } else {
      rotation_of(vector->data(), rotation);
    }
    set_extrinsics(rotation, t->data(), &camera);
    io::check_camera(place, out);
    set_images(name, &out);
    return out;
  }

  CameraPlace place_of(const std::string& key) const {
    return {(folder_ / "intri.yml").string(), key};
  }

  uint32_t whole_number(const std::string& key, double value) const {
    if (value >= 0 && value <= 1e6 && value == std::floor(value)) {
      return static_cast<uint32_t>(value);
    }
    place_of(key).fail("no whole number of pixels");
  }

  void read_lens(const std::string& name, io::Camera* out) const {
    std::string key = "D_" + name;
    auto found = intrinsics_.numbers.find(key);
    if (found == intrinsics_.numbers.end()) found = intrinsics_.numbers.find(key = "dist_" + name);
    if (found != intrinsics_.numbers.end()) set_lens(place_of(key), found->second, out);
  }

  void set_images(const std::string& name, io::Camera* out) {
    const fs::path video = folder_ / "videos" / (name + ".mp4");
    const fs::path images = folder_ / "images" / name;
    std::error_code error;
    if (fs::is_directory(images, error) && !fs::exists(video, error)) {
      out->images = numbered_images_in(images);
    } else {
      out->video = video.string();
    }
  }

  // True time = frame time - offset.
  void read_offsets(io::CameraSet* set, const std::vector<std::string>& names) {
    const fs::path path = folder_ / "sync.json";
    std::error_code error;
    if (!fs::exists(path, error)) return;
    const CameraPlace place{path.string(), ""};
    std::shared_ptr<void> memory;
    io::InputFile file(path.string(), holder_);
    const nlohmann::json root = io::read_json_file(file, holder_, 0, &memory);
    if (!root.is_object()) place.fail("not an object of cameras and seconds");
    for (const auto& item : root.items()) {
      if (std::find(names.begin(), names.end(), item.key()) != names.end()) continue;
      set->notes.push_back("sync.json has a camera that intri.yml does not name: " +
                           nlohmann::json(item.key()).dump() + ".");
      break;
    }
    const auto missing = std::find_if(names.begin(), names.end(), [&root](const std::string& name) {
      return !root.contains(name);
    });
    if (missing != names.end()) {
      set->notes.push_back("sync.json has no offset of " + nlohmann::json(*missing).dump() +
                           ", which is taken to be 0.");
    }
    for (size_t k = 0; k < names.size(); ++k) {
      set->cameras[k].time_offset = -io::number_or(place, root, names[k].c_str(), 0);
      io::check_camera({path.string(), "camera " + names[k]}, set->cameras[k]);
    }
  }

  fs::path folder_;
  const io::Hold& holder_;
  YamlFile intrinsics_, extrinsics_;
};

}  // namespace

Capture read_selfcap_capture(const std::string& folder, const CaptureOptions& options) {
  Capture capture =
      make_video_capture(folder, SelfcapReader(folder, options.holder).read(), options);
  capture.layout = "selfcap";
  return capture;
}

}  // namespace l4d::train
