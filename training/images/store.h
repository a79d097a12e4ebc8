// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "training/images/loader.h"

namespace l4d::train {

constexpr uint64_t kImageBytes = 4;  // that a pixel counts as

// A frame of the sequence, with the images that may be trained on: those whose times are nearest to
// it.
struct Instant {
  double time = 0, last = 0;    // s, of the first image and of the last
  std::vector<uint32_t> views;  // indices of the capture's views
};
// What an image counts as, in bytes.
inline uint64_t image_bytes(const l4d_camera& camera) {
  return kImageBytes * camera.width * camera.height;
}
// The views of the split, by time.
std::vector<Instant> instants_of(const Capture& capture, const char* split);

// Bytes that images take in memory: all of them, and those of the window that takes the most.
struct ImageSizes {
  uint64_t total = 0, largest_window = 0;
};
// window: in instants. bytes_of(view): those of one image.
ImageSizes sizes_of(const std::vector<Instant>& instants, uint32_t window,
                    const std::function<uint64_t(uint32_t)>& bytes_of);

// Images in memory of bounded size. Which of them are there follows from the number of the step
// alone, so that a training that resumes meets the same.
class ImageStore {
 public:
  virtual ~ImageStore() = default;
  // Called before each step, in order; the first step may be any. Waits for images that are late.
  virtual void go_to(uint64_t step) = 0;
  // Indices of the instants whose images are there, in order.
  virtual const std::vector<uint32_t>& instants() const = 0;
  // Steps that have the same instants have the same number.
  virtual uint64_t period() const = 0;
  // Steps since the period began.
  virtual uint64_t step_of_period() const = 0;
  // Parts of the sequence that instants() are of, and a bound on them: the newest `windows` of
  // those in memory. The bound holds until it is set again.
  virtual uint32_t windows() const = 0;
  virtual void use_windows(uint32_t windows) = 0;
  virtual const Pixels& image(uint32_t view) const = 0;
  virtual uint64_t bytes() const = 0;         // of the images that are there
  virtual double seconds_waited() const = 0;  // for images
};

constexpr uint64_t kLeastWindows = 3;  // with which a reservoir works

struct StoreOptions {
  uint64_t memory = uint64_t{8} << 30;  // bytes of images
  uint32_t threads = 0;                 // that read images; 0 = one per core
  uint64_t seed = 0;
  uint32_t views_per_step = 2;
  // Images of a window, in frames, and how often each is used before the window goes.
  uint32_t window = 8;
  uint32_t uses = 4;
  // A reservoir of 8 windows at most, also where more images fit: a model of which a part has to be
  // in the back end needs that.
  bool few = false;
};

// Keeps all images if they fit into the memory, else a reservoir of windows that are spread over
// the sequence: the oldest goes, and the next of a permutation, whose images a thread has read
// meanwhile, takes its place. Throws io::Error(LIMIT_EXCEEDED) if neither all images nor
// kLeastWindows windows fit, of which one is being read while the others are in use.
// progress(done, total): images read at the start; may be null. Returning true cancels.
std::unique_ptr<ImageStore> make_image_store(
    const ImageLoader& loader, const std::vector<Instant>& instants, const StoreOptions& options,
    const std::function<bool(uint64_t, uint64_t)>& progress);

}  // namespace l4d::train
