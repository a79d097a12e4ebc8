// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "io/camera/cameras.h"
#include "training/capture/camera_change.h"

// Captures of a scene: cameras that saw it, and where their images are. Every layout is read into
// one form, in the coordinates of the capture.
namespace l4d::train {

struct CaptureCamera {
  io::Camera source;    // the camera as it took the images, and where they are
  std::string name;     // for people
  std::string split;    // "train" or "test"
  uint32_t frames = 0;  // of its video or its numbered images
  double fps = 0;       // of its video; 0 = unknown
  // [frames] s after the first frame of its video; empty for images, and where the file says none.
  std::vector<double> times;
  // Those count: they are not the times of a steady rate, or not of that of the sequence.
  bool is_uneven = false;
  CameraChange change{};  // that a training has found; ImageLoader::renew_cameras() follows it
  bool is_video() const { return !source.video.empty(); }
};

// An image of a camera. Its time is its own: offsets of cameras may be parts of a frame.
struct CaptureView {
  uint32_t camera = 0;  // index
  uint32_t frame = 0;   // of the camera's video
  double time = 0;      // s
  std::string file;     // empty: frame `frame` of the camera's video
};

struct Point {
  float position[3];
  float rgb[3];    // [0, 1]
  float time = 0;  // s
  bool has_time = false;
};

struct Capture {
  std::string layout;  // "cameras", "n3dv", "dnerf", and so on, as training/README.md lists them
  std::string path;
  double fps = 0;
  uint32_t frames = 0;  // of the sequence, which begins at 0 s
  std::vector<CaptureCamera> cameras;
  std::vector<CaptureView> views;  // by time, then by camera
  std::vector<Point> points;       // that the capture comes with
  std::string points_file;         // or where they are; "" = none
  std::vector<std::string> notes;  // assumptions, one sentence each
  io::Hold holder;                 // counts its images while they are read
  std::shared_ptr<void> memory;    // counts its views and points

  double duration() const { return static_cast<double>(frames) / fps; }
  l4d_timeline timeline() const;
  // When a view was taken, with the change of its camera: s, in the sequence.
  double time_of(uint32_t view) const;
};

struct CaptureOptions {
  double seconds = 1;     // D-NeRF, HyperNeRF: what 1 in times of their files stands for
  double fps = 0;         // 0 = what the capture says
  std::string frames;     // "a:b:step", end exclusive; "" = all
  std::string test;       // ids of cameras: "0,10,15", "0-3"; "" = those that the layout names
  bool tolerant = false;  // leave out what is missing or damaged, cut all to the shortest
  bool any_path = false;  // read what lies outside the folder of the file that names it
  io::Hold holder;        // counts what reading takes, and the capture
};

// Throws io::Error(INVALID_ARGUMENT) where options are wrong whatever the capture.
void check(const CaptureOptions& options);

// Reads a folder, or the file that describes a capture. Throws io::Error: IO if images are missing,
// CORRUPT if cameras or sizes are wrong, FEATURE_UNSUPPORTED for lenses and files that are not
// known, INVALID_ARGUMENT if options select nothing. It names the camera and the frame.
Capture read_capture(const std::string& path, const CaptureOptions& options);

// The cameras with their changes, for cameras.json. Throws FEATURE_UNSUPPORTED where images have
// cameras of their own.
io::CameraSet camera_set(const Capture& capture);

// Where the cameras are. Radius: the largest distance of a camera from their mean; of cameras that
// are all in one place, 1.
struct CaptureFrame {
  double center[3];
  double radius;
};
CaptureFrame frame_of(const Capture& capture);
// Throws FEATURE_UNSUPPORTED where cameras are so far from the origin that positions in float32
// tell no places among them apart; notes where they are coarse.
void check_place(Capture* capture);
// Whether the axes of nearly all training cameras pass near one point that is in front of them, by
// half the radius or more.
bool look_at_one_place(const Capture& capture);
// Position of a camera in the world.
void camera_center(const l4d_camera& camera, double* out /* [3] */);

// ---- readers of layouts, which read_capture() chooses between ----

Capture read_cameras_capture(const std::string& file, const CaptureOptions& options);
Capture read_n3dv_capture(const std::string& file, const CaptureOptions& options);
Capture read_dnerf_capture(const std::string& folder, const CaptureOptions& options);
Capture read_hypernerf_capture(const std::string& folder, const CaptureOptions& options);
Capture read_selfcap_capture(const std::string& folder, const CaptureOptions& options);
Capture read_colmap_capture(const std::string& folder, const CaptureOptions& options);
Capture read_dynamic3dgs_capture(const std::string& folder, const CaptureOptions& options);
Capture read_panoptic_capture(const std::string& file, const CaptureOptions& options);
Capture read_toml_capture(const std::string& file, const CaptureOptions& options);
// Whether it may be one: other files of TOML say what programs are to do.
bool is_toml_calibration(const std::string& path, const io::Hold& holder);

}  // namespace l4d::train
