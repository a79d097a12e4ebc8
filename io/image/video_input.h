// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace l4d::io {

// How ffmpeg opens a video for reading, whatever its name is. It decodes no frame that is larger
// than width x height by more than coders pad; 0 = of any size.
std::vector<std::string> input_of(const std::string& path, uint32_t width, uint32_t height);

}  // namespace l4d::io
