// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "eval/jod/pooling.h"
#include "eval/jod/pyramid.h"
#include "io/image/image.h"

// JOD of ColorVideoVDP 0.5.6 (Mantiuk et al. 2024, doi 10.1145/3658144): how much worse people find
// a video than its reference, on a display at a distance.
namespace l4d::eval {

struct JodDisplay {
  const char* name;
  double pixels_per_degree;
};
// "standard_4k", which is usual, or "standard_fhd"; null for other names.
const JodDisplay* find_jod_display(const std::string& name);

// Frames a second of a video whose frames are at these times, in s, which rise; 0 for one frame,
// and where a step differs from the others by more than a thousandth.
double video_rate(const std::vector<double>& times);

// Two videos of one size and frame rate, frame by frame.
class JodMeter {
 public:
  // Sides of 8 pixels and more. frames: of the video; 1: an image, which has no motion. fps: frames
  // a second, above 0. The result is the same for any number of threads; 0 = one per core. holder
  // counts what it keeps. Throws io::Error.
  JodMeter(uint32_t width, uint32_t height, uint64_t frames, double fps, const JodDisplay& display,
           uint32_t threads, const io::Hold& holder);
  // sRGB, clamped to [0, 1] first; NaN is 0. Frames follow each other.
  void add(const io::Image& test, const io::Image& reference);
  // Of the frames so far; 10 where they are equal.
  double jod() const { return pooled_jod(frames_); }
  const std::vector<JodFrame>& frames() const { return frames_; }

 private:
  static constexpr size_t kVideos = 2;  // test, reference
  static constexpr size_t kAxes = 3;    // light, red to green, violet to yellow
  using Channels = std::array<Plane, kJodChannels>;

  void keep(const io::Image& image, size_t video);
  // Of the frames kept, channel by channel.
  Channels filtered(size_t video) const;
  void compare_band(size_t band, const std::array<Channels, kVideos>& level,
                    const std::array<Channels, kVideos>& next, JodFrame* out) const;
  void compare_base(const std::array<Channels, kVideos>& level, JodFrame* out) const;

  const uint32_t width_, height_, threads_;
  const size_t channels_;  // 3 of an image
  std::vector<double> bands_;
  std::array<std::vector<float>, kJodChannels> filters_;             // by frame, the oldest first
  std::array<std::vector<std::array<Plane, kAxes>>, kVideos> ring_;  // by frame modulo its length
  std::shared_ptr<void> memory_;
  std::vector<JodFrame> frames_;
};

}  // namespace l4d::eval
