// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer/position_coding.h"

#include <algorithm>
#include <cmath>

#include "encoder/prepare/scalar.h"
#include "libl4dcodec/base/half.h"

namespace l4d {
namespace {

// Binary16, or with the input's own bits where the scene is lossless.
PositionCoding float_positions(const std::vector<CodedLayer>& layers, bool lossless) {
  PositionCoding coding;
  coding.position = lossless ? CoordinateCodingId::kRaw32 : CoordinateCodingId::kF16;
  std::vector<double> axis;
  double reach = 0;
  for (size_t k = 0; k < 3; ++k) {
    axis.clear();
    for (const CodedLayer& layer : layers) {
      if (layer.escape) continue;
      for (size_t j = k; j < layer.position.size(); j += 3) axis.push_back(layer.position[j]);
    }
    if (axis.empty()) continue;
    const auto middle = axis.begin() + static_cast<std::ptrdiff_t>(axis.size() / 2);
    std::nth_element(axis.begin(), middle, axis.end());
    // Half of all Gaussians on either side: binary16 is finest around its zero.
    const float center = sound_constant(static_cast<float>(*middle));
    coding.position_center[k] = lossless ? 0.0f : center;
    for (const double x : axis) reach = std::max(reach, std::fabs(x - static_cast<double>(center)));
  }
  // A power of two, so that scaling is exact, under which the farthest Gaussian is near the top of
  // the range of binary16 and the finest steps are used around the centre.
  coding.position_scale = 1;
  if (!lossless && reach > 0) {
    const int exponent = std::clamp(static_cast<int>(std::ceil(std::log2(reach / 32768))), -40, 60);
    coding.position_scale = std::ldexp(1.0f, exponent);
  }
  return coding;
}

// Fixed-point coordinates with a step of about `step`, or as fine as their bits allow.
PositionCoding fixed_positions(const std::vector<CodedLayer>& layers, double step) {
  PositionCoding coding;
  double low[3], high[3];
  std::fill_n(low, 3, HUGE_VAL);
  std::fill_n(high, 3, -HUGE_VAL);
  for (const CodedLayer& layer : layers) {
    if (layer.escape) continue;
    for (size_t j = 0; j < layer.position.size(); ++j) {
      low[j % 3] = std::min(low[j % 3], layer.position[j]);
      high[j % 3] = std::max(high[j % 3], layer.position[j]);
    }
  }
  double reach = 0;
  for (size_t k = 0; k < 3; ++k) {
    if (low[k] > high[k]) low[k] = high[k] = 0;  // nothing but escapes
    reach = std::max(reach, high[k] - low[k]);
  }
  // A step between powers of two saves a fraction of a bit; one that is no power of two rounds
  // nothing that matters.
  const double finest = reach / ((1u << kMaxPositionBits) - 2);
  const float scale = static_cast<float>(std::clamp(std::max(step, finest), 0x1p-40, 0x1p60));
  coding.position = CoordinateCodingId::kFixed;
  coding.position_scale = scale;
  coding.position_bits = 1;
  for (size_t k = 0; k < 3; ++k) {
    coding.position_center[k] = sound_constant(static_cast<float>(low[k]));
    const double codes =
        (high[k] - static_cast<double>(coding.position_center[k])) / static_cast<double>(scale);
    while (coding.position_bits < kMaxPositionBits &&
           codes > static_cast<double>((1u << coding.position_bits) - 1)) {
      ++coding.position_bits;
    }
  }
  return coding;
}

}  // namespace

PositionCoding planned_positions(const PositionPlan& plan) {
  PositionCoding coding;
  coding.position = CoordinateCodingId::kFixed;
  coding.position_bits = plan.bits;
  coding.position_scale = static_cast<float>(plan.step);
  std::copy_n(plan.center, 3, coding.position_center);
  return coding;
}

PositionCoding choose_positions(const PositionPlan& plan, const std::vector<CodedLayer>& layers,
                                bool lossless) {
  if (plan.bits > 0) return planned_positions(plan);
  return plan.step > 0 ? fixed_positions(layers, plan.step) : float_positions(layers, lossless);
}

double coded_position(const PositionCoding& coding, const CodedLayer& layer, size_t j, size_t k) {
  const double x = layer.position[3 * j + k];
  if (layer.escape) return x;
  const float center = coding.position_center[k];
  const double scaled =
      (x - static_cast<double>(center)) / static_cast<double>(coding.position_scale);
  switch (coding.position) {
    case CoordinateCodingId::kFixed: {
      const double last = static_cast<double>((1u << coding.position_bits) - 1);
      const float code = static_cast<float>(nearest_code<uint32_t>(scaled, 0, last));
      return static_cast<double>(center + coding.position_scale * code);
    }
    case CoordinateCodingId::kF16: {
      const float half = half_to_float(float_to_half_saturate(static_cast<float>(scaled)));
      return static_cast<double>(center + coding.position_scale * half);
    }
    default:
      return static_cast<double>(static_cast<float>(x));
  }
}

}  // namespace l4d
