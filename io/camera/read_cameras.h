// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <unordered_set>

#include "io/camera/cameras.h"
#include "io/file/file.h"

namespace l4d::io {

// The readers read_cameras() chooses between. Those of JSON may let its exceptions pass.
CameraSet read_cameras_json(const std::string& path, const nlohmann::json& root);
CameraSet read_transforms(const std::string& path, const nlohmann::json& root, bool any_path);
CameraSet read_3dgs_cameras(const std::string& path, const nlohmann::json& root);
CameraSet read_camera_path(const std::string& path, const nlohmann::json& root);
CameraSet read_poses_bounds(InputFile& file, const Hold& holder);

// ---- what they share ----

// A place in a file of cameras: who fails names it.
struct CameraPlace {
  std::string path;
  std::string camera;  // "camera 3"; "" = the file as a whole

  [[noreturn]] void fail(l4d_status status, const std::string& what) const;
  [[noreturn]] void fail(const std::string& what) const { fail(L4D_ERR_CORRUPT, what); }
};

// Reads a file of JSON; what is wrong with it is CORRUPT. of_object: bytes that the caller makes of
// each object; memory: counts them and those of the result.
nlohmann::json read_json_file(InputFile& file, const Hold& holder, uint64_t of_object,
                              std::shared_ptr<void>* memory);

// A number in a message, with six digits.
std::string decimal(double value);

// Members of a JSON object. Numbers are finite; all but the optional ones must be there.
const nlohmann::json& member(const CameraPlace& place, const nlohmann::json& object,
                             const char* key);
double number(const CameraPlace& place, const nlohmann::json& object, const char* key);
double finite_number(const CameraPlace& place, const nlohmann::json& value, const char* key);
double number_or(const CameraPlace& place, const nlohmann::json& object, const char* key,
                 double fallback);
uint32_t whole_number(const CameraPlace& place, const nlohmann::json& object, const char* key,
                      uint32_t max);
std::string text_or(const CameraPlace& place, const nlohmann::json& object, const char* key,
                    const std::string& fallback);
// An array of `count` numbers.
void numbers(const CameraPlace& place, const nlohmann::json& object, const char* key, size_t count,
             double* out);
// An array of `rows` arrays of `columns` numbers, into row-major `out`.
void matrix(const CameraPlace& place, const nlohmann::json& object, const char* key, size_t rows,
            size_t columns, double* out);

// The id of a camera, by which the place is named from then on. ids: those of the cameras before
// it, none of which it may have.
int take_id(CameraPlace& place, const nlohmann::json& object, std::unordered_set<int>* ids);

// All of l4d_camera but the numbers of the model.
l4d_camera default_camera();
// World to camera from axes and centre of the camera: columns x right, y down, z forward of
// `axes`, [3, 3] row-major.
void set_pose(l4d_camera& camera, const double* axes, const double* center);
// The same from `key`: camera to world, [4, 4] row-major, with x right, y up, z back as OpenGL has
// them.
void set_opengl_pose(const CameraPlace& place, const char* key, const double* c2w,
                     l4d_camera& camera);
void check_last_row(const CameraPlace& place, const char* key, const double* row);
// Throws unless all numbers are finite and in the ranges of read_cameras(), and the rotation is
// one.
void check_camera(const CameraPlace& place, const Camera& camera);

// `name` relative to the folder of the file; "" stays "".
std::string beside(const std::string& path, const std::string& name);
// Whether `name` leads out of that folder. Symbolic links in it are those of its owner.
bool leaves_folder(const std::string& name);

constexpr uint32_t kMaxImageSize = L4D_MAX_IMAGE_SIDE;
constexpr double kMaxFps = 1e6;

}  // namespace l4d::io
