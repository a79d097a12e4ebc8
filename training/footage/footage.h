// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "training/sync/sync.h"

// Videos of cameras whose places and lenses nobody knows.
namespace l4d::train {

struct FootageOptions {
  std::string lens = "SIMPLE_RADIAL";  // a model of COLMAP, one for each camera
  double max_offset = 5;               // s, that two clocks are apart
  bool tolerant = false;               // leaves out cameras that find no place
  uint32_t threads = 0;
};

// Hears of each step, for people.
using FootageStep = std::function<void(const std::string& step)>;

struct FootageReport {
  size_t cameras = 0;
  double least_field = 0, largest_field = 0;  // of view of the cameras, along x, degrees
  ClockReport clocks;
  std::vector<std::string> notes;
};

// Whether it is a folder with a video.
bool is_footage(const std::string& path);

// Makes a capture of a folder of videos, a camera each, that stand still: finds the places and
// lenses of the cameras with the program colmap, by an image of each, and their clocks by sound or
// motion. The folder `out`, which is new or empty, gets cameras.json, the videos (links where the
// file system allows) and the model of COLMAP, from whose points training begins. Throws io::Error:
// IO where a program is missing, CORRUPT, which names the cameras, where some find no place.
FootageReport make_capture(const std::string& footage, const std::string& out,
                           const FootageOptions& options, const FootageStep& step,
                           const std::function<bool()>& cancelled);

}  // namespace l4d::train
