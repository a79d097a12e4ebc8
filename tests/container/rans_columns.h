// SPDX-License-Identifier: Apache-2.0
// Headers whose layers can have rANS pages, and random columns for them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/scene/morton.h"
#include "tests/common/headers.h"
#include "tests/common/random.h"

namespace l4d::test {

inline ComponentCoding example_transform(std::vector<uint8_t> eob_table, uint64_t seed) {
  ComponentCoding c;
  c.coding = ComponentCodingId::kTransform;
  c.eob_table = std::move(eob_table);
  c.steps.assign(c.eob_table.back(), 0.125f);
  c.basis = {c.eob_table.back() + 1u, ElementType::kF16, example_chunk(seed)};
  return c;
}

// The example with each of its layers' codebooks replaced by a transform, and fixed positions.
inline SceneHeader transform_header() {
  SceneHeader h = example_header();
  h.position = CoordinateCodingId::kFixed;
  h.position_bits = kMaxPositionBits;
  h.sh_degree = 3;
  h.sh = example_transform({1, 4, 11, 48}, 1);
  for (LayerHeader& l : h.layers) {
    l.mean_t_shift = l.permanent ? 0 : 3;
    l.component[L4D_COMPONENT_SCALE] = example_transform({1, 2, 3}, 10);
    l.component[L4D_COMPONENT_ROTOR_SPATIAL] = example_transform({3}, 11);
    l.component[L4D_COMPONENT_ROTOR_TEMPORAL] = ComponentCoding();
  }
  h.layers[1].component[L4D_COMPONENT_ROTOR_TEMPORAL] = example_transform({1, 3}, 12);
  h.layers[2].component[L4D_COMPONENT_ROTOR_TEMPORAL] = example_transform({2}, 13);
  h.layers[2].component[L4D_COMPONENT_SCALE] = example_vq(9, 1, false, 14);
  return h;
}

// Fixed mean times, in one layer refined.
inline void fix_mean_times(SceneHeader* h) {
  for (size_t l = 0; l < h->layers.size(); ++l) {
    LayerHeader& layer = h->layers[l];
    if (layer.permanent) continue;
    layer.mean_t = CoordinateCodingId::kFixed;
    layer.mean_t_shift = 0;
    layer.mean_t_bits = l % 2 == 0 ? kMaxMeanBits : 9;
    layer.mean_t_zero = 200;
    layer.mean_t_step = 0.01f;
    layer.mean_t_fine = l % 2 == 0;
  }
}

// Nothing but positions and mean times.
inline SceneHeader bare_header() {
  SceneHeader h = example_header();
  h.position = CoordinateCodingId::kFixed;
  h.position_bits = 1;
  h.opacity = ScalarCoding();
  h.sh = ComponentCoding();
  for (LayerHeader& l : h.layers) {
    l.mean_t_shift = l.permanent ? 0 : kMaxMeanShift;
    l.scale_factor = ScalarCoding();
    for (ComponentCoding& c : l.component) c = ComponentCoding();
  }
  return h;
}

// Between them: every kind of channel, and every kind of channel absent. Bases of SH are nothing, a
// part of a step of the EOB table, some steps and all coefficients.
inline std::vector<SceneHeader> rans_headers() {
  SceneHeader mixed = transform_header();
  mixed.position = CoordinateCodingId::kF16;
  mixed.sh = example_vq(kMaxCodebookEntries - 7, 8, true, 1);  // the last stage is the largest
  std::vector<SceneHeader> headers = {example_header(), bare_header(), mixed};
  for (const unsigned base : {0u, 3u, 11u, 48u}) {
    headers.push_back(transform_header());
    headers.back().sh_base = base;
  }
  headers.push_back(transform_header());
  fix_mean_times(&headers.back());
  headers.push_back(transform_header());
  for (LayerHeader& layer : headers.back().layers) {
    if (layer.permanent) continue;
    layer.mean_t = CoordinateCodingId::kWindow;
    layer.mean_t_shift = 0;
    layer.window_begin_bits = layer.level == 0 ? kMaxWindowBits : 2;
    layer.window_length_bits = layer.level == 0 ? 17 : 0;
  }
  return headers;
}

inline uint16_t random_half(Random& random) {
  const uint16_t bits = static_cast<uint16_t>(random.bits());
  return half_is_finite(bits) ? bits : static_cast<uint16_t>(bits & 0x83ffu);
}

inline void random_positions(const SceneHeader& header, Random& random, PageColumns* out) {
  const bool fixed = header.position == CoordinateCodingId::kFixed;
  std::vector<std::array<uint32_t, 3>> points(out->n);
  for (auto& p : points) {
    for (uint32_t& v : p) {
      v = fixed ? random.below(1u << header.position_bits) : order_half(random_half(random));
    }
  }
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) {
    return morton_code(a[0], a[1], a[2]) < morton_code(b[0], b[1], b[2]);
  });
  for (size_t axis = 0; axis < 3; ++axis) {
    for (const auto& p : points) {
      if (fixed) {
        out->fixed_position[axis].push_back(p[axis]);
      } else {
        out->position[axis].push_back(unorder_half(static_cast<uint16_t>(p[axis])));
      }
    }
  }
}

inline void random_transform(const ComponentCoding& coding, size_t n, Random& random,
                             ComponentColumns* out) {
  const bool told = coding.eob_table.size() > 1;
  const uint32_t step_exponents = 1 + random.below(kTransformStepExponents);
  for (size_t i = 0; i < n; ++i) {
    out->step_exponent.push_back(static_cast<uint8_t>(random.below(step_exponents)));
    const uint32_t eob_indices = static_cast<uint32_t>(coding.eob_table.size()) + 1;
    out->eob_index.push_back(static_cast<uint8_t>(told ? random.below(eob_indices) : 1));
    const unsigned count = eob_coefficients(coding, out->eob_index.back());
    for (unsigned k = 0; k < count; ++k) {
      constexpr int16_t kEnds[] = {0, 1, -1, INT16_MAX, INT16_MIN};
      const uint32_t kind = random.below(20);
      const int16_t q =
          kind < 5 ? kEnds[kind] : static_cast<int16_t>(static_cast<int>(random.below(31)) - 15);
      out->coefficient[k].push_back(q);
      ++out->coefficient_count[k];
    }
  }
}

inline void random_vq(const SceneHeader& header, const LayerHeader& layer, const BlockRecord* block,
                      unsigned component, size_t n, Random& random, ComponentColumns* out) {
  const ComponentCoding& coding = header.component(layer, component);
  const uint32_t stages = static_cast<uint32_t>(coding.stages.size());
  for (size_t i = 0; i < n; ++i) {
    uint32_t depth = coding.has_depth() ? random.below(stages + 1) : stages;
    if (coding.escapes && random.below(5) == 0) depth = kEscapeDepth;
    out->depth.push_back(static_cast<uint8_t>(depth));
    if (depth == kEscapeDepth) {
      ++out->num_escapes;
      for (unsigned k = 0; k < header.component_dim(layer, component); ++k) {
        out->escape.push_back(random_half(random));
      }
      continue;
    }
    for (uint32_t s = 0; s < depth; ++s) {
      const uint32_t entries =
          s == 0 ? stage0_entries(header, layer, component, block) : coding.stages[s].num_entries;
      out->index[s].push_back(static_cast<uint16_t>(random.below(entries)));
      ++out->index_count[s];
    }
  }
}

// Columns as an encoder would hand them over, positions in the order of their Morton codes.
inline PageColumns rans_columns(const SceneHeader& header, const LayerHeader& layer,
                                const BlockRecord* block, size_t n, uint64_t seed) {
  Random random(seed);
  PageColumns c;
  c.n = n;
  random_positions(header, random, &c);
  const auto codes = [&](const ScalarCoding& coding, std::vector<uint16_t>* to) {
    if (coding.coding != ScalarCodingId::kSq) return;
    for (size_t i = 0; i < n; ++i) {
      to->push_back(static_cast<uint16_t>(random.below(1u << coding.bits)));
    }
  };
  codes(header.opacity, &c.opacity);
  codes(layer.scale_factor, &c.scale_factor);
  while (layer.mean_t == CoordinateCodingId::kF16 && c.mean_t.size() < n) {
    const unsigned shift = layer.mean_t_shift;
    const unsigned code = static_cast<unsigned>(order_half(random_half(random))) >> shift;
    const uint16_t bits = unorder_half(static_cast<uint16_t>((code << shift) + (1u << shift >> 1)));
    if (half_is_finite(bits)) c.mean_t.push_back(bits);
  }
  for (size_t k = 0; k < kWindowColumns; ++k) {
    const unsigned width = layer.window_width(k);
    while (width > 0 && c.window[k].size() < n) {
      c.window[k].push_back(static_cast<uint16_t>(random.below(1u << width)));
    }
  }
  for (size_t i = 0; i < n && layer.mean_t == CoordinateCodingId::kFixed; ++i) {
    c.mean_t.push_back(static_cast<uint16_t>(random.below(1u << layer.mean_t_bits)));
    const unsigned bits = random.below(17);
    if (layer.mean_t_fine) c.mean_t_fine.push_back(static_cast<uint16_t>(random.below(1u << bits)));
  }
  for (unsigned i = 0; i < L4D_COMPONENT_COUNT; ++i) {
    const ComponentCoding& coding = header.component(layer, i);
    if (coding.transform()) random_transform(coding, n, random, &c.component[i]);
    if (coding.vq()) random_vq(header, layer, block, i, n, random, &c.component[i]);
  }
  return c;
}

template <typename T>
void expect_prefix(const char* what, const std::vector<T>& want, const std::vector<T>& got) {
  ASSERT_GE(got.size(), want.size()) << what;
  if (want.empty()) return;
  ASSERT_EQ(std::memcmp(want.data(), got.data(), want.size() * sizeof(T)), 0) << what;
}

// Without detail, SH is what the base chunk of a page that has two holds of it.
inline void expect_columns(const SceneHeader& header, const LayerHeader& layer, bool with_detail,
                           const PageColumns& want, const PageColumns& got) {
  ASSERT_EQ(want.n, got.n);
  EXPECT_EQ(got.sh_detail, with_detail);
  for (size_t axis = 0; axis < 3; ++axis) {
    expect_prefix("position", want.position[axis], got.position[axis]);
    expect_prefix("fixed position", want.fixed_position[axis], got.fixed_position[axis]);
  }
  expect_prefix("mean_t", want.mean_t, got.mean_t);
  expect_prefix("mean_t_fine", want.mean_t_fine, got.mean_t_fine);
  for (size_t k = 0; k < kWindowColumns; ++k) {
    expect_prefix("window", want.window[k], got.window[k]);
  }
  expect_prefix("opacity", want.opacity, got.opacity);
  expect_prefix("scale factor", want.scale_factor, got.scale_factor);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const bool base_only = c == L4D_COMPONENT_SH && !with_detail;
    if (base_only && header.sh_base == 0) continue;
    const ComponentCoding& coding = header.component(layer, c);
    const ComponentColumns& a = want.component[c];
    const ComponentColumns& b = got.component[c];
    if (coding.vq()) {
      if (coding.has_depth()) expect_prefix("depth", a.depth, b.depth);
      EXPECT_EQ(a.num_escapes, b.num_escapes);
      EXPECT_EQ(a.index_count, b.index_count);
      expect_prefix("escape", a.escape, b.escape);
      for (size_t s = 0; s < coding.stages.size(); ++s) {
        expect_prefix("index", a.index[s], b.index[s]);
      }
    }
    if (coding.transform()) {
      expect_prefix("class", a.step_exponent, b.step_exponent);
      expect_prefix("eob_index", a.eob_index, b.eob_index);
      for (unsigned k = 0; k < coding.coefficients(); ++k) {
        const bool there = !base_only || k < header.sh_base;
        EXPECT_EQ(b.coefficient_count[k], there ? a.coefficient_count[k] : 0);
        if (there) expect_prefix("coefficient", a.coefficient[k], b.coefficient[k]);
      }
    }
  }
}

}  // namespace l4d::test
