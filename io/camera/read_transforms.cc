// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "io/camera/read_cameras.h"
#include "io/camera/unknown_keys.h"
#include "io/image/image.h"
#include "io/scene/scene.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

constexpr double kMaxTime = 1e9;
constexpr uint32_t kBlenderSize = 800;  // pixels: what the renderings of NeRF and D-NeRF have

std::string split_of(const std::string& path) {
  const std::string name = fs::path(path).stem().string();
  for (const char* split : {"train", "test", "val"}) {
    if (name == std::string("transforms_") + split) return split;
  }
  return "";
}

// The path of an image; the format leaves out the extension of most. Names may have dots:
// "r_0.5" is that of r_0.5.png.
std::string image_of(const std::string& path, const std::string& name, bool look) {
  const std::string image = beside(path, name);
  std::error_code error;
  if (image.empty() || (look && fs::is_regular_file(image, error))) return image;
  for (const char* extension : kImageExtensions) {
    if (look && fs::is_regular_file(image + extension, error)) return image + extension;
  }
  const std::string own = fs::path(image).extension().string();
  const bool is_image = std::any_of(std::begin(kImageExtensions), std::end(kImageExtensions),
                                    [&](const char* extension) { return own == extension; });
  return is_image || own == ".webp" ? image : image + ".png";
}

// A frame's own number, else that of the file.
const Json& owner_of(const Json& frame, const Json& root, const char* key) {
  return frame.contains(key) ? frame : root;
}

// Focal length in pixels along one direction, where the file says.
std::optional<double> focal_length(const CameraPlace& place, const Json& frame, const Json& root,
                                   const char* focal_key, const char* angle_key, uint32_t size) {
  const Json& focal_owner = owner_of(frame, root, focal_key);
  if (focal_owner.contains(focal_key)) return number(place, focal_owner, focal_key);
  const Json& angle_owner = owner_of(frame, root, angle_key);
  if (!angle_owner.contains(angle_key)) return std::nullopt;
  const double angle = number(place, angle_owner, angle_key);
  if (!(angle > 0 && angle < 3.14159)) {
    place.fail(std::string(angle_key) + " is no angle between 0 and pi");
  }
  return 0.5 * static_cast<double>(size) / std::tan(0.5 * angle);
}

enum class Lens { kPinhole, kRational, kFisheye };
// By the names of nerfstudio and COLMAP. A pinhole may have k1 to k3, p1 and p2.
struct Model {
  const char* name;
  Lens lens;
};
constexpr Model kModels[] = {{"", Lens::kPinhole},
                             {"SIMPLE_PINHOLE", Lens::kPinhole},
                             {"PINHOLE", Lens::kPinhole},
                             {"PERSPECTIVE", Lens::kPinhole},
                             {"SIMPLE_RADIAL", Lens::kPinhole},
                             {"RADIAL", Lens::kPinhole},
                             {"OPENCV", Lens::kPinhole},
                             {"FULL_OPENCV", Lens::kRational},
                             {"OPENCV_FISHEYE", Lens::kFisheye},
                             {"SIMPLE_RADIAL_FISHEYE", Lens::kFisheye},
                             {"RADIAL_FISHEYE", Lens::kFisheye}};

// What is read, and what changes nothing here.
constexpr const char* kKeys[] = {"frames",
                                 "file_path",
                                 "transform_matrix",
                                 "time",
                                 "w",
                                 "h",
                                 "fl_x",
                                 "fl_y",
                                 "cx",
                                 "cy",
                                 "camera_angle_x",
                                 "camera_angle_y",
                                 "camera_model",
                                 "is_fisheye",
                                 "k1",
                                 "k2",
                                 "k3",
                                 "k4",
                                 "k5",
                                 "k6",
                                 "p1",
                                 "p2",
                                 "distortion_params",
                                 "mask_path",
                                 "ply_file_path",
                                 "applied_transform",
                                 "applied_scale",
                                 "aabb_scale",
                                 "sharpness",
                                 "rotation",
                                 "colmap_im_id",
                                 "latlong",
                                 "equirectangular",
                                 "orthographic",
                                 "ftheta_p0",
                                 "train_filenames",
                                 "val_filenames",
                                 "test_filenames"};

class TransformsReader {
 public:
  TransformsReader(const std::string& path, const Json& root, bool any_path)
      : path_(path), root_(root), any_path_(any_path) {}

  CameraSet read() {
    const CameraPlace file{path_, ""};
    const Json& frames = member(file, root_, "frames");
    if (!frames.is_array()) file.fail("frames is not a list");
    set_.source = "transforms";
    const std::string split = split_of(path_);
    std::map<std::string, std::string> splits = splits_of(file);
    const bool is_split = split.empty() && !splits.empty();
    std::set<std::string> is_found;
    size_t without_split = 0;
    UnknownKeys unknown(&set_);
    unknown.look(root_, kKeys, "the file");
    for (size_t i = 0; i < frames.size(); ++i) {
      const CameraPlace place{path_, "camera " + std::to_string(i)};
      Camera camera = read_frame(place, frames[i]);
      camera.id = static_cast<int>(i);
      camera.split = split;
      if (is_split) {
        const auto listed = splits.find(in_folder(text_or(place, frames[i], "file_path", "")));
        if (listed == splits.end()) {
          without_split += root_.contains("train_filenames") ? 1U : 0U;
        } else {
          camera.split = listed->second;
          is_found.insert(listed->first);
        }
      }
      unknown.look(frames[i], kKeys, place.camera);
      set_.cameras.push_back(std::move(camera));
    }
    std::vector<std::string> lost;
    for (const auto& [name, of] : splits) {
      if (is_split && is_found.count(name) == 0) lost.push_back(name);
    }
    if (!lost.empty()) {
      set_.notes.push_back("Images that are listed for training or tests and that no frame has: " +
                           list_of_names(lost) + ".");
    }
    if (without_split > 0) {
      set_.notes.push_back("Frames that no list of images for training or tests has: " +
                           std::to_string(without_split) + ".");
    }
    finish(file);
    return std::move(set_);
  }

 private:
  static std::string in_folder(const std::string& path) {
    return path.compare(0, 2, "./") == 0 ? path.substr(2) : path;
  }

  // By the names of images, as nerfstudio lists them.
  std::map<std::string, std::string> splits_of(const CameraPlace& file) const {
    std::map<std::string, std::string> splits;
    for (const char* split : {"train", "val", "test"}) {
      const std::string key = std::string(split) + "_filenames";
      if (!root_.contains(key)) continue;
      if (!root_.at(key).is_array()) file.fail(key + " is not a list");
      for (const Json& name : root_.at(key)) {
        if (!name.is_string()) file.fail(key + " has what is no text");
        splits[in_folder(name.get<std::string>())] = split;
      }
    }
    return splits;
  }

  Camera read_frame(const CameraPlace& place, const Json& frame) {
    if (!frame.is_object()) place.fail("not an object");
    Camera out;
    const std::string image = text_or(place, frame, "file_path", "");
    const bool leaves = leaves_folder(image);
    out.image = image_of(path_, image, any_path_ || !leaves);
    if (leaves) out.outside = out.image;
    const std::string mask = text_or(place, frame, "mask_path", "");
    out.mask = beside(path_, mask);
    if (out.outside.empty() && leaves_folder(mask)) out.outside = out.mask;
    if (frame.contains("time")) {
      out.time = number(place, frame, "time");
      if (!(*out.time >= 0 && *out.time <= kMaxTime)) place.fail("time is not from 0 to 1e9");
      ++with_time_;
    }

    l4d_camera& camera = out.camera = default_camera();
    set_size(place, frame, out, camera);
    const auto fx = focal_length(place, frame, root_, "fl_x", "camera_angle_x", camera.width);
    if (!fx) place.fail("neither fl_x nor camera_angle_x is there");
    const auto fy = focal_length(place, frame, root_, "fl_y", "camera_angle_y", camera.height);
    camera.fx = *fx;
    camera.fy = fy.value_or(*fx);
    const double width = static_cast<double>(camera.width);
    const double height = static_cast<double>(camera.height);
    camera.cx = number_or(place, owner_of(frame, root_, "cx"), "cx", width / 2);
    camera.cy = number_or(place, owner_of(frame, root_, "cy"), "cy", height / 2);
    compare_angles(frame, camera);
    out.distortion = distortion_of(place, frame);
    double c2w[16];
    matrix(place, frame, "transform_matrix", 4, 4, c2w);
    set_opengl_pose(place, "transform_matrix", c2w, camera);
    check_camera(place, out);
    return out;
  }

  // What states a focal length in pixels and as an angle states it twice; pixels are taken.
  void compare_angles(const Json& frame, const l4d_camera& camera) {
    const auto differs = [&](const char* focal_key, const char* angle_key, double focal,
                             uint32_t size) {
      const Json& angle = owner_of(frame, root_, angle_key);
      if (!owner_of(frame, root_, focal_key).contains(focal_key) || !angle.contains(angle_key) ||
          !angle.at(angle_key).is_number()) {
        return false;
      }
      const double tangent = std::tan(0.5 * angle.at(angle_key).get<double>());
      return !(std::abs(focal * tangent / (0.5 * static_cast<double>(size)) - 1) <= 0.01);
    };
    if (differs("fl_x", "camera_angle_x", camera.fx, camera.width) ||
        differs("fl_y", "camera_angle_y", camera.fy, camera.height)) {
      ++with_other_angle_;
    }
  }

  // Refuses what is no lens that is known, and what flags of other programs say of one.
  Lens lens_of(const CameraPlace& place, const Json& frame) const {
    for (const char* key : {"latlong", "equirectangular", "orthographic", "ftheta_p0"}) {
      const Json& owner = owner_of(frame, root_, key);
      if (!owner.contains(key) || owner.at(key) == false) continue;
      place.fail(L4D_ERR_FEATURE_UNSUPPORTED, std::string(key) + ": cameras here are pinholes");
    }
    const std::string model =
        text_or(place, owner_of(frame, root_, "camera_model"), "camera_model", "");
    const auto known = std::find_if(std::begin(kModels), std::end(kModels),
                                    [&](const Model& m) { return model == m.name; });
    if (known == std::end(kModels)) {
      place.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                 "the camera_model " + Json(model.substr(0, 40)).dump() +
                     ": cameras here are pinholes, with distortions of "
                     "OPENCV, FULL_OPENCV or OPENCV_FISHEYE");
    }
    const Json& owner = owner_of(frame, root_, "is_fisheye");
    if (!owner.contains("is_fisheye") || owner.at("is_fisheye") == false) return known->lens;
    if (known->lens != Lens::kFisheye && !model.empty()) {
      place.fail("is_fisheye, but the camera_model is " + model);
    }
    return Lens::kFisheye;
  }

  Distortion distortion_of(const CameraPlace& place, const Json& frame) const {
    const Lens lens = lens_of(place, frame);
    Distortion out;
    bool any = false;
    const auto read = [&](const char* key, double* to) {
      *to = number_or(place, owner_of(frame, root_, key), key, 0);
      any |= *to != 0;
    };
    static constexpr const char* kNames[] = {"k1", "k2", "k3", "k4", "k5", "k6"};
    for (size_t k = 0; k < 6; ++k) read(kNames[k], &out.k[k]);
    read("p1", &out.p[0]);
    read("p2", &out.p[1]);
    // nerfstudio's own order of the same.
    const Json& owner = owner_of(frame, root_, "distortion_params");
    if (owner.contains("distortion_params")) {
      const Json& list = owner.at("distortion_params");
      double* const places[] = {&out.k[0], &out.k[1], &out.k[2], &out.k[3], &out.p[0], &out.p[1]};
      if (!list.is_array() || list.size() != std::size(places)) {
        place.fail("distortion_params is not a list of 6 numbers");
      }
      for (size_t k = 0; k < std::size(places); ++k) {
        *places[k] = finite_number(place, list[k], "distortion_params");
        any |= *places[k] != 0;
      }
    }
    const bool is_rational = lens == Lens::kRational || out.k[4] != 0 || out.k[5] != 0;
    if (lens == Lens::kFisheye) {
      out.model = Distortion::Model::kFisheye;
      if (out.k[4] != 0 || out.k[5] != 0 || out.p[0] != 0 || out.p[1] != 0) {
        place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "a fisheye lens with k5, k6, p1 or p2");
      }
    } else if (any) {
      out.model = Distortion::Model::kRadial;
      // One program means the factor of r^8 by it, another that of r^2 in the denominator.
      if (out.k[3] != 0 && !is_rational) {
        place.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                   "k4 without k5 and k6, and the camera_model is not FULL_OPENCV: which of two "
                   "meanings it has is not stated");
      }
    }
    return out;
  }

  void set_size(const CameraPlace& place, const Json& frame, const Camera& seen,
                l4d_camera& camera) {
    const Json& owner = owner_of(frame, root_, "w");
    if (owner.contains("w")) {
      camera.width = whole_number(place, owner, "w", kMaxImageSize);
      camera.height = whole_number(place, owner_of(frame, root_, "h"), "h", kMaxImageSize);
      return;
    }
    uint32_t size[2] = {kBlenderSize, kBlenderSize};
    if (!seen.outside.empty() && !any_path_) {
      place.fail(L4D_ERR_INVALID_ARGUMENT, "only " + seen.image +
                                               " tells the size, which is not in the folder of the "
                                               "file, and is read only where any path may be");
    }
    if (!image_size(seen.image, size)) {
      if (owner_of(frame, root_, "fl_x").contains("fl_x")) {
        place.fail(
            "the focal length is in pixels, and neither w and h nor an image tells how many "
            "there are");
      }
      ++without_size_;
    }
    camera.width = size[0];
    camera.height = size[1];
  }

  // nerfstudio's points, which are in the coordinates of the poses.
  void find_points(const CameraPlace& file) {
    const std::string name = text_or(file, root_, "ply_file_path", "");
    const std::string points = beside(path_, name);
    if (points.empty()) return;
    std::error_code error;
    const bool may_be_read = any_path_ || !leaves_folder(name);
    if (may_be_read && fs::is_regular_file(points, error)) {
      set_.points = points;
    } else {
      set_.notes.push_back("The points " + name + " are " +
                           (may_be_read ? "not there." : "outside the folder, and not read."));
    }
  }

  void finish(const CameraPlace& file) {
    if (without_size_ > 0) {
      set_.notes.push_back("Neither the file nor an image tells the size of " +
                           std::to_string(without_size_) +
                           " cameras; they are taken to have 800 x 800 pixels.");
    }
    if (with_other_angle_ > 0) {
      set_.notes.push_back(
          "Cameras whose camera_angle differs from their focal length in pixels, "
          "which is taken: " +
          std::to_string(with_other_angle_) + ".");
    }
    for (const char* key : {"applied_transform", "applied_scale"}) {
      if (!root_.contains(key)) continue;
      set_.notes.push_back(std::string(key) +
                           " is in the poses already; scenes and points of the same capture that "
                           "it was not applied to do not fit them.");
    }
    find_points(file);
    if (with_time_ == 0) {
      set_.frames = 1;  // a scene at rest
      return;
    }
    if (with_time_ != set_.cameras.size()) file.fail("either all cameras or none must have a time");
  }

  std::string path_;
  const Json& root_;
  bool any_path_;
  CameraSet set_;
  size_t without_size_ = 0, with_time_ = 0, with_other_angle_ = 0;
};

}  // namespace

CameraSet read_transforms(const std::string& path, const Json& root, bool any_path) {
  return TransformsReader(path, root, any_path).read();
}

}  // namespace l4d::io
