// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "io/camera/read_cameras.h"
#include "io/image/image.h"

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

// The path of an image; the format leaves out the extension of most.
std::string image_of(const std::string& path, const std::string& name) {
  std::string image = beside(path, name);
  if (image.empty() || fs::path(image).has_extension()) return image;
  return image + ".png";
}

// Width and height of a PNG; false where there is none.
bool read_size(const std::string& path, uint32_t* size) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return false;
  uint8_t begin[kPngSizeBytes];
  InputFile file(path);
  return file.read(begin, sizeof(begin)) == sizeof(begin) && png_size(begin, size);
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

// The matrix is camera to world with x right, y up, z back.
void set_opengl_pose(const CameraPlace& place, const Json& frame, l4d_camera& camera) {
  double c2w[16];
  matrix(place, frame, "transform_matrix", 4, 4, c2w);
  check_last_row(place, "transform_matrix", c2w + 12);
  double axes[9], center[3];
  for (size_t r = 0; r < 3; ++r) {
    axes[3 * r] = c2w[4 * r];
    axes[3 * r + 1] = -c2w[4 * r + 1];
    axes[3 * r + 2] = -c2w[4 * r + 2];
    center[r] = c2w[4 * r + 3];
  }
  set_pose(camera, axes, center);
}

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
    for (size_t i = 0; i < frames.size(); ++i) {
      const CameraPlace place{path_, "camera " + std::to_string(i)};
      Camera camera = read_frame(place, frames[i]);
      camera.id = static_cast<int>(i);
      camera.split = split;
      set_.cameras.push_back(std::move(camera));
    }
    finish(file);
    return std::move(set_);
  }

 private:
  Camera read_frame(const CameraPlace& place, const Json& frame) {
    if (!frame.is_object()) place.fail("not an object");
    Camera out;
    const std::string image = text_or(place, frame, "file_path", "");
    out.image = image_of(path_, image);
    if (leaves_folder(image)) out.outside = out.image;
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
    out.distortion = distortion_of(place, frame);
    distorted_ |= out.distortion.model != Distortion::Model::kNone;
    set_opengl_pose(place, frame, camera);
    check_camera(place, out);
    return out;
  }

  Distortion distortion_of(const CameraPlace& place, const Json& frame) const {
    Distortion lens;
    bool any = false;
    const auto read = [&](const char* key, double* to) {
      *to = number_or(place, owner_of(frame, root_, key), key, 0);
      any |= *to != 0;
    };
    read("k1", &lens.k[0]);
    read("k2", &lens.k[1]);
    read("k3", &lens.k[2]);
    read("k4", &lens.k[3]);
    read("p1", &lens.p[0]);
    read("p2", &lens.p[1]);
    const std::string model =
        text_or(place, owner_of(frame, root_, "camera_model"), "camera_model", "OPENCV");
    if (any) {
      lens.model =
          model == "OPENCV_FISHEYE" ? Distortion::Model::kFisheye : Distortion::Model::kRadial;
    }
    return lens;
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
    if (!read_size(seen.image, size)) ++without_size_;
    camera.width = size[0];
    camera.height = size[1];
  }

  void finish(const CameraPlace& file) {
    if (without_size_ > 0) {
      set_.notes.push_back("Neither the file nor an image tells the size of " +
                           std::to_string(without_size_) +
                           " cameras; they are taken to have 800 x 800 pixels.");
    }
    if (distorted_) {
      set_.notes.push_back(
          "The lens distortion that the file gives is left out; images must be undistorted.");
    }
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
  size_t without_size_ = 0, with_time_ = 0;
  bool distorted_ = false;
};

}  // namespace

CameraSet read_transforms(const std::string& path, const Json& root, bool any_path) {
  return TransformsReader(path, root, any_path).read();
}

}  // namespace l4d::io
