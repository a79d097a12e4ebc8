// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "training/step/adam.h"

// How rates and phases follow the progress f in [0, 1) of a training, and which views a step takes.
namespace l4d::train {

struct ScheduleOptions {
  double radius = 1;    // R: the size of the capture, scene units
  double duration = 1;  // T, s
  double fps = 30;
  uint32_t sh_degree = 3;
  double drift = 2;        // kappa: bounds the temporal rotor's rate; 0 = the rate of the others
  double rate_factor = 1;  // of all rates; the guard halves it
  // Regularisers, see AdamStep; the scales' is of scales in units of the radius, so that the unit
  // of the capture does not matter.
  double opacity_weight = 0.015;
  double scale_weight = 0.05;
  double entropy_weight = 0;
  double consistency_weight = 0;  // of velocities in radii by the duration
  double max_scale = 1;           // of Gaussians, in units of the radius
};

// The phases of f.
constexpr double kDensityBegin = 500;    // steps
constexpr double kDensityEnd = 0.85;     // no growth, relocation and noise from here on
constexpr double kSettleRates = 0.1;     // of constant rates after kDensityEnd
constexpr double kHalfResolution = 0.1;  // images have half their size before

Rates rates_at(const ScheduleOptions& options, double f);
uint32_t sh_degree_at(const ScheduleOptions& options, double f);
// Rates, degree, weights of regularisers, noise and ranges of step `step`; the caller sets `count`.
AdamStep adam_step_at(const ScheduleOptions& options, double f, uint64_t seed, uint64_t step,
                      double time_begin);

// A permutation of 0 .. n - 1 that depends on (seed, key, use) alone.
std::vector<uint32_t> permutation(uint32_t n, uint64_t seed, uint64_t key, uint32_t use);

}  // namespace l4d::train
