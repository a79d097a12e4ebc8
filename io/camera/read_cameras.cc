// SPDX-License-Identifier: Apache-2.0
#include "io/camera/read_cameras.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <new>
#include <nlohmann/json.hpp>

#include "io/camera/colmap.h"
#include "io/file/json_text.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

// Of the rows of a rotation: enough for matrices written with four digits.
constexpr double kRotationTolerance = 1e-3;

CameraSet read_json(InputFile& file, bool any_path, const Hold& holder) {
  const std::string& path = file.path();
  const CameraPlace place{path, ""};
  std::shared_ptr<void> memory;
  // Twice a camera, for a list that grows.
  const Json root = read_json_file(file, holder, 2 * sizeof(Camera), &memory);
  try {
    if (root.is_array()) return read_3dgs_cameras(path, root);
    if (root.is_object() && root.contains("cameras")) return read_cameras_json(path, root);
    if (root.is_object() && root.contains("camera_path")) return read_camera_path(path, root);
    if (root.is_object() && root.contains("frames")) return read_transforms(path, root, any_path);
  } catch (const Json::exception& error) {
    place.fail(error.what());
  }
  place.fail(
      "no file of cameras: it is no list, and none of `cameras`, `camera_path` and `frames` is "
      "there");
}

// The cameras of a folder: a model of COLMAP.
CameraSet read_folder(const std::string& path, const Hold& holder) {
  const std::string model = find_colmap_model(path);
  if (model.empty()) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path +
                    ": no cameras in this folder: a model of COLMAP has cameras and images as "
                    ".bin or .txt in it, in sparse/0 or in 0");
  }
  std::vector<std::string> names;
  CameraSet set = read_colmap_cameras(model, &names, holder);
  set.notes.push_back("Cameras are the images of COLMAP in the order of their names: 0 is " +
                      (names.empty() ? "none" : names.front()) + ".");
  return set;
}

}  // namespace

void CameraPlace::fail(l4d_status status, const std::string& what) const {
  throw Error(status, path + ": " + (camera.empty() ? "" : camera + ": ") + what);
}

Json read_json_file(InputFile& file, const Hold& holder, uint64_t of_object,
                    std::shared_ptr<void>* memory) {
  const std::shared_ptr<void> of_file = hold(holder, file.size(), file.path());
  std::vector<char> text(static_cast<size_t>(file.size()));
  text.resize(file.read(text.data(), text.size()));
  *memory = hold(holder, json_bytes(text.data(), text.size(), of_object), file.path());
  Json root;
  const std::string wrong = parse_json(text.data(), text.data() + text.size(), &root);
  if (!wrong.empty()) CameraPlace{file.path(), ""}.fail(wrong);
  return root;
}

std::string decimal(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.6g", value);
  return text;
}

const Json& member(const CameraPlace& place, const Json& object, const char* key) {
  if (!object.is_object()) place.fail("not an object");
  const auto found = object.find(key);
  if (found == object.end()) place.fail(std::string(key) + " is missing");
  return *found;
}

double finite_number(const CameraPlace& place, const Json& value, const char* key) {
  if (!value.is_number()) place.fail(std::string(key) + " is not a number");
  const double result = value.get<double>();
  if (!std::isfinite(result)) place.fail(std::string(key) + " is not finite");
  return result;
}

double number(const CameraPlace& place, const Json& object, const char* key) {
  return finite_number(place, member(place, object, key), key);
}

double number_or(const CameraPlace& place, const Json& object, const char* key, double fallback) {
  return object.contains(key) ? number(place, object, key) : fallback;
}

uint32_t whole_number(const CameraPlace& place, const Json& object, const char* key, uint32_t max) {
  const double value = number(place, object, key);  // sizes are written as 640.0 too
  if (!(value >= 0 && value <= static_cast<double>(max)) || value != std::floor(value)) {
    place.fail(std::string(key) + " is no whole number from 0 to " + std::to_string(max));
  }
  return static_cast<uint32_t>(value);
}

std::string text_or(const CameraPlace& place, const Json& object, const char* key,
                    const std::string& fallback) {
  if (!object.contains(key)) return fallback;
  const Json& value = object.at(key);
  if (!value.is_string()) place.fail(std::string(key) + " is not a text");
  return value.get<std::string>();
}

void numbers(const CameraPlace& place, const Json& object, const char* key, size_t count,
             double* out) {
  const Json& value = member(place, object, key);
  if (!value.is_array() || value.size() != count) {
    place.fail(std::string(key) + " is not a list of " + std::to_string(count) + " numbers");
  }
  for (size_t k = 0; k < count; ++k) out[k] = finite_number(place, value[k], key);
}

void matrix(const CameraPlace& place, const Json& object, const char* key, size_t rows,
            size_t columns, double* out) {
  const Json& value = member(place, object, key);
  const auto is_list = [](const Json& list, size_t size) {
    return list.is_array() && list.size() == size;
  };
  bool good = is_list(value, rows);
  for (size_t r = 0; good && r < rows; ++r) {
    good = is_list(value[r], columns);
    for (size_t c = 0; good && c < columns; ++c) {
      *out++ = finite_number(place, value[r][c], key);
    }
  }
  if (good) return;
  place.fail(std::string(key) + " must be a matrix of " + std::to_string(rows) + " x " +
             std::to_string(columns) + " numbers");
}

int take_id(CameraPlace& place, const Json& object, std::unordered_set<int>* ids) {
  const int id = static_cast<int>(
      whole_number(place, object, "id", static_cast<uint32_t>(std::numeric_limits<int>::max())));
  place.camera = "camera " + std::to_string(id);
  if (!ids->insert(id).second) place.fail("the id is there twice");
  return id;
}

l4d_camera default_camera() {
  l4d_camera camera{};
  camera.struct_size = sizeof(camera);
  camera.near_plane = 0.02;
  return camera;
}

void set_pose(l4d_camera& camera, const double* axes, const double* center) {
  for (size_t r = 0; r < 3; ++r) {
    double* row = camera.world_to_camera + 4 * r;
    row[3] = 0;
    for (size_t c = 0; c < 3; ++c) {
      row[c] = axes[3 * c + r];
      row[3] -= row[c] * center[c];
    }
  }
}

void set_opengl_pose(const CameraPlace& place, const char* key, const double* c2w,
                     l4d_camera& camera) {
  check_last_row(place, key, c2w + 12);
  double axes[9], center[3];
  for (size_t r = 0; r < 3; ++r) {
    axes[3 * r] = c2w[4 * r];
    axes[3 * r + 1] = -c2w[4 * r + 1];
    axes[3 * r + 2] = -c2w[4 * r + 2];
    center[r] = c2w[4 * r + 3];
  }
  set_pose(camera, axes, center);
}

void check_last_row(const CameraPlace& place, const char* key, const double* row) {
  for (size_t c = 0; c < 4; ++c) {
    if (std::abs(row[c] - (c == 3 ? 1.0 : 0.0)) <= 1e-6) continue;
    place.fail(std::string(key) + " does not end in the row 0 0 0 1");
  }
}

namespace {

// Far beyond what cameras are, and small enough that products of these numbers are finite.
constexpr double kMinFocal = 1e-3, kMaxPixels = 1e8, kMaxDistance = 1e9, kMaxCoefficient = 1e6;
constexpr double kMaxOffset = 1e6;  // s

void check_range(const CameraPlace& place, const std::string& what, double value, double most) {
  if (std::abs(value) <= most) return;
  place.fail(what + " is " + decimal(value) + "; it must be finite and from " + decimal(-most) +
             " to " + decimal(most));
}

// Some programs write both as shares of the image. As pixels they would be a corner, and a field of
// view of nearly 180 degrees.
void check_shares(const CameraPlace& place, const Camera& seen) {
  const l4d_camera& camera = seen.camera;
  if (std::min(camera.width, camera.height) < 16) return;
  if (camera.cx > 0 && camera.cx <= 1 && camera.cy > 0 && camera.cy <= 1) {
    place.fail("the principal point is (" + decimal(camera.cx) + ", " + decimal(camera.cy) +
               ") of an image of " + std::to_string(camera.width) + " x " +
               std::to_string(camera.height) + "; it is in pixels, not in shares of the image");
  }
  const bool is_pinhole = seen.distortion.model != Distortion::Model::kFisheye;
  if (is_pinhole && camera.fx < static_cast<double>(camera.width) / 200) {
    place.fail("the focal length is " + decimal(camera.fx) + " of an image that is " +
               std::to_string(camera.width) +
               " wide; it is in pixels, not in shares of the image or in millimetres");
  }
}

void check_ranges(const CameraPlace& place, const Camera& seen) {
  const l4d_camera& camera = seen.camera;
  for (const double focal : {camera.fx, camera.fy}) {
    if (focal >= kMinFocal && focal <= kMaxPixels) continue;
    place.fail("the focal length is " + decimal(focal) + "; it must be " + decimal(kMinFocal) +
               " to " + decimal(kMaxPixels) + " pixels");
  }
  check_shares(place, seen);
  check_range(place, "the principal point", camera.cx, kMaxPixels);
  check_range(place, "the principal point", camera.cy, kMaxPixels);
  for (size_t k = 3; k < 12; k += 4) {
    check_range(place, "the translation", camera.world_to_camera[k], kMaxDistance);
  }
  if (!(camera.near_plane > 0 && camera.near_plane <= kMaxDistance)) {
    place.fail("near is " + decimal(camera.near_plane) + "; it must be above 0 and at most " +
               decimal(kMaxDistance));
  }
  check_range(place, "time_offset", seen.time_offset, kMaxOffset);
  for (const double k : seen.distortion.k) check_range(place, "distortion", k, kMaxCoefficient);
  for (const double p : seen.distortion.p) check_range(place, "distortion", p, kMaxCoefficient);
}

}  // namespace

void check_camera(const CameraPlace& place, const Camera& seen) {
  const l4d_camera& camera = seen.camera;
  for (const uint32_t size : {camera.width, camera.height}) {
    if (size >= 1 && size <= kMaxImageSize) continue;
    place.fail("an image of " + std::to_string(camera.width) + " x " +
               std::to_string(camera.height) + " pixels; the limits are 1 and " +
               std::to_string(kMaxImageSize));
  }
  check_ranges(place, seen);
  const double* m = camera.world_to_camera;
  for (size_t k = 0; k < 12; ++k) {
    if (!std::isfinite(m[k])) place.fail("the pose is not finite");
  }
  double deviation = 0;
  for (size_t a = 0; a < 3; ++a) {
    for (size_t b = 0; b <= a; ++b) {
      double dot = a == b ? -1 : 0;
      for (size_t k = 0; k < 3; ++k) dot += m[4 * a + k] * m[4 * b + k];
      deviation = std::max(deviation, std::abs(dot));
    }
  }
  if (!(deviation <= kRotationTolerance)) {
    place.fail("the rotation is not orthonormal: products of its rows are off by " +
               decimal(deviation));
  }
  const double determinant = m[0] * (m[5] * m[10] - m[6] * m[9]) -
                             m[1] * (m[4] * m[10] - m[6] * m[8]) +
                             m[2] * (m[4] * m[9] - m[5] * m[8]);
  if (!(determinant > 0)) place.fail("the rotation contains a reflection: its determinant is -1");
}

std::string beside(const std::string& path, const std::string& name) {
  if (name.empty()) return name;
  return (std::filesystem::path(path).parent_path() / name).lexically_normal().string();
}

bool leaves_folder(const std::string& name) {
  const std::filesystem::path path(name);
  return path.is_absolute() || *path.lexically_normal().begin() == "..";
}

CameraSet read_cameras(const std::string& path, bool any_path, const Hold& holder) {
  try {
    std::error_code error;
    CameraSet set;
    if (std::filesystem::is_directory(path, error)) {
      set = read_folder(path, holder);
    } else {
      InputFile file(path, holder);
      if (file.size() == 0) CameraPlace{path, ""}.fail("the file is empty");
      // What is left of an .npy file without its magic is an error of that format.
      const std::string extension = std::filesystem::path(path).extension().string();
      set =
          extension == ".npy" ? read_poses_bounds(file, holder) : read_json(file, any_path, holder);
    }
    set.any_path = any_path;
    set.holder = holder;
    set.memory = hold(holder, 2 * sizeof(Camera) * set.cameras.size(), path);
    if (set.cameras.empty()) CameraPlace{path, ""}.fail("there is no camera");
    find_first_images(&set);
    return set;
  } catch (const std::bad_alloc&) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, path + ": not enough memory for the cameras");
  }
}

}  // namespace l4d::io
