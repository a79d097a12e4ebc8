// SPDX-License-Identifier: Apache-2.0
#include "eval/jod/sensitivity.h"

#include <algorithm>
#include <cmath>

namespace l4d::eval {
namespace {

constexpr double kLeastLog = -2.3010299956639813;  // log10(0.005)
constexpr double kMostLog = 4;
constexpr double kDecibels = -0.2797423303127289;
constexpr double kLog2Of10 = 3.321928094887362;

}  // namespace

Sensitivity::Sensitivity(size_t channel, double cpd) {
  const double step = (std::log10(64.0) + 1) / (kSensitivityColumns - 1);
  const double at = (std::log10(cpd) + 1) / step;
  // Above the last frequency the last cell goes on.
  const auto cell = static_cast<size_t>(
      std::clamp(std::floor(at), 0.0, static_cast<double>(kSensitivityColumns - 2)));
  const double part = at - static_cast<double>(cell);
  for (size_t row = 0; row < kSensitivityRows; ++row) {
    const double* table = kLog10Sensitivity[channel][row];
    const double value = table[cell] + part * (table[cell + 1] - table[cell]);
    log2_[row] = static_cast<float>(kLog2Of10 * (value + kDecibels / 20));
  }
}

float Sensitivity::place_of(float luminance) {
  constexpr auto kScale =
      static_cast<float>(static_cast<double>(kSensitivityRows - 1) / (kMostLog - kLeastLog));
  const float place = (std::log10(luminance) - static_cast<float>(kLeastLog)) * kScale;
  return std::clamp(place, 0.0F, static_cast<float>(kSensitivityRows - 1));
}

float Sensitivity::operator()(float place) const {
  const size_t cell = std::min(static_cast<size_t>(place), kSensitivityRows - 2);
  const float part = place - static_cast<float>(cell);
  return std::exp2(log2_[cell] + part * (log2_[cell + 1] - log2_[cell]));
}

}  // namespace l4d::eval
