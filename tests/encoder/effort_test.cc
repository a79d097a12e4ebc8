// SPDX-License-Identifier: Apache-2.0
// More effort must not make worse streams.
#include <gtest/gtest.h>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

TEST(Effort, BeyondTheDefaultIsNoWorse) {
  SceneOptions s;
  s.count = 4000;
  const TestScene scene = make_scene(s);
  size_t bytes = 0;
  GaussianArrays usual;
  for (const double effort : {7.0, 8.0, 9.0}) {
    EncodeOptions o;
    o.preset = "indexed";
    o.settings = {{L4D_ENC_EFFORT, effort}, {L4D_ENC_CODEBOOK_SIZE, 256}};
    const Encoded e = encode(scene, o);
    const GaussianArrays decoded = decode(e.bytes, all_query());
    if (effort == 7) {
      usual = decoded;
    } else {
      EXPECT_LE(e.bytes.size(), bytes) << effort;
      EXPECT_TRUE(same_bits(decoded, usual)) << effort;
    }
    bytes = e.bytes.size();
  }
}

}  // namespace
}  // namespace l4d
