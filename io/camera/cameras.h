// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "l4d/render.h"

namespace l4d::io {

// How the lens of a camera departs from a pinhole. OpenCV's models: with (x, y) of the pinhole at
// depth 1 and r^2 = x^2 + y^2,
//   kRadial:  x' = x d + 2 p1 x y + p2 (r^2 + 2 x^2),  y' = y d + p1 (r^2 + 2 y^2) + 2 p2 x y,
//             d = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
//   kFisheye: (x', y') = (x, y) theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) / r,
//             theta = atan(r)
struct Distortion {
  enum class Model { kNone, kRadial, kFisheye };
  Model model = Model::kNone;
  double k[6] = {0, 0, 0, 0, 0, 0};  // k1 to k6
  double p[2] = {0, 0};              // p1, p2
};

bool same_lens(const Distortion& a, const Distortion& b);

struct Camera {
  l4d_camera camera{};
  Distortion distortion;  // of what the camera saw; renderings have none
  // Seconds by which a frame was taken later than its number says.
  double time_offset = 0;
  int id = 0;         // unique in its set
  std::string split;  // "train", "test", "val" or "": the file says nothing
  // What the camera saw; paths relative to the file are resolved, and need not exist.
  std::string video;  // all frames; "" = none
  std::string image;  // the one frame of a camera that exists for an instant; "" = none
  // All frames as image files: a path with one %d, %04d or the like for the number; "" = none.
  std::string images;
  uint32_t first_image = 0;  // the number of the first of them
  std::string mask;  // an image that is black where pixels of the camera do not count; "" = none
  // The first of these that the file names by an absolute path, or by one that leaves its folder;
  // "" = none.
  std::string outside;
  // The instant, if the camera has one, in units of CameraSet::seconds since the begin.
  std::optional<double> time;
};

struct CameraSet {
  std::vector<Camera> cameras;
  double fps = 0;       // 0 = unknown
  uint32_t frames = 0;  // 0 = unknown
  // Whether what lies outside the folder of the file may be read.
  bool any_path = false;
  // Counts what is read of these cameras: the set itself (`memory`), and their images.
  Hold holder;
  std::shared_ptr<void> memory;
  // Bytes of their images that should be in memory together at most; 0 = no limit.
  uint64_t image_memory = 0;
  // What 1 in the times of cameras stands for. D-NeRF does not say; the caller must.
  double seconds = 1;
  std::string points;              // a PLY of points of the scene; "" = none
  std::string source;              // "cameras_json", "transforms", "poses_bounds", "orbit"
  std::vector<std::string> notes;  // assumptions made, one sentence each, for people
};

// What read_cameras() reads, for help texts.
inline constexpr const char* kCameraFiles =
    "cameras.json, transforms*.json (Blender, D-NeRF, nerfstudio, instant-ngp), poses_bounds.npy, "
    "the exported path of nerfstudio's viewer, or the folder of a COLMAP model";

// Reads cameras.json (K and w2c per camera), transforms*.json of Blender, D-NeRF and their kin,
// poses_bounds.npy of LLFF, a camera path of nerfstudio, or the folder of a COLMAP model, told
// apart by what they hold. Throws Error that names path and camera:
// L4D_ERR_IO, L4D_ERR_CORRUPT, L4D_ERR_FEATURE_UNSUPPORTED. A file may come from anywhere: images
// that it names outside its folder are not opened to learn their size unless any_path is set
// (L4D_ERR_INVALID_ARGUMENT). Numbers are finite and in these ranges, else the file is CORRUPT:
// focal lengths 0.001 to 1e8 pixels, principal points up to 1e8 pixels from the corner,
// translations up to 1e9, near above 0 and up to 1e9, time offsets up to 1e6 s, coefficients of
// distortion up to 1e6, fps up to 1e6. holder: counts the file and what becomes of it before it is
// parsed; the set keeps it.
CameraSet read_cameras(const std::string& path, bool any_path = false, const Hold& holder = {});

// What both tools hold to before they open what a camera names. Throws L4D_ERR_INVALID_ARGUMENT
// unless all of it lies in the folder of the file or below, or the set allows any path.
void require_inside(const CameraSet& set, const Camera& camera);

// The notes of a set for who takes its cameras for pinholes, as renderers do: with how many have a
// distortion, which is then left out.
std::vector<std::string> notes_of_pinholes(const CameraSet& set);

// What the camera saw, for people: its video, the pattern of its images, or its image.
const std::string& seen_by(const Camera& camera);

// Whether the path has %d or %04d for a number.
bool is_image_pattern(const std::string& pattern);
// Whether a file in the folder of the pattern has a name that some frame has.
bool is_numbered_image(const std::string& pattern, const std::string& name);
// The image of frame `frame` of a camera. Throws L4D_ERR_CORRUPT if its `images` has no %d or %04d.
std::string numbered_image(const Camera& camera, uint32_t frame);
// Some programs number images from 1: so they are where no camera has an image 0 and each that has
// images has an image 1. Sets first_image, and adds a note.
void find_first_images(CameraSet* set);

// Cameras around a scene that has none: on one ring at the height of the centre, or from 12 cameras
// on also on rings 30 degrees below and above. They look at the whole subject of the scene
// (io/camera/subject.h) with a field of view of 60 degrees in the smaller direction, from where its
// ball fits. The rings' axis is that of the subject. A scene that states a view from within that
// ball is a place: its first camera stands where this view does, or nearer to the middle; the
// others go around the middle at the same height, or 10 degrees below and above, and keep within
// the walls.
CameraSet orbit_cameras(const Scene& scene, uint32_t count, uint32_t width, uint32_t height,
                        const Hold& holder = {});

struct ViewSelection {
  std::string split = "all";  // train, test, val, all
  std::string ids;            // "0,10,15", "0-3"; "" = all
  std::string frames;         // "7", "first:end", "first:end:step", end exclusive; "" = all
};

struct View {
  size_t camera = 0;  // index into CameraSet::cameras
  double time = 0;    // seconds, of the timeline
  uint32_t frame = 0;
};

// Views by frame, then by time, then by camera: all cameras of an instant follow each other. Frame
// k is at time_begin + k / fps with the cameras' frame rate, else the timeline's; there are as many
// as both the cameras and the timeline have. A camera that has a time gives one view there, or at
// the end of the timeline if that is earlier, and counts as being of the frame nearest to it.
// Throws Error(L4D_ERR_INVALID_ARGUMENT) on an invalid text, and if nothing is selected.
std::vector<View> select_views(const CameraSet& set, const ViewSelection& selection,
                               const l4d_timeline& timeline);

}  // namespace l4d::io
