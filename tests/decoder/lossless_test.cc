// SPDX-License-Identifier: Apache-2.0
// Lossless streams give the bits that went in.
#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "tests/common/codec.h"
#include "tests/common/flush_to_zero.h"
#include "tests/common/random.h"
#include "tests/decoder/rows.h"

namespace l4d {
namespace {

using namespace test;

EncodeOptions lossless_options() {
  EncodeOptions o;
  o.preset = "lossless";
  o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 128}, {L4D_ENC_ZSTD_LEVEL, 3}};
  return o;
}

// The input in the order that the encoder reports.
GaussianArrays permuted(const TestScene& s, const std::vector<uint32_t>& order) {
  GaussianArrays a;
  a.sh_degree = s.sh_degree;
  a.flags = s.flags;
  const auto take = [&](const std::vector<float>& from, size_t dim, std::vector<float>* to) {
    for (const uint32_t i : order) {
      to->insert(to->end(), from.begin() + static_cast<std::ptrdiff_t>(dim * i),
                 from.begin() + static_cast<std::ptrdiff_t>(dim * (i + 1)));
    }
  };
  take(s.position, 3, &a.position);
  take(s.mean_t, 1, &a.mean_t);
  take(s.log_scale, 4, &a.log_scale);
  take(s.rotor, 8, &a.rotor);
  take(s.opacity, 1, &a.opacity);
  take(s.sh, s.sh_dim(), &a.sh);
  return a;
}

void expect_exact(const TestScene& scene) {
  const Encoded e = encode(scene, lossless_options());
  GaussianArrays got = decode(e.bytes, all_query());
  EXPECT_EQ(got.flags, scene.flags);
  std::vector<bool> seen(scene.count(), false);
  for (const uint32_t i : e.order) {
    ASSERT_LT(i, scene.count());
    EXPECT_FALSE(seen[i]);
    seen[i] = true;
  }
  ASSERT_EQ(e.order.size(), scene.count());
  const GaussianArrays want = permuted(scene, e.order);
  EXPECT_EQ(rows(want), rows(got));
  got.mean_t_local.clear();  // no part of the input
  got.spans.clear();
  EXPECT_TRUE(same_bits(want, got));
}

TEST(Lossless, EveryDegreeAndMeaning) {
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    for (const uint32_t flags :
         {0u, uint32_t{L4D_POSITION_AT_MEAN_TIME}, uint32_t{L4D_OPACITY_LOGIT},
          uint32_t{L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT}}) {
      SCOPED_TRACE("degree " + std::to_string(degree) + ", flags " + std::to_string(flags));
      SceneOptions o;
      o.count = 600;
      o.sh_degree = degree;
      o.seed = degree;
      TestScene scene = make_scene(o);
      scene.flags = flags;
      if ((flags & L4D_OPACITY_LOGIT) != 0) {
        for (float& v : scene.opacity) v = 20 * (v - 0.5f);
      }
      expect_exact(scene);
    }
  }
}

// Boxes and visible intervals of pages hold whatever the positions mean.
TEST(Lossless, StreamsOfEitherMeaningAreValid) {
  for (const uint32_t flags : {0u, uint32_t{L4D_POSITION_AT_MEAN_TIME}}) {
    TestScene scene = make_scene({});
    scene.flags = flags;
    const Bytes bytes = encode(scene, lossless_options()).bytes;
    for (const Violation& v : validate(bytes)) {
      ADD_FAILURE() << "flags " << flags << ", " << v.clause << ": " << v.message;
    }
  }
}

TEST(Lossless, OddBitsSurvive) {
  SceneOptions o;
  o.count = 400;
  TestScene scene = make_scene(o);
  scene.flags = L4D_POSITION_AT_MEAN_TIME;
  Random random(2);
  for (size_t i = 0; i < scene.count(); ++i) {
    const float odd[] = {-0.0f,   std::numeric_limits<float>::denorm_min(),
                         -1e-40f, std::numeric_limits<float>::min(),
                         0.0f,    1.0f / 3};
    scene.position[3 * i + random.below(3)] = odd[random.below(6)];
    scene.sh[scene.sh_dim() * i + random.below(12)] = odd[random.below(6)];
    scene.log_scale[4 * i + random.below(3)] = odd[random.below(6)];
    scene.rotor[8 * i + random.below(8)] = odd[random.below(6)];
    if (i % 3 == 0) scene.opacity[i] = odd[4 - 3 * random.below(2)];
  }
  for (size_t k = 0; k < 8; ++k) scene.rotor[k] = 0;          // no direction at all
  for (size_t k = 0; k < 8; ++k) scene.rotor[8 + k] *= 1000;  // far from unit length
  expect_exact(scene);
}

TEST(Lossless, EqualGaussiansStayApart) {
  SceneOptions o;
  o.count = 100;
  TestScene scene = make_scene(o);
  const TestScene one = head(scene, 1);
  for (size_t i = 0; i < scene.count(); ++i) {
    std::copy(one.position.begin(), one.position.end(),
              scene.position.begin() + 3 * static_cast<std::ptrdiff_t>(i));
    std::copy(one.log_scale.begin(), one.log_scale.end(),
              scene.log_scale.begin() + 4 * static_cast<std::ptrdiff_t>(i));
    std::copy(one.rotor.begin(), one.rotor.end(),
              scene.rotor.begin() + 8 * static_cast<std::ptrdiff_t>(i));
    std::copy(one.sh.begin(), one.sh.end(),
              scene.sh.begin() + static_cast<std::ptrdiff_t>(scene.sh_dim() * i));
    scene.mean_t[i] = one.mean_t[0];
    scene.opacity[i] = one.opacity[0];
  }
  expect_exact(scene);
}

TestScene subnormal_scene() {
  SceneOptions o;
  o.count = 300;
  TestScene scene = make_scene(o);
  scene.flags = L4D_POSITION_AT_MEAN_TIME;
  for (size_t i = 0; i < scene.count(); i += 2) {
    scene.sh[scene.sh_dim() * i + 4] = 1e-41f;
    scene.position[3 * i + 1] = -1e-42f;
  }
  return scene;
}

TEST(Lossless, DecodesAlikeWithFlushToZero) {
  if (!FlushToZero::kAvailable) GTEST_SKIP() << "no flush-to-zero on this architecture";
  const Bytes bytes = encode(subnormal_scene(), lossless_options()).bytes;
  const GaussianArrays want = decode(bytes, all_query());
  const FlushToZero flush;
  EXPECT_TRUE(same_bits(want, decode(bytes, all_query())));
}

// The encoder's host may flush subnormals too: bits are bits.
TEST(Lossless, EncodesAlikeWithFlushToZero) {
  if (!FlushToZero::kAvailable) GTEST_SKIP() << "no flush-to-zero on this architecture";
  const TestScene scene = subnormal_scene();
  const Bytes want = encode(scene, lossless_options()).bytes;
  const FlushToZero flush;
  EXPECT_TRUE(encode(scene, lossless_options()).bytes == want);
}

TEST(Lossless, NoLargerThanRaw) {
  SceneOptions o;
  o.count = 4000;
  o.sh_degree = 3;
  TestScene scene = make_scene(o);
  const Encoded e = encode(scene, lossless_options());
  EXPECT_EQ(e.report.raw_bytes, 4 * (17 + 48) * scene.count());
  EXPECT_LT(e.report.file_bytes, e.report.raw_bytes);
  EXPECT_EQ(e.report.file_bytes, e.bytes.size());
}

}  // namespace
}  // namespace l4d
