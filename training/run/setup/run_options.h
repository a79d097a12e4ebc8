// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "training/images/pixels.h"
#include "training/run/setup/settings.h"

namespace l4d::train {

// What a run is asked to do.
struct RunOptions {
  Settings settings;
  std::string folder;
  std::string preset;             // of the encoder; "" = no stream
  double bitrate = 0;             // bytes per second, in place of Settings::size; 0 = none
  std::string lpips;              // file of weights, to report LPIPS; "" = it is not reported
  bool jod = false;               // the last scores have JOD, too
  uint32_t scored_instants = 15;  // at the end, at most, of each split; 0 = all
  Colour background{};            // behind renders and images with alpha that are compared
  std::string cache;              // folder of FrameCache; "" = none
  uint64_t cache_bytes = uint64_t{64} << 30;  // at most
  bool resume = false;
  bool accept_changes = false;    // resumes also where the capture is not as it was
  bool force = false;             // replaces a run that is there
  uint64_t limit_memory = 0;      // bytes of the whole process; 0 = none. See training/README.md
  bool may_shrink_images = true;  // to keep to it, Settings::host_memory may become less
  uint32_t threads = 0;
  // Bytes of Gaussians that are away from the back end; more are in files of the folder.
  uint64_t bucket_memory = uint64_t{8} << 30;
  double checkpoint_seconds = 300;
  double preview_seconds = 10;
  bool watch = false;  // previews are streams, too
};

}  // namespace l4d::train
