// SPDX-License-Identifier: Apache-2.0
// What is chosen last absorbs what was coded first: mean time, opacity and position of a Gaussian
// are set so that the decoded one, with its decoded temporal scale and velocity, is seen as the
// original is.
#pragma once

#include <initializer_list>

namespace l4d {

// How a Gaussian fades: opacity exp(-lambda (t - mean)^2 / 2).
struct Fading {
  double opacity;
  double mean;    // seconds
  double lambda;  // 1/s^2
};

// How a Gaussian moves: position + velocity (t - reference).
struct Moving {
  double position[3];
  double velocity[3];
  double reference;  // seconds
};

// The part of the sequence [begin, end] in which any of some Gaussians is visible, as instants.
class SeenSpan {
 public:
  SeenSpan(std::initializer_list<Fading> any, double begin, double end);

  // The mean time at which the decoded Gaussian, whose lambda is given, fades as fast as the
  // original in the middle of what is seen of it.
  double matching_mean(const Fading& original, double decoded_lambda) const;

  // Sets decoded->opacity in [0, 1] for the least squared difference over the span, which is
  // returned.
  double match_opacity(const Fading& original, Fading* decoded) const;

  // Sets decoded->position so that positions differ least where both are seen.
  void match_position(const Fading& original, const Fading& decoded_fading, const Moving& moving,
                      Moving* decoded) const;

 private:
  static constexpr int kSamples = 12;
  double time_[kSamples];
};

}  // namespace l4d
