// SPDX-License-Identifier: Apache-2.0
// What transforms, fixed positions and rANS pages add to the scene header.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/container/rans_columns.h"

namespace l4d {
namespace {

constexpr unsigned kScale = L4D_COMPONENT_SCALE;
constexpr unsigned kSpatial = L4D_COMPONENT_ROTOR_SPATIAL;
constexpr unsigned kTemporal = L4D_COMPONENT_ROTOR_TEMPORAL;

Status parse(const SceneHeader& header, SceneHeader* out) {
  return parse_scene_header(serialize_scene_header(header), 0, out);
}

TEST(TransformHeader, RoundTrip) {
  SceneHeader a = test::transform_header();
  a.sh.steps[5] = 0x1p-20f;
  a.sh.steps[6] = 0x1p10f;
  a.layers[1].component[kSpatial].steps[2] = 1;
  a.layers[1].has_entropy = true;
  a.layers[1].entropy = test::example_chunk(77);
  a.sh_base = 48;
  test::fix_mean_times(&a);
  SceneHeader b;
  const Status s = parse(a, &b);
  ASSERT_TRUE(s.ok()) << s.detail();
  EXPECT_EQ(b.position, CoordinateCodingId::kFixed);
  EXPECT_EQ(b.position_bits, kMaxPositionBits);
  EXPECT_EQ(b.sh_base, 48u);
  ASSERT_EQ(b.layers.size(), a.layers.size());
  for (size_t l = 0; l < a.layers.size(); ++l) {
    EXPECT_EQ(b.layers[l].mean_t, a.layers[l].mean_t);
    EXPECT_EQ(b.layers[l].mean_t_shift, a.layers[l].mean_t_shift);
    EXPECT_EQ(b.layers[l].mean_t_bits, a.layers[l].mean_t_bits);
    EXPECT_EQ(b.layers[l].mean_t_zero, a.layers[l].mean_t_zero);
    EXPECT_EQ(b.layers[l].mean_t_step, a.layers[l].mean_t_step);
    EXPECT_EQ(b.layers[l].mean_t_fine, a.layers[l].mean_t_fine);
    EXPECT_EQ(b.layers[l].has_entropy, a.layers[l].has_entropy);
    EXPECT_EQ(b.layers[l].entropy.hash, a.layers[l].entropy.hash);
    EXPECT_EQ(b.layers[l].entropy.raw_bytes, a.layers[l].entropy.raw_bytes);
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const ComponentCoding& x = a.component(a.layers[l], c);
      const ComponentCoding& y = b.component(b.layers[l], c);
      ASSERT_EQ(x.coding, y.coding);
      EXPECT_EQ(x.steps, y.steps);
      EXPECT_EQ(x.eob_table, y.eob_table);
      EXPECT_EQ(x.basis.num_entries, y.basis.num_entries);
      EXPECT_EQ(x.basis.codebook.offset, y.basis.codebook.offset);
    }
  }
}

struct Rule {
  const char* clause;
  void (*edit)(SceneHeader&);
};
const Rule kRules[] = {
    {"CODE-5", [](SceneHeader& h) { h.position_bits = 0; }},
    {"CODE-5", [](SceneHeader& h) { h.position_bits = kMaxPositionBits + 1; }},
    {"CODE-6", [](SceneHeader& h) { h.layers[2].mean_t_shift = kMaxMeanShift + 1; }},
    {"TIME-1",
     [](SceneHeader& h) {
       test::fix_mean_times(&h);
       h.layers[1].mean_t_bits = 0;
     }},
    {"TIME-1",
     [](SceneHeader& h) {
       test::fix_mean_times(&h);
       h.layers[2].mean_t_bits = kMaxMeanBits + 1;
     }},
    {"TIME-2",
     [](SceneHeader& h) {
       test::fix_mean_times(&h);
       h.layers[1].mean_t_step = 0x1p-61f;
     }},
    {"TIME-2",
     [](SceneHeader& h) {
       test::fix_mean_times(&h);
       h.layers[1].mean_t_step = std::numeric_limits<float>::quiet_NaN();
     }},
    {"CODE-7",
     [](SceneHeader& h) {
       h.layers[1].component[kScale] = test::example_vq(4, 1, false, 3);
       h.layers[1].component[kScale].stages[0].element = ElementType::kSq;
       h.layers[1].component[kScale].stages[0].step = 0x1p-21f;
     }},
    {"CODE-7",
     [](SceneHeader& h) {
       h.layers[1].component[kScale] = test::example_vq(4, 1, false, 3);
       h.layers[1].component[kScale].stages[0].element = ElementType::kSq;
       h.layers[1].component[kScale].stages[0].step = 1025;
     }},
    {"TRAN-8",
     [](SceneHeader& h) {
       h.sh.basis.element = ElementType::kSq;
       h.sh.basis.step = 1;
     }},
    {"TRAN-8",
     [](SceneHeader& h) {
       h.layers[1].component[kSpatial].basis.element = ElementType::kSq;
       h.layers[1].component[kSpatial].basis.step = 1;
     }},
    {"HEAD-14", [](SceneHeader& h) { h.layers[1].scale_factor.coding = ScalarCodingId::kRaw32; }},
    {"HEAD-15",
     [](SceneHeader& h) { h.layers[1].component[kTemporal] = test::example_vq(4, 1, false, 3); }},
    {"HEAD-15",
     [](SceneHeader& h) { h.layers[1].component[kSpatial] = test::example_vq(4, 1, false, 3); }},
    {"HEAD-15", [](SceneHeader& h) { h.layers[2].component[kSpatial] = ComponentCoding(); }},
    {"TRAN-1",
     [](SceneHeader& h) {
       h.sh.steps.clear();
       h.sh.basis.num_entries = 1;
     }},
    {"TRAN-1",
     [](SceneHeader& h) {
       h.sh.steps.push_back(1);
       h.sh.eob_table.back() = 49;
       h.sh.basis.num_entries = 50;
     }},
    {"TRAN-1",
     [](SceneHeader& h) {
       h.layers[1].component[kSpatial] = test::example_transform({1, 4}, 3);
     }},
    {"TRAN-1",
     [](SceneHeader& h) {
       h.layers[0].component[L4D_COMPONENT_SCALE] = test::example_transform({4}, 3);
     }},
    {"TRAN-2", [](SceneHeader& h) { h.sh.steps[47] = std::nextafterf(0x1p-20f, 0); }},
    {"TRAN-2", [](SceneHeader& h) { h.sh.steps[0] = std::nextafterf(0x1p10f, 2000); }},
    {"TRAN-2", [](SceneHeader& h) { h.sh.steps[0] = -1; }},
    {"TRAN-2", [](SceneHeader& h) { h.sh.steps[1] = std::numeric_limits<float>::quiet_NaN(); }},
    {"TRAN-2",
     [](SceneHeader& h) { h.layers[1].component[kSpatial].steps[0] = std::nextafterf(1, 2); }},
    {"TRAN-2", [](SceneHeader& h) { h.layers[1].component[kTemporal].steps[2] = 2; }},
    {"TRAN-3", [](SceneHeader& h) { h.sh.eob_table.clear(); }},
    {"TRAN-3",
     [](SceneHeader& h) {
       h.sh.eob_table = {0, 48};
     }},
    {"TRAN-3",
     [](SceneHeader& h) {
       h.sh.eob_table = {3, 3, 48};
     }},
    {"TRAN-3", [](SceneHeader& h) { h.sh.eob_table = {47}; }},
    {"TRAN-3",
     [](SceneHeader& h) {
       h.sh.eob_table = {48, 49};
     }},
    {"TRAN-4", [](SceneHeader& h) { h.sh.basis.num_entries = 48; }},
    {"TRAN-4", [](SceneHeader& h) { h.sh.basis.num_entries = 50; }},
    {"TRAN-7", [](SceneHeader& h) { h.sh_base = 49; }},
    {"TRAN-7", [](SceneHeader& h) { h.sh_base = 255; }},
    {"TRAN-7",
     [](SceneHeader& h) {
       h.sh = test::example_vq(9, 1, false, 1);
       h.sh_base = 1;
     }},
    {"TRAN-7",
     [](SceneHeader& h) {
       h.sh = ComponentCoding();
       h.sh_base = 1;
     }},
};

// spec: CODE-5, CODE-6, CODE-7, HEAD-14, HEAD-15, TRAN-1, TRAN-2, TRAN-3, TRAN-4, TRAN-7, TRAN-8,
// TIME-1, TIME-2
TEST(TransformHeader, EachRuleIsChecked) {
  for (const Rule& rule : kRules) {
    SceneHeader header = test::transform_header();
    rule.edit(header);
    SceneHeader out;
    const Status s = parse(header, &out);
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT) << rule.clause << ", rule " << &rule - kRules;
    EXPECT_STREQ(s.clause(), rule.clause) << s.detail() << ", rule " << &rule - kRules;
  }
}

// spec: HEAD-7
TEST(TransformHeader, UnknownIdsAreNamed) {
  void (*const edits[])(SceneHeader&) = {
      [](SceneHeader& h) { h.position = static_cast<CoordinateCodingId>(6); },
      [](SceneHeader& h) { h.layers[1].mean_t = static_cast<CoordinateCodingId>(6); },
      [](SceneHeader& h) { h.sh.coding = static_cast<ComponentCodingId>(4); },
      [](SceneHeader& h) { h.sh.basis.element = static_cast<ElementType>(2); }};
  for (const auto& edit : edits) {
    SceneHeader header = test::transform_header();
    edit(header);
    SceneHeader out;
    const Status s = parse(header, &out);
    EXPECT_EQ(s.code(), L4D_ERR_FEATURE_UNSUPPORTED) << &edit - edits;
    EXPECT_STREQ(s.clause(), "HEAD-7") << &edit - edits;
  }
}

// Where a rotor is no transform, one part of it may be absent, or both.
TEST(TransformHeader, PairsOfRotors) {
  for (const bool spatial : {false, true}) {
    for (const bool temporal : {false, true}) {
      SceneHeader header = test::transform_header();
      auto& parts = header.layers[1].component;
      if (!spatial) parts[kSpatial] = ComponentCoding();
      if (!temporal) parts[kTemporal] = ComponentCoding();
      SceneHeader out;
      EXPECT_EQ(parse(header, &out).ok(), spatial || !temporal) << spatial << temporal;
    }
  }
}

}  // namespace
}  // namespace l4d
