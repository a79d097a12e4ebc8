// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

// How well people see a contrast (castleCSF): of sustained achromatic, red to green, violet to
// yellow, and transient achromatic patterns.
namespace l4d::eval {

constexpr size_t kJodChannels = 4;
constexpr size_t kSensitivityRows = 32;     // log10 of luminance, cd/m^2: log10(0.005) to 4
constexpr size_t kSensitivityColumns = 32;  // log10 of cycles per degree: -1 to log10(64)
extern const double kLog10Sensitivity[kJodChannels][kSensitivityRows][kSensitivityColumns];

// At one spatial frequency.
class Sensitivity {
 public:
  // cpd: cycles per degree.
  Sensitivity(size_t channel, double cpd);
  // Of a place on the axis of luminance, from place_of().
  float operator()(float place) const;
  static float place_of(float luminance);

 private:
  std::array<float, kSensitivityRows> log2_{};  // with the factor that fits the metric
};

}  // namespace l4d::eval
