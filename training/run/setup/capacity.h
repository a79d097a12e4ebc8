// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "training/images/loader.h"
#include "training/run/setup/settings.h"
#include "training/step/backend.h"

namespace l4d::train {

// Throws io::Error(INVALID_ARGUMENT) if --scale makes images too small. Those that were small
// before are as the user has them.
void check_scale(double scale, const Capture& capture, const ImageLoader& loader);

// Of the largest images.
StepSize step_size(const Settings& settings, const Capture& capture, const ImageLoader& loader);

// Settles how many Gaussians are in the back end at a time, and with which Adam: all of them, if
// they fit in --device-memory, or without it in half of what a device has free. Else `resident` is
// less than `gaussians`, and Adam is sparse. settings: resolved but for that. Appends to `notes`
// what a user should know. Throws io::Error: LIMIT_EXCEEDED if the memory is too small for a step,
// and INVALID_ARGUMENT for options that need the whole model in the back end.
void settle_capacity(Settings* settings, const BackendCost& cost, std::vector<std::string>* notes);

}  // namespace l4d::train
