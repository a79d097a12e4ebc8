// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "training/capture/capture.h"
#include "training/images/frame_cache.h"
#include "training/images/pixels.h"

namespace l4d::train {

// Reads the images of a capture: undistorted, scaled and as bytes.
class ImageLoader {
 public:
  // near: in units of the radius of the cameras; they see nothing that is nearer to them.
  ImageLoader(const Capture& capture, double scale, double near = 0);

  // Reads frames of videos from a cache, and keeps there what it lacks. The cache outlives the
  // loader.
  void use(FrameCache* cache);
  // Decodes the videos of a split once, and puts the frames into the cache that it lacks, as long
  // as it keeps frames. progress(done, total): frames; if it returns true, this throws CANCELLED.
  // Throws as load() does.
  void fill_cache(const char* split, uint32_t threads,
                  const std::function<bool(uint64_t, uint64_t)>& progress) const;

  // Cameras of the images that are returned, by index of the capture's cameras.
  const l4d_camera& camera(uint32_t index) const { return cameras_[index]; }
  const l4d_camera& camera_of(uint32_t view) const { return cameras_[capture_.views[view].camera]; }
  // They become those of the changes that the capture's cameras have.
  void renew_cameras();
  // [height, width] of the scaled camera; empty where all pixels count.
  const std::vector<uint8_t>& mask(uint32_t index) const { return masks_[index]; }

  using Sink = std::function<void(uint32_t view, Pixels pixels)>;
  // Reads views, given as indices of the capture's. A video is decoded once, from the key frame
  // ahead of the first of them to the last. Cameras are read in parallel: the sink is called on any
  // thread, once for each view. Stops where `cancelled`, which may be null, returns true. Throws
  // io::Error that names camera and frame.
  void load(std::vector<uint32_t> views, uint32_t threads, const Sink& sink,
            const std::function<bool()>& cancelled = nullptr) const;

 private:
  Pixels finish(uint32_t camera, const io::Image& image, const std::vector<float>& alpha) const;
  void load_file(uint32_t view, const Sink& sink) const;
  void load_video(uint32_t camera, const std::vector<uint32_t>& views, const Sink& sink,
                  const std::function<bool()>& cancelled) const;
  FramePart part_of(uint32_t camera, uint32_t part) const;
  // The views of which the cache lacks the part, by frame.
  std::vector<uint32_t> not_cached(uint32_t camera) const;
  // As load_video, through the cache. What it lacks is decoded, in whole parts if they are kept.
  void load_parts(uint32_t camera, const std::vector<uint32_t>& views, const Sink& sink,
                  const std::function<bool()>& cancelled) const;

  const Capture& capture_;
  const double scale_;
  FrameCache* cache_ = nullptr;
  std::vector<std::vector<uint32_t>> videos_;  // with a cache: views of each camera's video
  std::vector<uint32_t> places_;               // of views among those of their camera
  std::vector<l4d_camera> cameras_;
  std::vector<std::vector<uint8_t>> masks_;
  std::vector<std::shared_ptr<void>> memory_;                 // counts those of files
  std::vector<std::unique_ptr<Undistortion>> undistortions_;  // null: a pinhole
};

}  // namespace l4d::train
