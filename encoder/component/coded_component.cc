// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/coded_component.h"

#include <algorithm>
#include <numeric>
#include <type_traits>

#include "libl4dcodec/base/threads.h"

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

void sort_codebooks_by_frequency(CodedVq& c, const std::vector<BlockRange>& blocks) {
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

void drop_gaussians(CodedComponent& component, const std::vector<uint8_t>& keep) {
  const auto compact = [&](auto& values, size_t width) {
    size_t to = 0;
    for (size_t i = 0; i < keep.size(); ++i) {
      if (keep[i]) std::copy_n(values.data() + width * i, width, values.data() + width * to++);
    }
    values.resize(width * to);
  };
  CodedRows& rows = rows_of(component);
  compact(rows.decoded, rows.dim);
  rows.n = rows.decoded.size() / rows.dim;
  if (auto* vq = std::get_if<CodedVq>(&component)) {
    compact(vq->depth, 1);
    for (auto& index : vq->index) compact(index, 1);
  }
  if (auto* transform = std::get_if<CodedTransform>(&component)) {
    compact(transform->step_exponent, 1);
    compact(transform->eob_index, 1);
    for (auto& values : transform->coefficient) compact(values, 1);
  }
}

CodedComponent codes_of(const CodedComponent& component, const std::vector<uint32_t>& which,
                        int threads) {
  const size_t n = which.size();
  const auto pick = [&](const auto& from, size_t width, auto* to) {
    to->resize(n * width);
    parallel_for(threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        std::copy_n(from.data() + width * which[j], width, to->data() + width * j);
      }
    });
  };
  const auto pick_each = [&](const auto& from, auto* to) {
    to->resize(from.size());
    for (size_t k = 0; k < from.size(); ++k) pick(from[k], 1, &(*to)[k]);
  };
  if (const auto* vq = std::get_if<CodedVq>(&component)) {
    CodedVq out;
    out.n = n;
    out.dim = vq->dim;
    out.any_escape = vq->any_escape;
    pick(vq->depth, 1, &out.depth);
    pick_each(vq->index, &out.index);
    if (vq->any_escape) pick(vq->decoded, vq->dim, &out.decoded);
    return out;
  }
  if (const auto* transform = std::get_if<CodedTransform>(&component)) {
    CodedTransform out;
    out.n = n;
    out.dim = transform->dim;
    pick(transform->step_exponent, 1, &out.step_exponent);
    pick(transform->eob_index, 1, &out.eob_index);
    pick_each(transform->coefficient, &out.coefficient);
    return out;
  }
  return component;
}

void drop_codes(CodedComponent& component) {
  // Assigned, not cleared: their memory goes too.
  const auto drop = [](auto&... values) { ((values = std::decay_t<decltype(values)>()), ...); };
  CodedRows& rows = rows_of(component);
  drop(rows.n, rows.decoded);
  if (auto* vq = std::get_if<CodedVq>(&component)) drop(vq->depth, vq->index);
  if (auto* transform = std::get_if<CodedTransform>(&component)) {
    drop(transform->step_exponent, transform->eob_index, transform->coefficient);
  }
}

void describe_component(const CodedComponent& component, ComponentCoding* coding) {
  coding->coding = static_cast<ComponentCodingId>(component.index());
  if (const auto* transform = std::get_if<CodedTransform>(&component)) {
    coding->steps = transform->steps;
    coding->eob_table = transform->eob_table;
    coding->basis.num_entries = static_cast<uint32_t>(transform->steps.size() + 1);
  }
  const auto* vq = std::get_if<CodedVq>(&component);
  if (vq == nullptr) return;
  const auto entries = [&](const std::vector<float>& codebook) {
    return static_cast<uint32_t>(codebook.size() / vq->dim);
  };
  coding->escapes = vq->any_escape;
  coding->stages.resize(vq->codebooks.size());
  for (size_t s = 0; s < vq->codebooks.size(); ++s) {
    coding->stages[s].num_entries = entries(vq->codebooks[s]);
    coding->stages[s].step = s < vq->steps.size() ? vq->steps[s] : 0;
    coding->stages[s].element = coding->stages[s].step > 0 ? ElementType::kSq : ElementType::kF16;
  }
  coding->has_rcq = !vq->residual_codebook.empty();
  if (coding->has_rcq) coding->rcq.num_entries = entries(vq->residual_codebook);
}

}  // namespace l4d
