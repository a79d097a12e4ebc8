// SPDX-License-Identifier: Apache-2.0
// One answer: whatever the backend, the number of threads, the mode of the floating-point unit and
// the form asked for.
#include <gtest/gtest.h>

#include "l4d/experimental/packed.h"
#include "tests/common/codec.h"
#include "tests/common/flush_to_zero.h"
#include "tests/decoder/packed.h"

namespace l4d {
namespace {

using namespace test;

// Degree 3 and enough Gaussians for the stores around the cache.
const Bytes& wide_file() {
  static const Bytes kBytes = [] {
    SceneOptions s;
    s.count = 33000;
    s.sh_degree = 3;
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_PAGE_SIZE, 5000});
    o.settings.push_back({L4D_ENC_KMEANS_ITERATIONS, 1});
    o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 32});
    return encode(make_scene(s), o).bytes;
  }();
  return kBytes;
}

struct Way {
  uint32_t backend, threads;
  bool flush;
};
std::vector<Way> ways() {
  std::vector<Way> all;
  for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU, L4D_BACKEND_AUTO}) {
    for (const uint32_t threads : {1u, 2u, 7u}) {
      for (const bool flush : {false, true}) all.push_back({backend, threads, flush});
    }
  }
  return all;
}

class Backends : public testing::TestWithParam<NamedFile> {
 protected:
  // body(decoder) for every way, each result held against the first.
  template <typename Body>
  void compare(const Body& body) {
    const Bytes& bytes = GetParam().bytes();
    bool first = true;
    decltype(body(std::declval<const DecoderHandle&>())) want;
    for (const Way& way : ways()) {
      SCOPED_TRACE("backend " + std::to_string(way.backend) + ", threads " +
                   std::to_string(way.threads) + ", flush " + std::to_string(way.flush));
      const l4d_decoder_options o = decoder_options(way.backend, way.threads);
      DecoderHandle d(&o);
      d.open_memory(bytes.data(), bytes.size());
      const auto got = [&] {
        if (!way.flush) return body(d);
        const FlushToZero flush;
        return body(d);
      }();
      if (first) want = got;
      first = false;
      ASSERT_TRUE(same_bits(want, got));
    }
  }
};

// spec: DEC-1
TEST_P(Backends, ExpandedBitsAgree) {
  compare([](const DecoderHandle& d) { return d.decode(all_query()); });
}

TEST_P(Backends, ExpandedBitsOfATimeAgree) {
  compare([](const DecoderHandle& d) { return d.decode(time_query(0.7)); });
}

TEST_P(Backends, SliceBitsAgree) {
  const Bytes& bytes = GetParam().bytes();
  for (const double t : {0.0, 0.71, 2.0}) {
    SplatArrays want;
    for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU}) {
      for (const uint32_t threads : {1u, 2u, 7u}) {
        const l4d_decoder_options o = decoder_options(backend, threads);
        DecoderHandle d(&o);
        d.open_memory(bytes.data(), bytes.size());
        const SplatArrays got = d.slice(t);
        if (want.opacity.empty()) want = got;
        ASSERT_GT(got.count(), 0u);
        ASSERT_TRUE(same_bits(want, got)) << "backend " << backend << ", threads " << threads;
      }
    }
  }
}

// Streams that have a packed form: all but lossless ones.
class PackedBackends : public Backends {};

TEST_P(PackedBackends, ExpandsToTheSameBits) {
  const Bytes& bytes = GetParam().bytes();
  for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU}) {
    for (const uint32_t threads : {1u, 7u}) {
      const l4d_decoder_options o = decoder_options(backend, threads);
      DecoderHandle d(&o);
      d.open_memory(bytes.data(), bytes.size());
      for (const l4d_query& q : {all_query(), time_query(1.1)}) {
        GaussianArrays want = d.decode(q);
        for (const l4d_bucket_span& r : want.spans) {
          l4d_layer_info layer = L4D_INIT(l4d_layer_info);
          ASSERT_EQ(l4d_decoder_get_layer_info(d.get(), r.layer, &layer), L4D_OK);
          if (layer.permanent == 0) continue;
          const float log_scale_t = want.log_scale[4 * r.first + 3];
          for (uint64_t i = r.first; i < r.first + r.count; ++i) {
            ASSERT_EQ(want.log_scale[4 * i + 3], log_scale_t);
            want.log_scale[4 * i + 3] = 0;
          }
        }
        const PackedArrays packed = decode_packed(d, q);
        ASSERT_TRUE(same_bits(want, expand(d, packed)));
      }
    }
  }
}

TEST_P(PackedBackends, CountsItsEscapes) {
  const Bytes& bytes = GetParam().bytes();
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  // Twice: the buffers of the first call must not show in the second.
  for (int round = 0; round < 2; ++round) {
    const PackedArrays p = decode_packed(d, all_query());
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      uint64_t escapes = 0;
      for (const uint8_t depth : p.depth[c]) escapes += depth == 255;
      EXPECT_EQ(p.num_escapes[c], escapes) << "component " << c << ", round " << round;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Streams, PackedBackends,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"staged", staged_file},
                                         NamedFile{"rcq", rcq_file}, NamedFile{"wide", wide_file}),
                         file_name);

INSTANTIATE_TEST_SUITE_P(Streams, Backends,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"staged", staged_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"lossless", lossless_file},
                                         NamedFile{"wide", wide_file}),
                         file_name);

// The shared files hold what their tests are about.
TEST(TestFiles, UseTheToolsTheyAreFor) {
  const auto tools = [](const Bytes& bytes) {
    DecoderHandle d;
    d.open_memory(bytes.data(), bytes.size());
    return d.info().tools;
  };
  EXPECT_EQ(tools(dynamic_file()),
            uint32_t{L4D_TOOL_MOTION | L4D_TOOL_TEMPORAL_OPACITY | L4D_TOOL_VIEW_DEPENDENCE});
  EXPECT_EQ(tools(staged_file()) & (L4D_TOOL_RESIDUAL_STAGES | L4D_TOOL_ESCAPES),
            uint32_t{L4D_TOOL_RESIDUAL_STAGES | L4D_TOOL_ESCAPES});
  EXPECT_NE(tools(rcq_file()) & L4D_TOOL_RCQ, 0u);
  EXPECT_NE(tools(lossless_file()) & L4D_TOOL_LOSSLESS, 0u);
  DecoderHandle d;
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  l4d_layer_info layer = L4D_INIT(l4d_layer_info);
  ASSERT_EQ(l4d_decoder_get_layer_info(d.get(), 0, &layer), L4D_OK);
  EXPECT_EQ(layer.permanent, 1u);
  EXPECT_GE(d.info().num_layers, 4u);
  uint32_t with_block = 0;
  for (const l4d_bucket_span& r : decode(rcq_file(), all_query()).spans) {
    with_block += r.block != L4D_NO_BLOCK;
  }
  EXPECT_GT(with_block, 0u);
}

TEST(Packed, LosslessStreamsHaveNone) {
  DecoderHandle d;
  d.open_memory(lossless_file().data(), lossless_file().size());
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  b.capacity = 1u << 20;
  const l4d_query q = all_query();
  EXPECT_EQ(l4d_decoder_decode_packed(d.get(), &q, &b), L4D_ERR_FEATURE_UNSUPPORTED);
}

// All temporal rotors are escapes, but the permanent layer has none at all.
TEST(Packed, EscapesOfOnePageDoNotShowInTheNext) {
  EncodeOptions o = small_options();
  const TestScene scene = make_scene({});
  const std::vector<float> weights(scene.count(), 1.0f);
  o.settings.push_back({L4D_ENC_ESCAPE_THRESHOLD ".rotor-temporal", 0.5});
  o.weights = {{L4D_WEIGHT_ROTOR_TEMPORAL, &weights}};
  const Bytes bytes = encode(scene, o).bytes;
  const l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&options);
  d.open_memory(bytes.data(), bytes.size());
  uint64_t permanent = 0;
  l4d_layer_info layer = L4D_INIT(l4d_layer_info);
  ASSERT_EQ(l4d_decoder_get_layer_info(d.get(), 0, &layer), L4D_OK);
  ASSERT_EQ(layer.permanent, 1u);
  permanent = layer.num_gaussians;
  for (int round = 0; round < 2; ++round) {
    const PackedArrays p = decode_packed(d, all_query());
    EXPECT_EQ(p.num_escapes[L4D_COMPONENT_ROTOR_TEMPORAL], p.count() - permanent)
        << "round " << round;
  }
}

TEST(Packed, UnusedIndicesAreZeroAndNullArraysAreSkipped) {
  DecoderHandle d;
  d.open_memory(staged_file().data(), staged_file().size());
  const PackedArrays all = decode_packed(d, all_query());
  const size_t n = all.count();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    for (size_t s = 0; s < 3; ++s) {
      for (size_t i = 0; i < n; ++i) {
        const uint8_t depth = all.depth[c][i];
        const uint16_t index = all.index[c][s * n + i];
        if (index == 0xeeee) continue;  // a component without stages in this layer
        if (depth == 255 || depth <= s) {
          ASSERT_EQ(index, 0) << c << " " << s << " " << i;
        }
      }
    }
  }
  // One array at a time gives what all together give.
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  std::vector<uint16_t> index(3 * n, 0xeeee);
  b.capacity = n;
  b.component[L4D_COMPONENT_SH].index = index.data();
  const l4d_query q = all_query();
  ASSERT_EQ(l4d_decoder_decode_packed(d.get(), &q, &b), L4D_OK);
  EXPECT_EQ(b.count, n);
  EXPECT_EQ(b.component[L4D_COMPONENT_SH].num_escapes, all.num_escapes[L4D_COMPONENT_SH]);
  EXPECT_TRUE(std::equal(index.begin(), index.end(), all.index[L4D_COMPONENT_SH].begin()));
  std::vector<uint16_t> escape(48 * n);
  b = L4D_INIT(l4d_packed_buffers);
  b.capacity = n;
  b.component[L4D_COMPONENT_SH].escape = escape.data();
  b.component[L4D_COMPONENT_SH].escape_capacity = all.num_escapes[L4D_COMPONENT_SH] - 1;
  EXPECT_EQ(l4d_decoder_decode_packed(d.get(), &q, &b), L4D_ERR_BUFFER_TOO_SMALL);
  b.component[L4D_COMPONENT_SH].escape_capacity += 1;
  EXPECT_EQ(l4d_decoder_decode_packed(d.get(), &q, &b), L4D_OK);
}

}  // namespace
}  // namespace l4d
