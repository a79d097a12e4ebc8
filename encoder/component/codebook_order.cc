// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <numeric>

#include "encoder/component/codebook_coder.h"

namespace l4d {
namespace {

// old index -> new index, most used first; unused entries are dropped. At least one entry stays.
std::vector<uint32_t> rank_by_use(const std::vector<uint64_t>& use, uint32_t* kept) {
  std::vector<uint32_t> order(use.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return use[a] > use[b]; });
  std::vector<uint32_t> rank(use.size());
  *kept = 0;
  for (uint32_t r = 0; r < order.size(); ++r) {
    rank[order[r]] = r;
    if (use[order[r]] > 0) *kept = r + 1;
  }
  *kept = std::max(*kept, 1u);
  return rank;
}

void permute_codebook(std::vector<float>& codebook, size_t dim, const std::vector<uint32_t>& rank,
                      uint32_t kept) {
  std::vector<float> ranked(size_t{kept} * dim);
  for (size_t e = 0; e < rank.size(); ++e) {
    if (rank[e] < kept) std::copy_n(codebook.data() + e * dim, dim, ranked.data() + rank[e] * dim);
  }
  codebook = std::move(ranked);
}

}  // namespace

void sort_codebooks_by_frequency(CodedComponent& c, const std::vector<BlockRange>& blocks) {
  if (c.is_transform()) return;
  // Which Gaussians index a block codebook instead of the layer's.
  std::vector<uint8_t> in_block(c.n, 0);
  for (size_t b = 0; b < c.block_tables.size(); ++b) {
    if (c.block_tables[b].empty()) continue;
    std::fill(in_block.begin() + static_cast<std::ptrdiff_t>(blocks[b].begin),
              in_block.begin() + static_cast<std::ptrdiff_t>(blocks[b].end), uint8_t{1});
  }
  // Block tables first: what they do not use need not stay in the codebooks behind them.
  for (size_t b = 0; b < c.block_tables.size(); ++b) {
    std::vector<RcqPair>& table = c.block_tables[b];
    if (table.empty()) continue;
    std::vector<uint64_t> use(table.size(), 0);
    for (size_t i = blocks[b].begin; i < blocks[b].end; ++i) {
      use[c.index[0][i]] += c.depth[i] != kEscapeDepth;
    }
    uint32_t kept = 0;
    const std::vector<uint32_t> rank = rank_by_use(use, &kept);
    std::vector<RcqPair> ranked(kept);
    for (size_t e = 0; e < table.size(); ++e) {
      if (rank[e] < kept) ranked[rank[e]] = table[e];
    }
    table = std::move(ranked);
    for (size_t i = blocks[b].begin; i < blocks[b].end; ++i) {
      if (c.depth[i] == kEscapeDepth) continue;
      c.index[0][i] = static_cast<uint16_t>(rank[c.index[0][i]]);
    }
  }
  for (size_t s = 0; s < c.codebooks.size(); ++s) {
    const auto uses_codebook = [&](size_t i) {
      return c.depth[i] != kEscapeDepth && c.depth[i] > s && !(s == 0 && in_block[i]);
    };
    std::vector<uint64_t> use(c.codebooks[s].size() / c.dim, 0);
    for (size_t i = 0; i < c.n; ++i) use[c.index[s][i]] += uses_codebook(i);
    if (s == 0) {
      for (const auto& table : c.block_tables) {
        for (const RcqPair& p : table) ++use[p.global];
      }
    }
    uint32_t kept = 0;
    const std::vector<uint32_t> rank = rank_by_use(use, &kept);
    permute_codebook(c.codebooks[s], c.dim, rank, kept);
    for (size_t i = 0; i < c.n; ++i) {
      if (uses_codebook(i)) c.index[s][i] = static_cast<uint16_t>(rank[c.index[s][i]]);
    }
    if (s == 0) {
      for (auto& table : c.block_tables) {
        for (RcqPair& p : table) p.global = static_cast<uint16_t>(rank[p.global]);
      }
    }
  }
  if (!c.residual_codebook.empty()) {
    std::vector<uint64_t> use(c.residual_codebook.size() / c.dim, 0);
    for (const auto& table : c.block_tables) {
      for (const RcqPair& p : table) ++use[p.residual];
    }
    uint32_t kept = 0;
    const std::vector<uint32_t> rank = rank_by_use(use, &kept);
    permute_codebook(c.residual_codebook, c.dim, rank, kept);
    for (auto& table : c.block_tables) {
      for (RcqPair& p : table) p.residual = static_cast<uint16_t>(rank[p.residual]);
    }
  }
}

}  // namespace l4d
