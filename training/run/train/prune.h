// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/ply/weights.h"
#include "training/capture/capture.h"
#include "training/images/loader.h"
#include "training/model/state.h"

// Removal of the Gaussians whose bits buy the least: rows of a stream cost nearly the same, so
// those go first whose removal changes images least.
namespace l4d::train {

// What the views lose without each row, up to a factor of all: (o w)^2, where o is the opacity and
// w its Gauss-Newton weight (L4D_WEIGHT_OPACITY). views: indices of the capture's, which
// count all alike. Returns [model.count].
std::vector<float> loss_without(const ModelState& model, const Capture& capture,
                                const ImageLoader& loader, const std::vector<uint32_t>& views,
                                const l4d_renderer_options& rendering, uint64_t seed);
// With weights that are known, [model.count].
std::vector<float> loss_without(const ModelState& model, std::vector<float> weights);

// An encode by weights alone, of which the encoder drops rows that cost more bits than they show.
struct TrialEncode {
  uint64_t bytes = 0;
  std::vector<uint8_t> kept;  // a mask of the rows
};
// threads: 0 = one per core; never changes the result.
TrialEncode trial_encode(const io::Scene& scene, const io::Weights& weights,
                         const std::string& preset, uint32_t threads);

// The share of rows that goes at a prune so that after `left` of them, this one included, what
// takes `bytes` now takes `size`; 0 where it takes no more.
double share_over(uint64_t bytes, uint64_t size, uint64_t left);

// A mask of the rows that stay, where the given share of them with the smallest values goes; at
// least one stays. Of equal values, later rows go first.
std::vector<uint8_t> most_important(const std::vector<float>& values, double share);

}  // namespace l4d::train
