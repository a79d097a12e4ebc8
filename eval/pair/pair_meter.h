// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "eval/pair/seen_errors.h"
#include "eval/scene/decoded_scene.h"
#include "eval/scene/motion.h"
#include "libl4dcodec/scene/color_errors.h"

namespace l4d::eval {

// Instants at which each Gaussian is looked at: both ends of its visible span and three between.
constexpr size_t kSamples = 5;

// Measures how far a Gaussian of B is from one of A, in A's frame: both scenes say where they sit
// in the world. Refers to its arguments. Any number of threads may use it at a time.
class PairMeter {
 public:
  // min_sizes: [A's Gaussians], as `min_sizes` has them, or empty. stream_a: what `a` is the scene
  // of, where that is a stream: its mean times are not rounded, and it says what is permanent.
  PairMeter(const io::Scene& a, const DecodedScene& b, const std::vector<float>& min_sizes,
            const DecodedScene* stream_a);

  const io::Scene& a() const { return a_; }
  const io::Scene& b() const { return b_.scene; }
  double begin() const { return begin_; }
  double end() const { return end_; }
  // A's units: smaller sizes count as this. What B states of itself, where B is a stream that does,
  // for its errors are in such sizes; else what follows from A.
  double min_size() const { return min_size_; }

  Motion motion_a(size_t i) const;
  Motion motion_b(size_t j) const;
  SeenErrors seen(size_t i, Motion a, size_t j, Motion b) const;
  ColorErrors colors(size_t i, size_t j) const;
  // Distances [kSamples] while A's Gaussian is visible; left alone if it never is.
  void visible(const Motion& a, const Motion& b, float* errors) const;

 private:
  const io::Scene& a_;
  const DecodedScene& b_;
  const std::vector<float>& min_sizes_;
  const std::vector<double>* mean_t_a_;
  double begin_, end_;
  double scale_;  // of B's units in A's
  double min_size_;
  std::array<double, 3> offset_{};
  std::vector<uint8_t> a_never_fades_, b_never_fades_;  // of permanent layers; empty: none does
};

}  // namespace l4d::eval
