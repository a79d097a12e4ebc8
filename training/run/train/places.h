// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "training/run/train/evaluate.h"

// Whether cameras are where the capture says, as long as a training has not bent the scene to them.
namespace l4d::train {

// Training cameras whose image is that of the scene moved by half a degree or more, and by several
// times as much as others: one sentence each, by camera. Looks at the first image of each of at
// most 100 cameras. It does not find a camera that is turned about its own axis, nor one whose
// image shows little. cancelled: may be null. Throws io::Error where an image cannot be read.
std::map<uint32_t, std::string> notes_of_places(const Capture& capture, const ImageLoader& loader,
                                                uint32_t threads, const Colour& background,
                                                const RenderView& render,
                                                const IsCancelled& cancelled);

}  // namespace l4d::train
