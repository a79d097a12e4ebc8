// SPDX-License-Identifier: Apache-2.0
#include "eval/jod/pooling.h"

#include <cmath>

namespace l4d::eval {
namespace {

// As they are fitted to what people said (ColorVideoVDP 0.5.6).
constexpr double kOfBands = 4, kOfChannels = 4, kOfFrames = 2;
constexpr double kChannel[kJodChannels] = {1, 1, 1, 0.8081134557723999};
constexpr double kBase[kJodChannels] = {0.0036334486, 1.6627724171, 4.1187453270, 25.2596988678};
constexpr double kImage = 0.577918291091919;
constexpr double kScale = 0.0439569391310215, kExponent = 0.9302042722702026, kLinear = 0.1;

double pooled_frame(const JodFrame& frame) {
  double over_channels = 0;
  for (size_t c = 0; c < kJodChannels; ++c) {
    double over_bands = 0;
    for (size_t band = 0; band < frame[c].size(); ++band) {
      const double base = band + 1 == frame[c].size() ? kBase[c] : 1;
      over_bands += safe_power(frame[c][band] * kChannel[c] * base, kOfBands);
    }
    if (frame[c].empty()) continue;
    over_channels += safe_power(safe_power(over_bands, 1 / kOfBands), kOfChannels);
  }
  return safe_power(over_channels, 1 / kOfChannels);
}

}  // namespace

double safe_power(double x, double p) {
  constexpr double kLeast = 1e-5;
  return x > 0 ? std::pow(x + kLeast, p) - std::pow(kLeast, p) : 0;
}

double pooled_jod(const std::vector<JodFrame>& frames) {
  double quality = 0;
  if (frames.size() == 1) {
    quality = kImage * pooled_frame(frames[0]);
  } else {
    double sum = 0;
    for (const JodFrame& frame : frames) sum += safe_power(pooled_frame(frame), kOfFrames);
    quality = safe_power(sum / static_cast<double>(frames.size()), 1 / kOfFrames);
  }
  return quality > kLinear ? 10 - kScale * std::pow(quality, kExponent)
                           : 10 - kScale * std::pow(kLinear, kExponent - 1) * quality;
}

}  // namespace l4d::eval
