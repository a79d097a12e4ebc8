// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "eval/image/lpips.h"
#include "training/capture/capture.h"
#include "training/run/setup/run_options.h"
#include "training/run/setup/settings.h"

// What a training holds in memory, worked out before it allocates any of it.
namespace l4d::train {

// Bytes. Each is an upper bound of what that part holds at a time.
struct MemoryNeed {
  uint64_t images = 0;        // for training: all of them, or as many as Settings::host_memory
  uint64_t least_images = 0;  // with which a training can begin
  uint64_t decoding = 0;      // of image files on their way, a part of `reading`
  uint64_t reading = 0;       // of images on their way, and those that are scored now and then
  uint64_t capture = 0;       // its views and points
  uint64_t model = 0;         // Gaussians, moments, derivatives, and their copies for checkpoints
  uint64_t rendering = 0;
  uint64_t scoring = 0;
  uint64_t total() const { return images + reading + capture + model + rendering + scoring; }
};

// settings: resolved. lpips: may be null; lpips_bytes: of its file.
MemoryNeed memory_need(const Settings& settings, const Capture& capture, uint32_t threads,
                       const eval::Lpips* lpips, uint64_t lpips_bytes);

// The bytes that reading through a cache of frames takes besides.
uint64_t cache_need(const Settings& settings, const Capture& capture, uint32_t threads);

// Bytes that the parts of a run get.
struct MemoryShares {
  uint64_t images = 0;    // for training, at most
  uint64_t renderer = 0;  // of each view of a step, at most; 0 = no limit
  uint64_t training = 0;  // what RunOptions::limit_memory has for it in all; 0 = no limit
};

// What options.limit_memory leaves to each part; a run that goes on keeps its images, which decide
// its bits. lpips: may be null; lpips_bytes: of its file. held: what reading the capture has taken.
// Throws as images_within() does.
MemoryShares share_memory(const RunOptions& options, const Capture& capture,
                          const eval::Lpips* lpips, uint64_t lpips_bytes, uint64_t held);

// The bytes of images with which the need is within the limit: need.images, or fewer if
// `may_shrink`. Throws io::Error(LIMIT_EXCEEDED) that says what is needed, and for what. limit: 0 =
// none.
uint64_t images_within(uint64_t limit, const MemoryNeed& need, bool may_shrink);

// What the exception that is being handled says of too little memory. Throws it again if it is
// about anything else.
std::string lack_of_memory();

}  // namespace l4d::train
