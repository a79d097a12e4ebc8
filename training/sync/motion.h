// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

#include "training/capture/capture.h"
#include "training/sync/align.h"

namespace l4d::train {

// How much each camera saw change from frame to frame, at the capture's frame rate, by the times of
// its views. Empty for cameras of less than three views. Throws io::Error that names camera and
// frame; CANCELLED where `cancelled` returns true.
std::vector<Signal> motion_of(const Capture& capture, uint32_t threads,
                              const std::function<bool()>& cancelled);

// Values at `rate` a second from 0 s on, between those at some times, which rise.
Signal resampled(const std::vector<double>& times, const std::vector<double>& values, double rate);

}  // namespace l4d::train
