// SPDX-License-Identifier: Apache-2.0
// Destination arrays, capacities, and what the stream says about itself.
#include <gtest/gtest.h>

#include <numeric>

#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "tests/common/codec.h"
#include "tests/decoder/rows.h"

namespace l4d {
namespace {

using namespace test;

DecoderHandle opened(const Bytes& bytes) {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  return d;
}

// All arrays of a GaussianArrays as one list, in the order of the mask bits below.
std::vector<std::vector<float>*> arrays(GaussianArrays& a) {
  return {&a.position, &a.mean_t, &a.mean_t_local, &a.log_scale, &a.rotor, &a.opacity, &a.sh};
}
void attach(GaussianArrays& a, unsigned mask, l4d_gaussian_buffers* b) {
  float** const to[] = {&b->position, &b->mean_t, &b->mean_t_local, &b->log_scale, &b->rotor,
                        &b->opacity,  &b->sh};
  const auto from = arrays(a);
  for (size_t i = 0; i < from.size(); ++i) {
    *to[i] = (mask >> i & 1) != 0 ? from[i]->data() : nullptr;
  }
}

class Output : public testing::TestWithParam<NamedFile> {};

TEST_P(Output, AnySubsetOfArraysIsDecoded) {
  const DecoderHandle d = opened(GetParam().bytes());
  const l4d_query q = time_query(1.0);
  GaussianArrays all = d.decode(q);
  const auto want = arrays(all);
  for (unsigned mask = 0; mask < 128; ++mask) {
    GaussianArrays part = all;
    const auto got = arrays(part);
    for (auto* v : got) std::fill(v->begin(), v->end(), -77.0f);
    l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
    b.capacity = all.count();
    attach(part, mask, &b);
    ASSERT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
    ASSERT_EQ(b.count, all.count());
    for (size_t i = 0; i < got.size(); ++i) {
      if ((mask >> i & 1) != 0) {
        ASSERT_TRUE(same_bits("array", *want[i], *got[i])) << "mask " << mask << ", array " << i;
      } else {
        ASSERT_EQ(*got[i], std::vector<float>(got[i]->size(), -77.0f));
      }
    }
  }
}

TEST_P(Output, NothingBehindTheCountIsTouched) {
  const DecoderHandle d = opened(GetParam().bytes());
  const l4d_query q = time_query(1.0);
  GaussianArrays all = d.decode(q);
  const size_t n = all.count();
  GaussianArrays larger = all;
  const std::vector<size_t> dims = {3, 1, 1, 4, 8, 1, all.sh.size() / n};
  const auto got = arrays(larger);
  for (size_t i = 0; i < got.size(); ++i) got[i]->assign((n + 5) * dims[i], -77.0f);
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = n + 5;
  attach(larger, 127, &b);
  ASSERT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
  EXPECT_EQ(b.count, n);
  EXPECT_EQ(b.capacity, n + 5);
  const auto want = arrays(all);
  for (size_t i = 0; i < got.size(); ++i) {
    const std::vector<float> tail(got[i]->begin() + static_cast<std::ptrdiff_t>(n * dims[i]),
                                  got[i]->end());
    EXPECT_EQ(tail, std::vector<float>(tail.size(), -77.0f));
    got[i]->resize(n * dims[i]);
    EXPECT_TRUE(same_bits("array", *want[i], *got[i]));
  }
}

TEST_P(Output, ShAsHalvesIsTheNearest) {
  const DecoderHandle d = opened(GetParam().bytes());
  for (l4d_query q : {all_query(), time_query(1.0)}) {
    for (const uint32_t detail : {L4D_DETAIL_FULL, L4D_DETAIL_BASE_COLOR}) {
      q.point.detail = detail;
      const GaussianArrays want = d.decode(q);
      std::vector<float> sh(want.sh.size(), -77.0f);
      for (float* const beside : {static_cast<float*>(nullptr), sh.data()}) {
        std::vector<uint16_t> half(want.sh.size(), 0x1234);
        l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
        b.capacity = want.count();
        b.sh = beside;
        b.sh_half = half.data();
        ASSERT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
        EXPECT_EQ(half, halves_of(want.sh));
      }
      EXPECT_TRUE(same_bits("sh", want.sh, sh));
    }
  }
}

TEST_P(Output, TooSmallArraysAreRefused) {
  const DecoderHandle d = opened(GetParam().bytes());
  const l4d_query q = all_query();
  const l4d_selection s = d.select(q);
  std::vector<float> opacity(s.num_gaussians, -77.0f);
  std::vector<l4d_bucket_span> spans(s.num_spans);
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.opacity = opacity.data();
  b.capacity = s.num_gaussians - 1;
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_ERR_BUFFER_TOO_SMALL);
  EXPECT_EQ(b.count, s.num_gaussians);
  EXPECT_EQ(opacity, std::vector<float>(opacity.size(), -77.0f));
  b.capacity = s.num_gaussians;
  b.spans = spans.data();
  b.span_capacity = s.num_spans - 1;
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_ERR_BUFFER_TOO_SMALL);
  EXPECT_EQ(b.num_spans, s.num_spans);
  b.span_capacity = s.num_spans;
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
  EXPECT_EQ(b.num_spans, s.num_spans);
}

TEST_P(Output, SliceArraysAndCapacity) {
  const DecoderHandle d = opened(GetParam().bytes());
  const SplatArrays all = d.slice(1.0);
  ASSERT_GT(all.count(), 0u);
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  ASSERT_EQ(l4d_decoder_slice(d.get(), 1.0, &b), L4D_OK);
  EXPECT_EQ(b.count, all.count());
  EXPECT_LE(b.count, d.select(time_query(1.0)).num_gaussians);
  for (unsigned mask = 1; mask < 16; ++mask) {
    SplatArrays part = all;
    std::vector<float>* const got[] = {&part.position, &part.covariance, &part.opacity, &part.sh};
    const std::vector<float>* const want[] = {&all.position, &all.covariance, &all.opacity,
                                              &all.sh};
    for (auto* v : got) std::fill(v->begin(), v->end(), -77.0f);
    b = L4D_INIT(l4d_splat_buffers);
    float** const to[] = {&b.position, &b.covariance, &b.opacity, &b.sh};
    for (unsigned i = 0; i < 4; ++i) *to[i] = (mask >> i & 1) != 0 ? got[i]->data() : nullptr;
    b.capacity = all.count() - 1;
    EXPECT_EQ(l4d_decoder_slice(d.get(), 1.0, &b), L4D_ERR_BUFFER_TOO_SMALL);
    EXPECT_EQ(b.count, all.count());
    b.capacity = all.count();
    ASSERT_EQ(l4d_decoder_slice(d.get(), 1.0, &b), L4D_OK);
    for (unsigned i = 0; i < 4; ++i) {
      if ((mask >> i & 1) != 0) {
        ASSERT_TRUE(same_bits("splat array", *want[i], *got[i]));
      } else {
        ASSERT_EQ(*got[i], std::vector<float>(got[i]->size(), -77.0f));
      }
    }
  }
}

TEST_P(Output, SelectionAddsUp) {
  const Bytes& bytes = GetParam().bytes();
  const DecoderHandle d = opened(bytes);
  const l4d_selection s = d.select(all_query());
  EXPECT_EQ(s.num_gaussians, d.info().num_gaussians);
  EXPECT_GE(s.num_pages, s.num_spans);
  EXPECT_GT(s.directory_bytes, 0u);
  EXPECT_LT(s.bytes + s.directory_bytes, bytes.size());
  const l4d_selection again = d.select(all_query());  // cached now, and counted all the same
  EXPECT_EQ(again.directory_bytes, s.directory_bytes);
  EXPECT_EQ(again.bytes, s.bytes);
}

TEST_P(Output, SectionsAddUpToTheFile) {
  const Bytes& bytes = GetParam().bytes();
  const DecoderHandle d = opened(bytes);
  uint64_t sections[L4D_SECTION_COUNT];
  std::vector<uint64_t> layers(d.info().num_layers);
  d.check(l4d_decoder_get_sections(d.get(), sections, L4D_SECTION_COUNT, nullptr, layers.data(),
                                   static_cast<uint32_t>(layers.size())));
  EXPECT_EQ(std::accumulate(sections, sections + L4D_SECTION_COUNT, uint64_t{0}), bytes.size());
  uint64_t in_layers = 0;
  for (size_t l = 0; l < layers.size(); ++l) {
    l4d_layer_info info = L4D_INIT(l4d_layer_info);
    d.check(l4d_decoder_get_layer_info(d.get(), static_cast<uint32_t>(l), &info));
    EXPECT_GT(layers[l], info.codebook_bytes);
    in_layers += layers[l];
  }
  EXPECT_LE(in_layers, bytes.size());
  EXPECT_GE(in_layers, d.select(all_query()).bytes);
  // Without the optional array.
  uint64_t alone[L4D_SECTION_COUNT];
  d.check(l4d_decoder_get_sections(d.get(), alone, L4D_SECTION_COUNT, nullptr, nullptr, 0));
  EXPECT_TRUE(std::equal(sections, sections + L4D_SECTION_COUNT, alone));
}

TEST_P(Output, LayersAddUpToTheScene) {
  const DecoderHandle d = opened(GetParam().bytes());
  const l4d_info info = d.info();
  uint64_t total = 0;
  uint32_t tools = info.sh_degree > 0 ? uint32_t{L4D_TOOL_VIEW_DEPENDENCE} : 0u;
  for (uint32_t l = 0; l < info.num_layers; ++l) {
    l4d_layer_info layer = L4D_INIT(l4d_layer_info);
    d.check(l4d_decoder_get_layer_info(d.get(), l, &layer));
    total += layer.num_gaussians;
    tools |= layer.tools;
    for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      for (uint32_t s = 0; s < L4D_MAX_STAGES; ++s) {
        l4d_codebook codebook = L4D_INIT(l4d_codebook);
        d.check(l4d_decoder_get_codebook(d.get(), l, c, s, L4D_NO_BLOCK, &codebook));
        EXPECT_EQ(codebook.entries != nullptr, s < layer.num_stages[c]);
        EXPECT_EQ(codebook.num_entries > 0, s < layer.num_stages[c]);
        if (s == 0) {
          EXPECT_EQ(codebook.num_entries, layer.codebook_size[c]);
        }
      }
    }
  }
  EXPECT_EQ(total, info.num_gaussians);
  EXPECT_EQ(tools, info.tools);
  l4d_layer_info beyond = L4D_INIT(l4d_layer_info);
  EXPECT_EQ(l4d_decoder_get_layer_info(d.get(), info.num_layers, &beyond),
            L4D_ERR_INVALID_ARGUMENT);
}

// spec: ENC-1
TEST_P(Output, ValidStreamsHaveNoViolation) {
  for (const Violation& v : validate(GetParam().bytes())) {
    ADD_FAILURE() << v.clause << ": " << v.message;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Streams, Output,
    testing::Values(NamedFile{"dynamic", dynamic_file}, NamedFile{"staged", staged_file},
                    NamedFile{"rcq", rcq_file}, NamedFile{"transform", transform_file},
                    NamedFile{"lossless", lossless_file}, NamedFile{"tiny", tiny_file}),
    file_name);

TEST(Codebook, BlocksHaveTheirOwn) {
  const DecoderHandle d = opened(rcq_file());
  const GaussianArrays a = d.decode(all_query());
  size_t blocks = 0;
  for (const l4d_bucket_span& r : a.spans) {
    if (r.block == L4D_NO_BLOCK) continue;
    ++blocks;
    l4d_codebook global, block;
    global = L4D_INIT(l4d_codebook);
    block = L4D_INIT(l4d_codebook);
    d.check(l4d_decoder_get_codebook(d.get(), r.layer, L4D_COMPONENT_ROTOR_SPATIAL, 0, L4D_NO_BLOCK,
                                     &global));
    d.check(l4d_decoder_get_codebook(d.get(), r.layer, L4D_COMPONENT_ROTOR_SPATIAL, 0, r.block,
                                     &block));
    EXPECT_NE(global.entries, block.entries);
    EXPECT_EQ(global.dim, block.dim);
    // Of SH there is one for all.
    d.check(l4d_decoder_get_codebook(d.get(), r.layer, L4D_COMPONENT_SH, 0, L4D_NO_BLOCK, &global));
    d.check(l4d_decoder_get_codebook(d.get(), r.layer, L4D_COMPONENT_SH, 0, r.block, &block));
    EXPECT_EQ(global.entries, block.entries);
  }
  EXPECT_GT(blocks, 0u);
}

TEST(Codebook, ArgumentsAreChecked) {
  const DecoderHandle d = opened(rcq_file());
  l4d_codebook codebook = L4D_INIT(l4d_codebook);
  const uint32_t layers = d.info().num_layers;
  const auto get = [&](uint32_t layer, uint32_t c, uint32_t stage, uint32_t block) {
    return l4d_decoder_get_codebook(d.get(), layer, c, stage, block, &codebook);
  };
  EXPECT_EQ(get(layers, 0, 0, L4D_NO_BLOCK), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(get(0, L4D_COMPONENT_COUNT, 0, L4D_NO_BLOCK), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(get(0, 0, L4D_MAX_STAGES, L4D_NO_BLOCK), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(get(0, 0, 0, 0), L4D_ERR_INVALID_ARGUMENT);  // layer 0 has no blocks
  EXPECT_EQ(get(layers - 1, 1, 0, 0xfffffffeu), L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d
