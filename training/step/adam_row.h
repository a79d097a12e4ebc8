// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "libl4dcodec/scene/slice.h"
#include "training/model/random.h"
#include "training/step/adam.h"
#include "training/step/velocity_pull.h"

// Adam for one row, on the host and on devices. Gaussians that a step does not show have a
// derivative of zero: dense Adam still moves them by their momentum, lets their moments decay and
// counts the step for the bias correction. Sparse Adam leaves them alone and makes up for that when
// they are shown again.
namespace l4d::train {

constexpr float kBeta1 = 0.9f, kBeta2 = 0.999f, kEpsilon = 1e-15f;
constexpr float kMaxRateFactor = 10;  // for rows that few steps show
constexpr float kMaxRepeats = 50;     // of regularisers
constexpr uint32_t kMaxTail = 20;     // unseen steps whose momentum is applied
constexpr float kNoiseSteepness = 100, kNoiseOpacity = 0.005f;

// On a device, without the steps that IEEE rounding takes for small numbers, of which derivatives
// have many.
L4D_HOST_DEVICE inline float root_of(float x) {
#ifdef __CUDA_ARCH__
  float y;
  asm("sqrt.approx.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
#else
  return std::sqrt(x);
#endif
}
L4D_HOST_DEVICE inline float quotient(float a, float b) {
#ifdef __CUDA_ARCH__
  float y;
  asm("div.full.f32 %0, %1, %2;" : "=f"(y) : "f"(a), "f"(b));
  return y;
#else
  return a / b;
#endif
}
L4D_HOST_DEVICE inline float sigmoid(float x) { return linear_opacity(x, true); }
L4D_HOST_DEVICE inline float clamped(float x, float low, float high) {
  return x < low ? low : x > high ? high : x;
}
L4D_HOST_DEVICE inline uint32_t sh_values(uint32_t degree) {
  return 3 * (degree + 1) * (degree + 1);
}

// What the rates of a row depend on. `p`: the spatial rows of the covariance's root.
struct RowShape {
  Slice4D<float> slice;
  float p[3][4];
  float span;  // min(tau, T), s; tau = 8 temporal standard deviations
};

L4D_HOST_DEVICE inline RowShape row_shape(const AdamStep& s, const AdamArrays& a, uint64_t i) {
  RowShape shape;
  shape.slice = slice_attributes<float>(a.value.rotor + 8 * i, a.value.log_scale + 4 * i, shape.p);
  const float tau = 8.0f / std::sqrt(shape.slice.lambda);
  shape.span = tau < s.duration ? tau : s.duration;
  return shape;
}

// Calls f(values, m, v, gradients, rate) for each number of the row that may change, but for SH.
template <typename F>
L4D_HOST_DEVICE inline void for_each_shape_number(const AdamStep& s, const AdamArrays& a,
                                                  uint64_t i, float span, F&& f) {
  const Rates& r = s.rates;
  const auto run = [&](float* x, float* m, float* v, float* g, uint32_t first, uint32_t end,
                       float rate) {
    for (uint32_t k = first; k < end; ++k) f(x[k], m[k], v[k], g[k], rate);
  };
  const auto at = [&](float* base, uint64_t width) { return base + width * i; };
  run(at(a.value.position, 3), at(a.m.position, 3), at(a.v.position, 3), at(a.gradient.position, 3),
      0, 3, r.position);
  const float time_rate = r.mean_t_share * span;
  run(at(a.value.mean_t, 1), at(a.m.mean_t, 1), at(a.v.mean_t, 1), at(a.gradient.mean_t, 1), 0, 1,
      time_rate > r.mean_t_floor ? time_rate : r.mean_t_floor);
  run(at(a.value.log_scale, 4), at(a.m.log_scale, 4), at(a.v.log_scale, 4),
      at(a.gradient.log_scale, 4), 0, 4, r.log_scale);
  run(at(a.value.rotor, 8), at(a.m.rotor, 8), at(a.v.rotor, 8), at(a.gradient.rotor, 8), 0, 4,
      r.rotor);
  const float drift =
      r.rotor_drift == 0 ? r.rotor : clamped(r.rotor_drift / span, r.rotor_floor, r.rotor);
  run(at(a.value.rotor, 8), at(a.m.rotor, 8), at(a.v.rotor, 8), at(a.gradient.rotor, 8), 4, 8,
      drift);
  run(at(a.value.opacity, 1), at(a.m.opacity, 1), at(a.v.opacity, 1), at(a.gradient.opacity, 1), 0,
      1, r.opacity);
}

// Likewise of SH.
template <typename F>
L4D_HOST_DEVICE inline void for_each_sh_number(const AdamStep& s, const AdamArrays& a, uint64_t i,
                                               F&& f) {
  const auto run = [&](uint64_t first, uint64_t end, float rate) {
    for (uint64_t k = first; k < end; ++k) {
      f(a.value.sh[k], a.m.sh[k], a.v.sh[k], a.gradient.sh[k], rate);
    }
  };
  const uint64_t row = uint64_t{sh_values(s.sh_degree)} * i;
  run(row, row + 3, s.rates.sh_dc);
  run(row + 3, row + sh_values(s.active_sh_degree), s.rates.sh_rest);
}

template <typename F>
L4D_HOST_DEVICE inline void for_each_number(const AdamStep& s, const AdamArrays& a, uint64_t i,
                                            float span, F&& f) {
  for_each_shape_number(s, a, i, span, f);
  for_each_sh_number(s, a, i, f);
}

L4D_HOST_DEVICE inline void clamp_row(const AdamStep& s, const AdamArrays& a, uint64_t i) {
  float* scale = a.value.log_scale + 4 * i;
  for (int k = 0; k < 3; ++k) scale[k] = clamped(scale[k], s.min_log_scale, s.max_log_scale);
  scale[3] = clamped(scale[3], s.min_log_sigma, s.max_log_sigma);
  a.value.mean_t[i] = clamped(a.value.mean_t[i], s.min_mean_t, s.max_mean_t);
}

L4D_HOST_DEVICE inline void clear_shape_gradient(const AdamArrays& a, uint64_t i) {
  for (uint64_t k = 3 * i; k < 3 * i + 3; ++k) a.gradient.position[k] = 0;
  a.gradient.mean_t[i] = 0;
  for (uint64_t k = 4 * i; k < 4 * i + 4; ++k) a.gradient.log_scale[k] = 0;
  for (uint64_t k = 8 * i; k < 8 * i + 8; ++k) a.gradient.rotor[k] = 0;
  a.gradient.opacity[i] = 0;
}

L4D_HOST_DEVICE inline void clear_gradient(const AdamStep& s, const AdamArrays& a, uint64_t i) {
  clear_shape_gradient(a, i);
  const uint64_t width = sh_values(s.sh_degree);
  for (uint64_t k = width * i; k < width * (i + 1); ++k) a.gradient.sh[k] = 0;
}

// Noise that moves faint Gaussians along their own shape, so that they find what is still
// unexplained (Kheradmand et al. 2024).
L4D_HOST_DEVICE inline void add_noise(const AdamStep& s, const AdamArrays& a, uint64_t i,
                                      const RowShape& shape) {
  const float opacity = sigmoid(a.value.opacity[i]);
  const float faint = sigmoid(-kNoiseSteepness * (opacity - kNoiseOpacity));
  if (!(faint > 1e-7f)) return;
  float n[4];
  normal4(philox(s.seed, s.step, a.id[i], Use::kNoise), n);
  const float* c = shape.slice.covariance;
  const float amount = s.noise * s.rates.position * faint;
  float* x = a.value.position + 3 * i;
  x[0] += amount * (c[0] * n[0] + c[1] * n[1] + c[2] * n[2]);
  x[1] += amount * (c[1] * n[0] + c[3] * n[1] + c[4] * n[2]);
  x[2] += amount * (c[2] * n[0] + c[4] * n[1] + c[5] * n[2]);
}

// What an update of a row multiplies by.
struct RowUpdate {
  float factor;              // of rates
  float repeats;             // of regularisers
  float correct1, correct2;  // of the moments' bias
};

// Counts an update of the row.
L4D_HOST_DEVICE inline RowUpdate count_update(const AdamStep& s, const AdamArrays& a, uint64_t i) {
  const uint32_t n = ++a.updates[i];
  const uint32_t lived = static_cast<uint32_t>(s.step) - a.born[i];
  RowUpdate u{1, 1, 1, 1};
  if (s.sparse) {
    // prepared: at least the step before this one, after catch_up_rows.
    const float share = static_cast<float>(n) / static_cast<float>(lived > n ? lived : n);
    const float seldom = 1 / std::sqrt(share);
    u.factor = seldom < kMaxRateFactor ? seldom : kMaxRateFactor;
    u.repeats = 1 / share < kMaxRepeats ? 1 / share : kMaxRepeats;
  }
  const float steps = static_cast<float>(n);
  u.correct1 = 1 / (1 - std::pow(kBeta1, steps));
  u.correct2 = 1 / (1 - std::pow(kBeta2, steps));
  return u;
}

L4D_HOST_DEVICE inline void regularise_row(const AdamStep& s, const AdamArrays& a, uint64_t i,
                                           const RowUpdate& u) {
  const float opacity = sigmoid(a.value.opacity[i]);
  const float per_row =
      u.repeats / static_cast<float>(s.model_count != 0 ? s.model_count : s.count);
  float slope = s.opacity_weight;
  if (s.entropy_weight > 0) {
    slope -= s.entropy_weight * (std::log(opacity > 1e-30f ? opacity : 1e-30f) + 1);
  }
  a.gradient.opacity[i] += slope * per_row * opacity * (1 - opacity);
  for (uint64_t k = 4 * i; k < 4 * i + 3; ++k) {
    a.gradient.log_scale[k] += s.scale_weight * per_row / 3 * std::exp(a.value.log_scale[k]);
  }
  if (s.consistency_weight > 0 && a.motion != nullptr && a.motion[3 * i] == a.motion[3 * i]) {
    add_velocity_pull(a.value.rotor + 8 * i, a.value.log_scale + 4 * i, a.motion + 3 * i,
                      s.consistency_weight * per_row, a.gradient.rotor + 8 * i,
                      a.gradient.log_scale + 4 * i);
  }
}

L4D_HOST_DEVICE inline void update_number(const RowUpdate& u, float& x, float& m, float& v, float g,
                                          float rate) {
  m = kBeta1 * m + (1 - kBeta1) * g;
  v = kBeta2 * v + (1 - kBeta2) * (g * g);
  x -= quotient(u.factor * rate * (m * u.correct1), root_of(v * u.correct2) + kEpsilon);
}

// All of a row but its SH.
L4D_HOST_DEVICE inline void update_shape(const AdamStep& s, const AdamArrays& a, uint64_t i,
                                         const RowShape& shape, const RowUpdate& u) {
  regularise_row(s, a, i, u);
  for_each_shape_number(s, a, i, shape.span,
                        [&](float& x, float& m, float& v, float& g, float rate) {
                          update_number(u, x, m, v, g, rate);
                        });
  clear_shape_gradient(a, i);
  a.prepared[i] = static_cast<uint32_t>(s.step);
  if (s.noise > 0) add_noise(s, a, i, shape);
  clamp_row(s, a, i);
}

// Returns false if a derivative of the row is not finite.
L4D_HOST_DEVICE inline bool adam_row(const AdamStep& s, const AdamArrays& a, uint64_t i) {
  if (s.sparse && a.shown[i] == 0) return true;
  const RowShape shape = row_shape(s, a, i);
  float sum = 0;
  for_each_number(s, a, i, shape.span,
                  [&](float&, float&, float&, float& g, float) { sum += g * 0; });
  if (!(sum == 0)) {
    clear_gradient(s, a, i);
    return false;
  }
  const RowUpdate u = count_update(s, a, i);
  for_each_sh_number(s, a, i, [&](float& x, float& m, float& v, float& g, float rate) {
    update_number(u, x, m, v, g, rate);
  });
  update_shape(s, a, i, shape, u);
  clear_gradient(s, a, i);
  return true;
}

// The momentum of the steps that did not show the row: the sum of rate m / sqrt(v) q^j over them,
// with q = beta1 / sqrt(beta2), as dense Adam would have applied it step by step.
L4D_HOST_DEVICE inline void catch_up_row(const AdamStep& s, const AdamArrays& a, double time,
                                         uint64_t i) {
  const uint32_t since = static_cast<uint32_t>(s.step) - a.prepared[i];
  if (since <= 1 || a.updates[i] == 0) return;
  const RowShape shape = row_shape(s, a, i);
  const float dt = static_cast<float>(time - static_cast<double>(a.value.mean_t[i]));
  if (!is_visible(shape.slice.lambda, dt)) return;
  const uint32_t k = since < kMaxTail ? since : kMaxTail;
  const float q = kBeta1 / std::sqrt(kBeta2);
  const float tail = (q - std::pow(q, static_cast<float>(k))) / (1 - q);
  const float decay = std::pow(kBeta1, static_cast<float>(since - 1));
  const float steps = static_cast<float>(a.updates[i]);
  const float correct1 = 1 / (1 - std::pow(kBeta1, steps));
  const float correct2 = 1 / (1 - std::pow(kBeta2, steps));
  for_each_number(s, a, i, shape.span, [&](float& x, float& m, float& v, float&, float rate) {
    x -= quotient(rate * tail * (m * correct1), root_of(v * correct2) + kEpsilon);
    m *= decay;
  });
  a.prepared[i] = static_cast<uint32_t>(s.step) - 1;
  clamp_row(s, a, i);
}

}  // namespace l4d::train
