// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/rcq.h"

#include <algorithm>
#include <cmath>

#include "encoder/component/half_codebook.h"
#include "encoder/search/nearest.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

// A block codebook as the paper makes it, before its residuals are quantised.
struct LocalCodebook {
  std::vector<float> entries;    // [k, dim]
  std::vector<uint16_t> global;  // [k] nearest layer codeword
  std::vector<float> residual;   // [k, dim]
  std::vector<float> weight;     // [k] weight of the Gaussians assigned
};

// What a block costs under one of the two codings.
struct BlockCost {
  double distortion = 0;  // weighted
  double bits = 0;
};

// Ideal code length of indices: order-0 entropy times count.
double index_bits(const uint16_t* index, size_t n, size_t entries) {
  std::vector<uint32_t> count(entries, 0);
  for (size_t i = 0; i < n; ++i) ++count[index[i]];
  double bits = 0;
  for (const uint32_t c : count) {
    if (c > 0) bits += c * std::log2(static_cast<double>(n) / c);
  }
  return bits;
}

bool pays(const BlockCost& plain, const BlockCost& local, size_t n, size_t dim) {
  if (local.distortion <= 0) return local.bits < plain.bits;
  if (plain.distortion <= 0) return false;
  const double gain =
      static_cast<double>(n * dim) / 2 * std::log2(plain.distortion / local.distortion);
  return local.bits < plain.bits + gain;
}

// Of blocks side by side, each on one thread: they are too small to share among several.
ComponentSettings serial_settings(const ComponentSettings& settings) {
  ComponentSettings serial = settings;
  serial.threads = 1;
  serial.device = nullptr;
  serial.cancelled = nullptr;  // the callback belongs to the calling thread
  return serial;
}

uint32_t block_entries(const BlockRange& block, size_t most) {
  return useful_entries(static_cast<uint32_t>(most), block.end - block.begin);
}

std::vector<float> train_block(const float* rows, const float* weights, size_t dim,
                               const std::vector<BlockRange>& blocks, size_t b, size_t most,
                               const ComponentSettings& serial) {
  const size_t begin = blocks[b].begin;
  if (blocks[b].end == begin) return {};
  return train_half_codebook(rows + begin * dim, weights + begin, blocks[b].end - begin, dim,
                             block_entries(blocks[b], most), serial, 0x100 + uint64_t{b});
}

LocalCodebook make_local(const float* rows, const float* weights, size_t n, size_t dim,
                         const std::vector<float>& global, std::vector<float> entries,
                         const ComponentSettings& settings) {
  LocalCodebook local;
  local.entries = std::move(entries);
  const size_t k = local.entries.size() / dim;
  if (k == 0) return local;  // a block of escapes alone
  std::vector<uint32_t> nearest(k);
  std::vector<float> distance(std::max(n, k));
  assign_nearest(local.entries.data(), k, dim, global.data(), global.size() / dim, settings.threads,
                 nullptr, nearest.data(), distance.data());
  local.global.assign(nearest.begin(), nearest.end());
  local.residual.resize(k * dim);
  for (size_t e = 0; e < k; ++e) {
    for (size_t d = 0; d < dim; ++d) {
      local.residual[e * dim + d] = local.entries[e * dim + d] - global[nearest[e] * dim + d];
    }
  }
  std::vector<uint32_t> labels(n);
  assign_nearest(rows, n, dim, local.entries.data(), k, settings.threads, nullptr, labels.data(),
                 distance.data());
  local.weight.assign(k, 0.0f);
  for (size_t i = 0; i < n; ++i) local.weight[labels[i]] += weights[i];
  return local;
}

// The block coded through pairs, as a decoder sees it.
struct CodedBlock {
  std::vector<RcqPair> table;
  std::vector<float> entries;  // [k, dim]
  std::vector<uint32_t> labels;
  std::vector<float> distance;
};

CodedBlock code_block(const float* rows, size_t n, size_t dim, const LocalCodebook& local,
                      const std::vector<float>& global, const std::vector<float>& residual_codebook,
                      const ComponentSettings& settings) {
  CodedBlock out;
  const size_t k = local.global.size();
  if (k == 0) return out;
  std::vector<uint32_t> nearest(k);
  out.distance.resize(std::max(n, k));
  assign_nearest(local.residual.data(), k, dim, residual_codebook.data(),
                 residual_codebook.size() / dim, settings.threads, nullptr, nearest.data(),
                 out.distance.data());
  out.table.resize(k);
  out.entries.resize(k * dim);
  for (size_t e = 0; e < k; ++e) {
    out.table[e] = {local.global[e], static_cast<uint16_t>(nearest[e])};
    for (size_t d = 0; d < dim; ++d) {
      out.entries[e * dim + d] =
          global[local.global[e] * dim + d] + residual_codebook[nearest[e] * dim + d];
    }
  }
  out.labels.resize(n);
  assign_nearest(rows, n, dim, out.entries.data(), k, settings.threads, nullptr, out.labels.data(),
                 out.distance.data());
  return out;
}

}  // namespace

std::vector<std::vector<float>> train_block_codebooks(const float* rows, const float* weights,
                                                      size_t dim,
                                                      const std::vector<BlockRange>& blocks,
                                                      const ComponentSettings& settings,
                                                      size_t most) {
  const ComponentSettings serial = serial_settings(settings);
  std::vector<std::vector<float>> codebooks(blocks.size());
  parallel_for(settings.threads, blocks.size(), 1, [&](size_t b, size_t) {
    codebooks[b] = train_block(rows, weights, dim, blocks, b, most, serial);
  });
  return codebooks;
}

void code_blocks(const float* rows, const float* weights, const std::vector<BlockRange>& blocks,
                 const ComponentSettings& settings, const std::vector<float>& distance,
                 const std::vector<std::vector<float>>& block_codebooks, CodedVq* component) {
  CodedVq& c = *component;
  const size_t dim = c.dim;
  const std::vector<float>& global = c.codebooks[0];
  const ComponentSettings serial = serial_settings(settings);
  const size_t most = global.size() / dim;
  std::vector<LocalCodebook> locals(blocks.size());
  parallel_for(settings.threads, blocks.size(), 1, [&](size_t b, size_t) {
    const size_t begin = blocks[b].begin;
    const bool too_large = block_codebooks[b].size() / dim > block_entries(blocks[b], most);
    locals[b] = make_local(
        rows + begin * dim, weights + begin, blocks[b].end - begin, dim, global,
        too_large ? train_block(rows, weights, dim, blocks, b, most, serial) : block_codebooks[b],
        serial);
  });
  std::vector<float> residuals, residual_weights;
  for (size_t b = 0; b < blocks.size(); ++b) {
    residuals.insert(residuals.end(), locals[b].residual.begin(), locals[b].residual.end());
    residual_weights.insert(residual_weights.end(), locals[b].weight.begin(),
                            locals[b].weight.end());
  }
  const size_t num_residuals = residual_weights.size();
  if (num_residuals == 0) return;
  const std::vector<float> residual_codebook =
      train_half_codebook(residuals.data(), residual_weights.data(), num_residuals, dim,
                          useful_entries(settings.rcq_size, num_residuals), settings, 0x10);
  const double pair_bits = std::log2(static_cast<double>(global.size() / dim)) +
                           std::log2(static_cast<double>(residual_codebook.size() / dim));

  std::vector<CodedBlock> coded(blocks.size());
  parallel_for(settings.threads, blocks.size(), 1, [&](size_t b, size_t) {
    const size_t begin = blocks[b].begin;
    coded[b] = code_block(rows + begin * dim, blocks[b].end - begin, dim, locals[b], global,
                          residual_codebook, serial);
  });
  std::vector<uint8_t> use(blocks.size(), 0);
  BlockCost plain_total, local_total;
  size_t used_gaussians = 0;
  for (size_t b = 0; b < blocks.size(); ++b) {
    const size_t begin = blocks[b].begin;
    const size_t n = blocks[b].end - begin;
    if (n == 0) continue;
    BlockCost plain, local;
    std::vector<uint16_t> index(coded[b].labels.begin(), coded[b].labels.end());
    plain.bits = index_bits(c.index[0].data() + begin, n, global.size() / dim);
    local.bits = index_bits(index.data(), n, coded[b].table.size()) +
                 pair_bits * static_cast<double>(coded[b].table.size());
    for (size_t i = 0; i < n; ++i) {
      plain.distortion += static_cast<double>(weights[begin + i]) * distance[begin + i];
      local.distortion += static_cast<double>(weights[begin + i]) * coded[b].distance[i];
    }
    use[b] = settings.rcq == 2 || pays(plain, local, n, dim);
    if (!use[b]) continue;
    used_gaussians += n;
    plain_total.bits += plain.bits;
    plain_total.distortion += plain.distortion;
    local_total.bits += local.bits;
    local_total.distortion += local.distortion;
  }
  // The residual codebook itself must be earned by all blocks together.
  local_total.bits += 16.0 * static_cast<double>(residual_codebook.size());
  if (settings.rcq != 2 && !pays(plain_total, local_total, used_gaussians, dim)) return;
  c.residual_codebook = residual_codebook;
  c.block_tables.resize(blocks.size());
  for (size_t b = 0; b < blocks.size(); ++b) {
    if (!use[b]) continue;
    c.block_tables[b] = std::move(coded[b].table);
    for (size_t i = blocks[b].begin; i < blocks[b].end; ++i) {
      const uint32_t label = coded[b].labels[i - blocks[b].begin];
      c.index[0][i] = static_cast<uint16_t>(label);
      std::copy_n(coded[b].entries.data() + label * dim, dim, c.decoded.data() + i * dim);
    }
  }
}

}  // namespace l4d
