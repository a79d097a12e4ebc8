// SPDX-License-Identifier: Apache-2.0
#include "training/step/schedule.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "training/model/random.h"

namespace l4d::train {
namespace {

constexpr double kPositionRate = 1.6e-4;  // of the radius
constexpr double kSpatialRotorRate = 1e-3;
constexpr double kNoise = 5e5;

float log_of(double x) { return static_cast<float>(std::log(x)); }

}  // namespace

Rates rates_at(const ScheduleOptions& o, double f) {
  const double decay = std::pow(0.01, f) * o.rate_factor;
  const double constant = (f < kDensityEnd ? 1.0 : kSettleRates) * o.rate_factor;
  Rates r;
  r.position = static_cast<float>(kPositionRate * o.radius * decay);
  r.mean_t_floor = static_cast<float>(0.05 / o.fps * decay);
  r.mean_t_share = static_cast<float>(3e-4 * decay);
  r.log_scale = static_cast<float>(5e-3 * constant);
  r.rotor = static_cast<float>(kSpatialRotorRate * constant);
  r.rotor_drift = static_cast<float>(o.drift * kPositionRate * o.radius * constant);
  r.rotor_floor = static_cast<float>(1e-3 * kSpatialRotorRate * constant);
  r.opacity = static_cast<float>(5e-2 * constant);
  r.sh_dc = static_cast<float>(2.5e-3 * constant);
  r.sh_rest = static_cast<float>(1.25e-4 * constant);
  return r;
}

uint32_t sh_degree_at(const ScheduleOptions& o, double f) {
  return std::min(o.sh_degree, static_cast<uint32_t>(10 * f));
}

AdamStep adam_step_at(const ScheduleOptions& o, double f, uint64_t seed, uint64_t step,
                      double time_begin) {
  AdamStep s;
  s.seed = seed;
  s.step = step;
  s.sh_degree = o.sh_degree;
  s.active_sh_degree = sh_degree_at(o, f);
  s.rates = rates_at(o, f);
  s.opacity_weight = static_cast<float>(o.opacity_weight);
  s.scale_weight = static_cast<float>(o.scale_weight / o.radius);
  s.entropy_weight = static_cast<float>(o.entropy_weight);
  s.consistency_weight = static_cast<float>(o.consistency_weight * o.duration / o.radius);
  s.noise = f < kDensityEnd ? static_cast<float>(kNoise) : 0.0f;
  s.duration = static_cast<float>(o.duration);
  s.time_begin = static_cast<float>(time_begin);
  s.min_log_scale = std::max(-15.9f, log_of(o.radius * 1e-5));
  s.max_log_scale = std::min(15.9f, log_of(o.max_scale * o.radius));
  s.min_log_sigma = std::max(-15.9f, log_of(0.15 / o.fps));
  s.max_log_sigma = std::min(15.9f, log_of(30 * o.duration));
  const double center = time_begin + 0.5 * o.duration;
  s.min_mean_t = static_cast<float>(center - 40 * o.duration);
  s.max_mean_t = static_cast<float>(center + 40 * o.duration);
  return s;
}

std::vector<uint32_t> permutation(uint32_t n, uint64_t seed, uint64_t key, uint32_t use) {
  std::vector<uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0u);
  for (uint32_t k = n; k > 1; --k) {
    const Random4 r = philox(seed, key, k, static_cast<Use>(use));
    std::swap(order[k - 1], order[r.v[0] % k]);
  }
  return order;
}

}  // namespace l4d::train
