// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/coding_cost.h"

#include <algorithm>
#include <cmath>

#include "encoder/component/stage_choice.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/entropy/rans_encoder.h"

namespace l4d {

double component_bits(const CodedTransform& t) {
  ChannelBits step_exponents(1), eob_indices(kTransformStepExponents);
  double bits = codebook_bits(static_cast<double>(t.steps.size() + 1), t.dim);
  for (size_t i = 0; i < t.n; ++i) {
    step_exponents.add(0, t.step_exponent[i]);
    eob_indices.add(t.step_exponent[i], t.eob_index[i]);
  }
  bits += step_exponents.total() + eob_indices.total();
  ComponentCoding coding;
  coding.eob_table = t.eob_table;
  std::vector<uint8_t> have(t.n);
  for (size_t i = 0; i < t.n; ++i) {
    have[i] = static_cast<uint8_t>(eob_coefficients(coding, t.eob_index[i]));
  }
  const auto magnitude = [&](size_t k, size_t i) {
    return static_cast<unsigned>(std::abs(int{t.coefficient[k][i]}));
  };
  for (size_t k = 0; k < t.coefficient.size(); ++k) {
    ChannelBits channel(size_t{kTransformStepExponents} * kMagnitudes);
    for (size_t i = 0; i < t.n; ++i) {
      if (have[i] <= k) continue;
      unsigned before = k > 0 ? magnitude(k - 1, i) : 0;
      if (k > 1) before += magnitude(k - 2, i);
      channel.add(t.step_exponent[i] * kMagnitudes + magnitude_context(before),
                  zigzag16(t.coefficient[k][i]));
    }
    bits += channel.total();
  }
  return bits;
}

void ChannelBits::add(size_t context, uint16_t value) {
  const RansToken token = hybrid_token(value);
  std::vector<uint32_t>& counts = counts_[context];
  if (counts.size() <= token.token) counts.resize(token.token + 1, 0);
  ++counts[token.token];
  raw_ += token.bits;
}

double ChannelBits::total() const {
  double nats = 0;
  for (const std::vector<uint32_t>& counts : counts_) {
    if (counts.empty()) continue;
    const double half = 0.5 * static_cast<double>(counts.size());
    double sum = 0;
    for (const uint32_t c : counts) {
      sum += static_cast<double>(c);
      nats -= std::lgamma(static_cast<double>(c) + 0.5) - std::lgamma(0.5);
    }
    nats += std::lgamma(sum + half) - std::lgamma(half);
  }
  return raw_ + nats / std::log(2.0);
}

double component_bits(const CodedVq& c) {
  double bits = 0;
  ChannelBits depths(1);
  std::vector<ChannelBits> stages(c.codebooks.size(), ChannelBits(1));
  for (size_t i = 0; i < c.n; ++i) {
    if (c.codebooks.size() > 1 || c.any_escape) depths.add(0, c.depth[i]);
    if (c.depth[i] == kEscapeDepth) {
      bits += 16 * static_cast<double>(c.dim);
      continue;
    }
    for (size_t s = 0; s < c.depth[i]; ++s) stages[s].add(0, c.index[s][i]);
  }
  bits += depths.total();
  for (size_t s = 0; s < c.codebooks.size(); ++s) {
    bits += stages[s].total() +
            codebook_bits(static_cast<double>(c.codebooks[s].size() / c.dim), c.dim);
  }
  return bits;
}

double codes_bits(const std::vector<uint16_t>& codes) {
  ChannelBits channel(1);
  for (const uint16_t code : codes) channel.add(0, code);
  return channel.total();
}

double weighted_error(const float* rows, const float* decoded, const float* importance, size_t n,
                      size_t dim) {
  double sum = 0;
  for (size_t i = 0; i < n; ++i) {
    double e2 = 0;
    for (size_t k = 0; k < dim; ++k) {
      const double e =
          static_cast<double>(rows[i * dim + k]) - static_cast<double>(decoded[i * dim + k]);
      e2 += e * e;
    }
    sum += static_cast<double>(importance[i]) * e2;
  }
  return sum;
}

}  // namespace l4d
