// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "eval/observer.h"
#include "eval/views/views.h"
#include "io/image/image.h"

namespace l4d::eval {

struct CapturedImage {
  io::Image image;
  const std::vector<uint8_t>& mask;  // of its camera, as in io/image/metrics.h
};

// What cameras saw of their views: frames of videos, or image files, and their masks. Videos can
// only be read from their beginning on, so all frames of a camera are read together and kept as
// bytes.
class CapturedImages {
 public:
  // `views` are indices into those of `all`, which must outlive this. Throws io::Error, with
  // L4D_ERR_INVALID_ARGUMENT where a camera names files outside its folder and the set says nothing
  // of any path.
  CapturedImages(const CameraViews& all, const std::vector<size_t>& views, Observer& observer);
  CapturedImage image(size_t view) const;

 private:
  const CameraViews& all_;
  std::vector<std::vector<uint8_t>> bytes_;    // by view; empty where it was not asked for
  std::vector<std::vector<uint8_t>> masks_;    // by camera; empty where it has none
  std::vector<std::shared_ptr<void>> memory_;  // counts them, by camera
};

// Parts of the views, with whole cameras each, whose captured images are in memory together: of
// 1 GiB, or of what the cameras' image_memory allows, but one camera at least. The order of views
// is kept within a part.
std::vector<std::vector<size_t>> parts_of(const CameraViews& all);

}  // namespace l4d::eval
