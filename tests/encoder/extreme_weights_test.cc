// SPDX-License-Identifier: Apache-2.0
// Any finite weight is one that a scene may have: what is written must be a stream all the same.
#include <gtest/gtest.h>

#include <limits>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

TestScene small_scene() {
  SceneOptions s;
  s.count = 300;
  s.num_frames = 16;
  return make_scene(s);
}

// spec: ENC-1
TEST(ExtremeWeights, GiveStreamsThatDecode) {
  const TestScene scene = small_scene();
  constexpr float kMax = std::numeric_limits<float>::max();
  for (const char* preset : {"default", "archive", "indexed-small"}) {
    for (const uint32_t metric : {L4D_SENSITIVITY_SUM, L4D_SENSITIVITY_GAUSS_NEWTON}) {
      for (const float rest : {1e-20f, 1.0f, kMax}) {
        std::vector<float> weights(scene.count(), rest);
        weights[3] = kMax;
        weights[5] = std::numeric_limits<float>::denorm_min();
        EncodeOptions o;
        o.preset = preset;
        o.rans = true;
        o.metric = metric;
        o.settings = {{L4D_ENC_CODEBOOK_SIZE, 32}, {L4D_ENC_PRUNE_COST, 0}};
        for (uint32_t which = 0; which < L4D_WEIGHT_COUNT; ++which) {
          o.weights.emplace_back(which, &weights);
        }
        const Encoded e = encode(scene, o);
        EXPECT_TRUE(validate(e.bytes).empty()) << preset << metric << rest;
        EXPECT_EQ(decode(e.bytes, all_query()).count(), scene.count());
      }
    }
  }
}

}  // namespace
}  // namespace l4d
