// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "io/camera/cameras.h"

namespace l4d::io {

// Writes the cameras as cameras.json, which read_cameras() reads back with the same bits. Paths of
// videos, images and masks become relative to the folder of the file. What cameras.json has no key
// for is left out: the instants of cameras that have one, and their single images. Throws Error if
// the file cannot be written.
void write_cameras(const std::string& path, const CameraSet& set);

// Names the first camera and every 8th after it for tests, and the others for training.
void split_for_tests(CameraSet& set);

}  // namespace l4d::io
