// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "l4d/render.h"
#include "training/capture/capture.h"

// What is found out of files before a training begins: by --tolerant, so that those that are
// missing or damaged do not end it hours later, and by `inspect`.
namespace l4d::train {

// What is wrong with the image of a camera, as far as its first and last bytes say: "" for a whole
// PNG, JPEG or EXR of the camera's size. Images that are damaged in the middle are not found.
std::string trouble_of_image(const std::string& path, const l4d_camera& camera);

// Throws what a training would find when it reads the images and masks, as far as their first bytes
// say: the first that is missing, no image or not of its camera's size, with its camera and frame.
void check_image_files(const Capture& capture);

// What was left out, as notes for people: one for each, and for many of a kind their number.
class LeftOut {
 public:
  void add(const std::string& what);
  void append_to(std::vector<std::string>* notes) const;

 private:
  std::vector<std::string> named_;
  uint64_t count_ = 0;
};

}  // namespace l4d::train
