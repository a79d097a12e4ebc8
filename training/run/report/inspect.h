// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "training/capture/capture.h"

namespace l4d::train {

// What a capture is: for people, and a contact sheet of the first images of all cameras.
struct Inspection {
  std::string text;
  std::string json;
};
// sheet: a PNG to write, or "". cache: the folder of --cache, or "".
Inspection inspect(const std::string& path, const CaptureOptions& options, const std::string& sheet,
                   const std::string& cache, uint32_t threads);

}  // namespace l4d::train
