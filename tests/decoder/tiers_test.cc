// SPDX-License-Identifier: Apache-2.0
// Tiers: the long-lived Gaussians in several layers, the most important first; and the streamable
// layout, in which the encoder writes all files.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <set>
#include <vector>

#include "libl4dcodec/base/bytes.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"

namespace l4d {
namespace {

using namespace test;

TestScene tier_scene() {
  SceneOptions options;
  options.count = 6000;
  options.num_frames = 240;
  options.sh_degree = 1;
  options.permanent = 0.5;
  return make_scene(options);
}

Encoded encode_tiers(const std::vector<double>& shares, const char* preset = "default",
                     const std::vector<float>* alpha_t = nullptr, uint32_t threads = 1) {
  EncodeOptions options;
  options.preset = preset;
  options.rans = true;
  options.threads = threads;
  options.settings = {{L4D_ENC_MERGE_COUNT, 50}, {L4D_ENC_MERGE_FRACTION, 0}};
  if (alpha_t != nullptr) options.weights = {{L4D_WEIGHT_ALPHA_T, alpha_t}};
  options.tiers = shares;
  return encode(tier_scene(), options);
}
const Bytes& tiers_file() {
  static const Bytes kBytes = encode_tiers({0.15f, 0.5f}).bytes;
  return kBytes;
}

std::vector<l4d_layer_info> layers_of(const Bytes& file) {
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  std::vector<l4d_layer_info> out;
  for (uint32_t l = 0; l < d.info().num_layers; ++l) out.push_back(d.layer_info(l));
  return out;
}

l4d_query up_to_tier(l4d_query query, uint32_t max_tier) {
  query.point.tiers = max_tier + 1;  // UINT32_MAX: 0, which is all
  return query;
}

TEST(Tiers, SharesOfTheLongLived) {
  for (const char* preset : {"default", "indexed", "lossless"}) {
    SCOPED_TRACE(preset);
    const Bytes file = encode_tiers({0.15f, 0.5f}, preset).bytes;
    for (const Violation& v : validate(file)) ADD_FAILURE() << v.clause << ": " << v.message;
    std::vector<uint64_t> count(3);
    unsigned last_level = 0;
    for (const l4d_layer_info& layer : layers_of(file)) {
      EXPECT_GE(layer.level, last_level);
      last_level = layer.level;
      if (layer.level > 0) {
        EXPECT_EQ(layer.tier, 0u);
        continue;
      }
      ASSERT_LE(layer.tier, 2u);
      count[layer.tier] += layer.num_gaussians;
    }
    const double all = static_cast<double>(count[0] + count[1] + count[2]);
    EXPECT_NEAR(static_cast<double>(count[0]) / all, 0.15, 0.05);
    EXPECT_NEAR(static_cast<double>(count[1]) / all, 0.35, 0.05);
  }
  for (const l4d_layer_info& layer : layers_of(encode_tiers({}).bytes)) EXPECT_EQ(layer.tier, 0u);
}

// Cutting changes which layer a Gaussian is in, and nothing else.
TEST(Tiers, AllTiersAreTheWholeScene) {
  const TestScene scene = tier_scene();
  const Encoded encoded = encode_tiers({0.15f, 0.5f}, "lossless");
  const GaussianArrays got = decode(encoded.bytes, all_query());
  ASSERT_EQ(got.count(), scene.count());
  std::vector<bool> seen(scene.count());
  for (size_t i = 0; i < encoded.order.size(); ++i) {
    const size_t from = encoded.order[i];
    EXPECT_FALSE(seen[from]);
    seen[from] = true;
    EXPECT_EQ(got.opacity[i], scene.opacity[from]);
    for (size_t k = 0; k < 3; ++k) EXPECT_EQ(got.position[3 * i + k], scene.position[3 * from + k]);
  }
}

TEST(Tiers, QueriesLeaveOutTiers) {
  const Bytes& file = tiers_file();
  const std::vector<l4d_layer_info> layers = layers_of(file);
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  uint64_t before = 0;
  for (const uint32_t tier : {0u, 1u, 2u, UINT32_MAX}) {
    uint64_t want = 0;
    for (const l4d_layer_info& layer : layers) want += layer.tier <= tier ? layer.num_gaussians : 0;
    const l4d_selection all = d.select(up_to_tier(all_query(), tier));
    EXPECT_EQ(all.num_gaussians, want);
    EXPECT_EQ(decode(file, up_to_tier(all_query(), tier)).count(), want);
    const l4d_selection at = d.select(up_to_tier(time_query(1.5), tier));
    EXPECT_LE(at.num_gaussians, want);
    EXPECT_TRUE(tier == UINT32_MAX ? at.num_gaussians == before : at.num_gaussians > before);
    before = at.num_gaussians;
  }
  // Listed buckets too.
  std::vector<l4d_bucket> listed;
  for (const l4d_layer_info& layer : layers) {
    if (layer.level == 0) listed.push_back({layer.index, 0});
  }
  l4d_query query = up_to_tier(all_query(), 1);
  query.kind = L4D_QUERY_BUCKETS;
  query.buckets = listed.data();
  query.num_buckets = listed.size();
  uint64_t want = 0;
  for (const l4d_layer_info& layer : layers) {
    if (layer.level == 0 && layer.tier <= 1) want += layer.num_gaussians;
  }
  EXPECT_EQ(d.select(query).num_gaussians, want);
}

TEST(Tiers, SlicesLeaveOutLayers) {
  const Bytes& file = tiers_file();
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  const SplatArrays all = d.slice(1.5);
  size_t before = 0;
  for (const uint32_t tier : {0u, 1u, 2u}) {
    const SplatArrays got = d.slice(1.5, {{0, tier + 1, 0, 0}});
    EXPECT_GT(got.count(), before);
    before = got.count();
  }
  EXPECT_TRUE(same_bits(d.slice(1.5), all));
  EXPECT_LT(d.slice(1.5, {{1, 1, 0, 0}}).count(), before);
  EXPECT_TRUE(same_bits(d.slice(1.5), all));
}

// What weighs most is in the first tier.
TEST(Tiers, ByMeasuredImportance) {
  const TestScene scene = tier_scene();
  std::vector<float> alpha_t(scene.count());
  for (size_t i = 0; i < alpha_t.size(); ++i) {
    alpha_t[i] = static_cast<float>((i * 2654435761u) % 100000 + 1);
  }
  const Encoded encoded = encode_tiers({0.3f}, "lossless", &alpha_t);
  DecoderHandle d;
  d.open_memory(encoded.bytes.data(), encoded.bytes.size());
  size_t at = 0;
  float least_of_first = HUGE_VALF, most_of_last = 0;
  for (const l4d_layer_info& layer : layers_of(encoded.bytes)) {
    for (uint64_t i = 0; i < layer.num_gaussians; ++i, ++at) {
      if (layer.level > 0) continue;
      const float weight = alpha_t[encoded.order[at]];
      if (layer.tier == 0) least_of_first = std::min(least_of_first, weight);
      if (layer.tier == 1) most_of_last = std::max(most_of_last, weight);
    }
  }
  EXPECT_GT(most_of_last, 0.0f);
  EXPECT_GT(least_of_first, most_of_last);
}

TEST(Tiers, SameBytesForAnyThreads) {
  EXPECT_EQ(tiers_file(), encode_tiers({0.15f, 0.5f}, "default", nullptr, 3).bytes);
}

TEST(Tiers, FewTiersWhereLayersAreFew) {
  SceneOptions options;
  options.count = 400;
  options.num_frames = 1;
  EncodeOptions encode_options;
  encode_options.preset = "default";
  encode_options.settings = {{L4D_ENC_MERGE_COUNT, 0}, {L4D_ENC_MERGE_FRACTION, 0}};
  encode_options.tiers = {0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f};
  const Bytes file = encode(make_scene(options), encode_options).bytes;
  EXPECT_TRUE(validate(file).empty());
  EXPECT_LE(layers_of(file).size(), 6u);  // HEAD-6, of one frame
}

TEST(Tiers, BadShares) {
  const TestScene scene = tier_scene();
  const EncoderHandle e;
  const auto status = [&](const std::vector<double>& shares) {
    return l4d_encoder_set_list(e.get(), L4D_ENC_TIERS, shares.data(),
                                static_cast<uint32_t>(shares.size()));
  };
  EXPECT_EQ(status({0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f}), L4D_OK);
  EXPECT_EQ(status({}), L4D_OK);
  EXPECT_EQ(status({0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f, 0.8f}), L4D_ERR_INVALID_ARGUMENT);
  for (const double bad : {0.0, 1.0, -0.1, 2.0, std::nan("")}) {
    EXPECT_EQ(status({bad}), L4D_ERR_INVALID_ARGUMENT) << bad;
  }
  EXPECT_EQ(status({0.5f, 0.5f}), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status({0.5f, 0.2f}), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_set_list(e.get(), L4D_ENC_TIERS, nullptr, 1), L4D_ERR_INVALID_ARGUMENT);
}

// ---- the streamable layout
// ------------------------------------------------------------------------

std::set<std::string> clauses_of(const Bytes& file) {
  std::set<std::string> out;
  for (const Violation& v : validate(file)) out.insert(v.clause);
  return out;
}

// spec: FILE-7
TEST(Streamable, EncoderWritesIt) {
  for (const Bytes* file : {&tiers_file(), &dynamic_file(), &rcq_file(), &transform_file(),
                            &lossless_file(), &wandering_file()}) {
    DecoderHandle d;
    d.open_memory(file->data(), file->size());
    EXPECT_EQ(d.info().streamable, 1u);
    EXPECT_TRUE(validate(*file).empty());
  }
}

// The editor writes layer after layer: that is in order where there is one.
// spec: FILE-7
TEST(Streamable, OtherLayoutsAreRefused) {
  StreamEditor editor(dynamic_file());
  ASSERT_GT(editor.layers.size(), 2u);
  editor.file.flags |= FileHeader::kStreamableFlag;
  EXPECT_EQ(clauses_of(editor.build()), std::set<std::string>{"FILE-7"});
  editor.file.flags = FileHeader::kDevelopmentFlag;
  EXPECT_TRUE(clauses_of(editor.build()).empty());
  // A decoder does not care.
  editor.file.flags |= FileHeader::kStreamableFlag;
  const Bytes other = editor.build();
  EXPECT_TRUE(same_bits(decode(other, all_query()), decode(dynamic_file(), all_query())));
}

}  // namespace
}  // namespace l4d
