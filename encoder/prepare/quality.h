// SPDX-License-Identifier: Apache-2.0
// How a quality in dB is divided among what is coded. Errors of different numbers add up as squares
// (they are independent enough: docs/accuracy.md), so each number is given the same squared error.
#pragma once

#include <algorithm>
#include <cmath>

#include "encoder/prepare/settings.h"

namespace l4d {

class Quality {
 public:
  // n: Gaussians of the scene. shared: those that the error of the image is divided among, 0 = n.
  Quality(const EncoderSettings& settings, size_t n, double shared = 0)
      : settings_(settings),
        decibels_(settings.get(Parameter::kQuality)),
        n_(static_cast<double>(n)),
        shared_(shared > 0 ? shared : n_) {}

  double decibels() const { return decibels_; }

  // Mean squared error of the image that one number of component c of one Gaussian may cause.
  double distortion_per_coefficient(unsigned c) const {
    return power(decibels_ + kOffset[c] +
                 settings_.get(Parameter::kQualityOffset, static_cast<int>(c)));
  }
  // What a bit of component c is worth: the slope at which that error falls with the rate of
  // uniform quantisers, 2 ln 2 of it.
  double rd_lambda(unsigned c) const { return 2 * std::log(2.0) * distortion_per_coefficient(c); }
  // Of a component whose largest sensible step is known at 42 dB: small weights are estimates, and
  // hold for small errors only.
  double max_step(double at_42_db) const { return at_42_db * std::exp2((42 - decibels_) / 12); }

  // Squared error of the image that leaving a Gaussian out may cause: what its bits would save
  // elsewhere, a bit being worth 2 ln 2 of what a number is allowed. cost: of Pruning.
  double pruning_error(double cost) const {
    constexpr double kBitsPerGaussian = 80;
    return cost * kBitsPerGaussian * 2 * std::log(2.0) * power(decibels_);
  }

  // Step of positions for the importances given, of one number each. Their offset is more than
  // slopes on one scene ask for: where splats lie in one plane, errors of position change which is
  // in front.
  double position_step(double sum_of_importance) const {
    return std::sqrt(12 * power(decibels_ + settings_.get(Parameter::kPositionOffset)) * n_ /
                     std::max(sum_of_importance, 1e-30));
  }
  // 5 bits are 54 dB, and each is 6 dB.
  unsigned opacity_bits() const {
    const int set = settings_.get_int(Parameter::kOpacityBits);
    if (set != 0) return static_cast<unsigned>(set);
    return static_cast<unsigned>(std::clamp(std::ceil(5.5 + (decibels_ - 42) / 6), 4.0, 12.0));
  }
  // How far off a mean time may be, in standard deviations of what it is the mean of: 0.05 at 44
  // dB, 0.01 at 54 dB.
  double mean_t_error() const {
    return std::clamp(0.05 * std::pow(5.0, (44 - decibels_) / 10), 0.001, 0.15);
  }

 private:
  // About this many numbers of a Gaussian take part in its error. This and the offsets are where
  // the slopes of fidelity against bytes are equal, on the basketball scene at 41 dB.
  static constexpr double kNumbers = 66;
  static constexpr double kOffset[L4D_COMPONENT_COUNT] = {0, 1.2, 0, -3.5};
  double power(double decibels) const {
    return std::pow(10.0, -decibels / 10) / (kNumbers * shared_);
  }

  const EncoderSettings& settings_;
  double decibels_;
  double n_;
  double shared_;
};

}  // namespace l4d
