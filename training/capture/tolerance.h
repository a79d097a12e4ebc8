// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "l4d/render.h"

// What --tolerant finds out before a training begins, so that files that are missing or damaged do
// not end it hours later.
namespace l4d::train {

// What is wrong with the image of a camera, as far as its first and last bytes say: "" for a whole
// PNG of the camera's size. Images that are damaged in the middle are not found.
std::string trouble_of_image(const std::string& path, const l4d_camera& camera);

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
