// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "training/capture/capture.h"
#include "training/images/pixels.h"

namespace l4d::train {

// Consecutive frames of a camera's video, which one file of a cache has. The camera and the part
// are numbers from 0 on; all parts of a camera but the last have FrameCache::kFrames frames.
struct FramePart {
  uint32_t camera = 0, part = 0;
  uint32_t count = 0;              // frames
  uint32_t width = 0, height = 0;  // pixels
};

// Frames of videos as they are trained on, so that any of them is read without decoding a video
// from a far key frame. Trainings may share a cache: files appear whole, and a file that is wrong
// counts as absent. All functions may be called on any thread.
class FrameCache {
 public:
  static constexpr uint32_t kFrames = 8;  // of a file, at most

  // folder: of caches, which need not exist. key: see key_of(). limit: bytes that the files of all
  // caches in the folder may have together. Frames beyond it are not kept.
  FrameCache(const std::string& folder, const std::string& key, uint64_t limit);

  // Returns some frames of a part, by their numbers in it; none if one of them is absent.
  std::vector<Pixels> read(const FramePart& part, const std::vector<uint32_t>& frames) const;
  // Whether the part seems to be there, by the header and the length of its file.
  bool has(const FramePart& part) const;
  // Keeps all frames of a part. A write that fails is the last one: see trouble().
  void write(const FramePart& part, const std::vector<Pixels>& frames);
  // Whether write() keeps frames still.
  bool is_writable() const { return is_writable_; }
  // Why it does not, as a sentence; else "".
  std::string trouble() const;

  // What decides the pixels of frames: the capture with all bytes of its videos, and the scale.
  static std::string key_of(const Capture& capture, double scale);

  // What a folder has of a capture.
  struct Content {
    double scale = 0;
    uint64_t bytes = 0;
  };
  static std::vector<Content> list(const std::string& folder, const Capture& capture);

 private:
  std::string path_of(const FramePart& part) const;
  void stop(const std::string& why);

  std::string folder_;  // of the key
  uint64_t limit_;
  std::atomic<uint64_t> bytes_{0};
  std::atomic<bool> is_writable_{true};
  mutable std::mutex mutex_;
  std::string trouble_;
};

}  // namespace l4d::train
