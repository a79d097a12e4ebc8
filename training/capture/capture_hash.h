// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "training/capture/capture.h"

namespace l4d::train {

// What a capture is, in 16 digits: its timeline, its cameras, its points, and of each of its images
// and videos the size, the first and the last bytes. It does not depend on where the capture lies,
// nor on the dates of its files.
std::string hash_of(const Capture& capture);
// The same of all bytes of its videos: a part of a video that changes changes the hash.
std::string hash_with_videos(const Capture& capture);

}  // namespace l4d::train
