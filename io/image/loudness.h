// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace l4d::io {

// How loud the sound of a video is, `rate` values a second from the time 0 of the file on, of its
// first hour; nothing where it has no sound. Throws Error(L4D_ERR_IO) where ffmpeg is missing or
// fails.
std::vector<double> read_loudness(const std::string& path, double rate);

}  // namespace l4d::io
