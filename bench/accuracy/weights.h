// SPDX-License-Identifier: Apache-2.0
// Importance weights measured by the renderer, and how much two sets of them agree.
#pragma once

#include <string>

#include "bench/accuracy/scene.h"
#include "eval/views/importance.h"

namespace l4d::bench {

using Measured = eval::MeasuredImportance;

// measure: L4D_SENSITIVITY_*.
l4d_measure_options measure_options(uint32_t metric, double agreement, double max_share = 1);

// All training cameras at all instants. renderer: NULL for the defaults.
Measured measure(const BenchScene& scene, const l4d_measure_options& options,
                 const l4d_renderer_options* renderer = nullptr);
// As the tool measures a scene that comes without cameras.
Measured measure_made_up(const io::Scene& scene, uint32_t backend = L4D_BACKEND_CPU);
// The first, taken from `path` if that was written for this scene, these cameras and options.
Measured measure_cached(const BenchScene& scene, const l4d_measure_options& options,
                        const std::string& path);

// Spearman's rank correlation over Gaussians with a weight in either; 1 where there is nothing to
// rank.
double rank_correlation(const std::vector<float>& a, const std::vector<float>& b);

}  // namespace l4d::bench
