// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "training/capture/capture.h"
#include "training/sync/align.h"

// Clocks of cameras that recorded by themselves, as phones do.
namespace l4d::train {

struct CameraClock {
  std::string name;
  double given = 0;     // s: its time_offset in the capture
  Offset found;         // beyond that
  bool is_off = false;  // surely, and by more than the method tells
};

struct ClockReport {
  std::string by;  // "sound" or "motion"
  std::vector<CameraClock> cameras;
  std::string text() const;
  std::string json() const;
};

// Compares the clocks of all cameras: by what they heard, where all heard something, and else by
// what they saw move. most: s, that two of them are apart. Throws io::Error as reading images does.
ClockReport find_clocks(const Capture& capture, double most, uint32_t threads,
                        const std::function<bool()>& cancelled = nullptr);

// Writes the cameras of a capture as cameras.json, with the offsets of clocks that are off. Throws
// io::Error: FEATURE_UNSUPPORTED where images have cameras of their own.
void write_synchronised(const std::string& path, const Capture& capture, const ClockReport& clocks);

}  // namespace l4d::train
