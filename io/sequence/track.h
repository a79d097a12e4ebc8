// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "io/sequence/frame.h"
#include "io/sequence/region.h"

namespace l4d::io {

// Row `row` of a frame, as one sees it that follows it.
struct Sample {
  const float* position;   // [3]
  const float* log_scale;  // [3]
  const float* rotation;   // [4]
  float opacity;
  const float* sh;  // [numbers]
};

// Gaussians of the scene: positions at the reference time, opacities in [0, 1], times in seconds.
struct SequenceOutput {
  AttributeArrays gaussians;
  std::vector<double> times;
  uint64_t fading = 0, windows = 0;
};

struct SequenceClock {
  uint32_t frames = 0;
  double seconds = 0;  // of a frame
};

// The line that a coordinate follows: what the samples so far allow, and their sums.
struct LineFit {
  double first = 0;  // the first sample; all else is relative to it
  double sum = 0, sum_t = 0;
  Region region;
  // Adds sample `x` at `n` frames after the first. False if no line is near enough to all: the fit
  // is then of no use.
  bool add(uint32_t n, double x, double error, double first_error);
  // The line x + y t of `n` samples. A motion of less than `still` in all becomes none.
  Region::Point solve(uint32_t n, double still) const;
};

// A Gaussian that is followed from frame to frame, and what it becomes.
class Track {
 public:
  Track(uint32_t frame, const Sample& sample, size_t numbers, const SequenceTolerance& tolerance);
  // Adds the sample of the next frame. False if it needs a new track: this one is then to be
  // finished.
  bool add(const Sample& sample);
  // Writes what the track became. Its last frame was `end` - 1.
  void finish(const SequenceClock& clock, SequenceOutput* out) const;
  uint32_t begin() const { return begin_; }
  const float* velocity() const { return velocity_; }

 private:
  // A part with constant opacity.
  struct Part {
    uint32_t begin, end;
    double position[3];  // at the middle
    double velocity[3];  // a frame
    float opacity;
  };
  struct Open {  // the part that is going on, where it is not all of the track
    uint32_t begin;
    double first_error;
    LineFit lines[3];
  };
  struct Fade {  // logarithm of opacity: first + x t + y t^2
    bool possible = true;
    double first = 0;
    double tt = 0, ttt = 0, tttt = 0, ty = 0, tty = 0;  // weighted sums
    Region region = Region::of_box(-20, 20, -20, 0);
    void add(uint32_t n, float opacity, double error);
    bool solve(Region::Point* out) const;
  };

  bool keeps_shape(const Sample& s) const;
  void widen_shape(const Sample& s);
  void add_to_parts(const Sample& s, double error, const LineFit* lines_before);
  Part close(uint32_t begin, uint32_t end, const LineFit* lines) const;
  bool is_whole(const SequenceClock& clock) const { return begin_ == 0 && count_ == clock.frames; }
  bool fades_naturally(const SequenceClock& clock, Region::Point* fade) const;
  void write_shape(const double* velocity, double sigma_t, SequenceOutput* out) const;
  // mean, sigma: frames.
  void write_fading(const SequenceClock& clock, double mean, double sigma, double opacity,
                    SequenceOutput* out) const;
  void write_part(const SequenceClock& clock, const Part& part, SequenceOutput* out) const;

  SequenceTolerance tolerance_;
  uint32_t begin_, count_ = 1;
  double first_error_ = 0;
  LineFit lines_[3];
  Fade fade_;
  float least_, most_;  // opacity of the part that is going on
  double sum_;
  std::unique_ptr<Open> open_;
  std::vector<Part> parts_;
  float rotation_[4];
  float scale_[2][3];      // least and most logarithm
  std::vector<float> sh_;  // [2, numbers] least and most
  float last_[3], velocity_[3] = {};
};

}  // namespace l4d::io
