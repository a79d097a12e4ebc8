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
CodedComponent code_component(const float* rows, const float* weights, size_t n, size_t dim,
                              const std::vector<BlockRange>& blocks,
                              const ComponentSettings& settings);

// Drops Gaussians (keep[i] = 0) from a coded set.
void drop_gaussians(CodedComponent& component, const std::vector<uint8_t>& keep);

// What pages hold of the Gaussians `which`, in that order: depths and indices, or step_exponents,
// EOB indices and coefficients; `decoded` where there are escapes. Codebooks and bases stay behind.
CodedComponent codes_of(const CodedComponent& component, const std::vector<uint32_t>& which,
                        int threads);

// Leaves the codebooks or the basis alone.
void drop_codes(CodedComponent& component);

// Orders every codebook by use, most used first, without the entries nobody uses: small numbers
// become frequent, which any entropy coder after this likes. Changes no decoded value.
void sort_codebooks_by_frequency(CodedComponent& component, const std::vector<BlockRange>& blocks);

// The same as coefficients. weights: see code_transform.
CodedComponent code_component_transform(const float* rows, const float* weights, size_t n,
                                        size_t dim, const TransformSettings& settings);

// What the header will say of a coded component, but for where its chunks lie.
void describe_component(const CodedComponent& component, ComponentCoding* coding);

}  // namespace l4d
