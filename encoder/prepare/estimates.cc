// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/estimates.h"

#include <algorithm>
#include <cmath>
#include <functional>

namespace l4d {
namespace {

// Squared change of the image by one number of each component of a Gaussian that is all of it:
// averages over a trained scene (basketball) of the ratio to the blending weight. They say what
// matters more, not how much in decibels.
constexpr double kSquarePerAlpha[L4D_COMPONENT_COUNT] = {2e-3, 5e-4, 1e-2, 0};
constexpr double kPositionPerScale = 1.5;  // in units of the middle size
constexpr double kTemporalPerPosition = 1.3;
constexpr double kProxyGain = 0.7;  // where the default preset has about the fidelity it aims at

// Of what a turn changes: the part that any Gaussian has, and that of the two smaller sizes.
constexpr double kLeastTurn = 0.02, kSmallerTurn = 0.1;
constexpr double kTurnPower = 0.75;
// Below this part of the scene's median size pixels tell no sizes apart.
constexpr double kLeastSize = 0.1;

double seconds_of(const Sequence& part) { return part.end - part.begin; }

// Part of the sequence in which Gaussian i is visible, in seconds.
double seen_seconds(const EncoderScene& s, size_t i) {
  if (s.is_flat(i)) return seconds_of(s.shown(i));
  const double begin = s.timeline.time_begin;
  const double reach = 4 * s.sigma_t(i);
  const double span =
      std::min(begin + s.duration, s.mean_t[i] + reach) - std::max(begin, s.mean_t[i] - reach);
  return std::max(span, 0.0);
}

// How far a small turn in the plane of two sizes changes a Gaussian; 0 = not at all.
double turn(double larger, double smaller) {
  const double ratio = larger / smaller;
  return std::pow(std::max(0.0, ratio + 1 / ratio - 2), kTurnPower);
}

}  // namespace

double shown_area(const EncoderScene& s, size_t i) {
  // Pictures show about the scene: what is larger fills them, and no more.
  const double most = s.extent > 0 ? std::log(s.extent / 2) : HUGE_VAL;
  double scale[3];
  for (size_t k = 0; k < 3; ++k) {
    scale[k] = std::min(static_cast<double>(s.log_scale[4 * i + k]), most);
  }
  std::sort(scale, scale + 3);
  const double area = std::exp(scale[1] + scale[2]);
  const double shown = s.is_flat(i) ? seconds_of(s.shown(i)) : 8 * s.sigma_t(i);
  const double life = std::min(1.0, shown / s.duration);
  return area * life;
}

float proxy_weight(const EncoderScene& s, size_t i) {
  return static_cast<float>(static_cast<double>(s.opacity[i]) * shown_area(s, i));
}

std::vector<double> estimated_shares(const EncoderScene& s, double* sum) {
  std::vector<double> shares(s.count);
  // Proxies are so often wrong that half of their octaves serve better.
  const auto proxy = [&](size_t i) { return std::sqrt(static_cast<double>(proxy_weight(s, i))); };
  for (size_t i = 0, n = *sum > 0 ? 0 : s.count; i < n; ++i) *sum += proxy(i);
  for (size_t i = 0; i < s.count; ++i) {
    shares[i] = *sum > 0 ? kProxyGain * proxy(i) / *sum : 1.0 / static_cast<double>(s.count);
  }
  return shares;
}

ShapeFactors::ShapeFactors(const EncoderScene& scene) : scene_(scene) {
  std::vector<double> largest(scene.count);
  for (size_t i = 0; i < scene.count; ++i) largest[i] = sizes(i)[0];
  const auto middle = largest.begin() + static_cast<std::ptrdiff_t>(scene.count / 2);
  std::nth_element(largest.begin(), middle, largest.end());
  least_ = kLeastSize * *middle;
}

ShapeFactors::Sizes ShapeFactors::sizes(size_t i) const {
  Sizes size{};
  for (size_t k = 0; k < 3; ++k) {
    size[k] = std::max(std::exp(static_cast<double>(scene_.log_scale[4 * i + k])), least_);
  }
  std::sort(size.begin(), size.end(), std::greater<>());
  return size;
}

ImageSquares ShapeFactors::squares(size_t i, double share) const {
  ImageSquares out{};
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) out.component[c] = kSquarePerAlpha[c] * share;
  const Sizes size = sizes(i);
  const auto [largest, middle, smallest] = size;
  out.component[L4D_COMPONENT_ROTOR_SPATIAL] *=
      turn(largest, middle) + kSmallerTurn * turn(middle, smallest) + kLeastTurn;
  out.position = position_per_scale(size) * out.component[L4D_COMPONENT_SCALE];
  out.component[L4D_COMPONENT_ROTOR_TEMPORAL] = temporal_per_position(i) * out.position;
  return out;
}

double ShapeFactors::position_per_scale(const Sizes& sizes) {
  return kPositionPerScale / (sizes[1] * sizes[1]);
}

double ShapeFactors::temporal_per_position(size_t i) const {
  const double seconds = seen_seconds(scene_, i);
  return kTemporalPerPosition * seconds * seconds;
}

}  // namespace l4d
