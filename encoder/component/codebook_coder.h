// SPDX-License-Identifier: Apache-2.0
// Vector quantisation of one component over one set of Gaussians: stage 0 (optionally through block
// codebooks), residual stages for those that need them most, escapes above a weight.
#pragma once

#include <cstdint>
#include <vector>

#include "encoder/component/coded_component.h"
#include "encoder/prepare/settings.h"

namespace l4d {

// What the parameters say of a component, but for seed, threads and cancelling.
ComponentSettings component_settings(const EncoderSettings& settings, unsigned component);

// rows: [n, dim]; weights: [n].
CodedVq code_vq(const float* rows, const float* weights, size_t n, size_t dim,
                const std::vector<BlockRange>& blocks, const ComponentSettings& settings);

}  // namespace l4d
