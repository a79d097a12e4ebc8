// SPDX-License-Identifier: Apache-2.0
// The packed form on a device against that on the host, byte for byte, poison included.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <iostream>
#include <map>
#include <string>
#include <tuple>

#include "l4d/experimental/cuda_packed.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/common/stream_editor.h"
#include "tests/gpu/decode_packed_support.h"

namespace l4d::test {
namespace {

std::vector<l4d_query> queries() {
  std::vector<l4d_query> out = {all_query(), time_query(0.0), time_query(0.7), time_query(1.9),
                                range_query(0.4, 1.1)};
  out.push_back(time_query(0.7));
  out.back().point.levels = 2;
  out.push_back(all_query());
  out.back().point.detail = L4D_DETAIL_BASE_COLOR;
  return out;
}

void expect_same_for_all_queries(const Bytes& file) {
  for (const l4d_query& query : queries()) {
    const PackedPair pair = pack_on_both(file, query);
    ASSERT_EQ(pair.host.verdict.status, L4D_OK) << pair.host.detail;
    ASSERT_TRUE(same_packed(pair));
  }
}

// All components in three stages, and some Gaussians as escapes.
EncodeOptions with_escapes(const TestScene& scene, bool rans, std::vector<float>* weights) {
  weights->resize(scene.count());
  for (size_t i = 0; i < weights->size(); ++i) (*weights)[i] = static_cast<float>(i % 40);
  EncodeOptions o = small_options();
  o.rans = rans;
  o.stages = {{L4D_ENC_STAGES, {1.0f, 0.5f, 0.25f}}};
  o.settings.push_back({L4D_ENC_ESCAPE_THRESHOLD, 37.5});
  for (uint32_t w = L4D_WEIGHT_SH; w <= L4D_WEIGHT_ROTOR_TEMPORAL; ++w) {
    o.weights.emplace_back(w, weights);
  }
  return o;
}

Bytes escape_file(uint64_t count, uint32_t degree, bool rans) {
  SceneOptions s;
  s.count = count;
  s.sh_degree = degree;
  const TestScene scene = make_scene(s);
  std::vector<float> weights;
  return encode(scene, with_escapes(scene, rans, &weights)).bytes;
}

class Packed : public OnDevice<testing::Test> {};

TEST_F(Packed, PresetsOfCodebooks) {
  struct Preset {
    const char* name;
    bool rans;
    double size, page;
  };
  for (const Preset& p :
       {Preset{"indexed", true, 128, 4096}, Preset{"indexed-small", true, 256, 333},
        Preset{"paper-small", false, 64, 500}}) {
    for (uint32_t degree = 0; degree <= 3; ++degree) {
      SCOPED_TRACE(testing::Message() << p.name << " " << degree);
      SceneOptions s;
      s.count = 9000;
      s.sh_degree = degree;
      s.seed = degree + 7;
      EncodeOptions o;
      o.preset = p.name;
      o.rans = p.rans;
      o.settings = {{L4D_ENC_PROFILE, L4D_PROFILE_INDEXED},
                    {L4D_ENC_CODEBOOK_SIZE, p.size},
                    {L4D_ENC_KMEANS_ITERATIONS, 2},
                    {L4D_ENC_PAGE_SIZE, p.page},
                    {L4D_ENC_MERGE_COUNT, 40},
                    {L4D_ENC_PRUNE_WEIGHT, -1}};
      expect_same_for_all_queries(encode(make_scene(s), o).bytes);
    }
  }
}

TEST_F(Packed, EscapesAndStages) {
  for (const bool rans : {true, false}) {
    for (const uint32_t degree : {0u, 1u, 3u}) {
      SCOPED_TRACE(testing::Message() << "rans " << rans << ", degree " << degree);
      const Bytes file = escape_file(3000, degree, rans);
      expect_same_for_all_queries(file);
      const PackedPair pair = pack_on_both(file, all_query());
      for (const uint64_t count : pair.host.num_escapes) EXPECT_GT(count, 0u);
    }
  }
}

TEST_F(Packed, BlockCodebooks) {
  for (const bool rans : {true, false}) {
    const Bytes file = block_codebooks_file(rans);
    DecoderHandle decoder;
    decoder.open_memory(file.data(), file.size());
    ASSERT_NE(decoder.info().tools & L4D_TOOL_RCQ, 0u);
    expect_same_for_all_queries(file);
  }
}

TEST_F(Packed, PermanentLayersAndShChunks) {
  for (const double permanent : {0.0, 0.9, 1.0}) {
    SceneOptions s;
    s.count = 40000;
    s.sh_degree = 3;
    s.permanent = permanent;
    s.moving = permanent < 1.0;
    EncodeOptions o;
    o.preset = "indexed-small";
    o.rans = true;
    o.settings = {{L4D_ENC_PROFILE, L4D_PROFILE_INDEXED},
                  {L4D_ENC_MERGE_COUNT, 4000},
                  {L4D_ENC_CODEBOOK_SIZE, 256},
                  {L4D_ENC_KMEANS_ITERATIONS, 2}};
    expect_same_for_all_queries(encode(make_scene(s), o).bytes);
  }
}

TEST_F(Packed, FlatWindows) {
  SceneOptions s;
  s.count = 3000;
  const TestScene scene = windowed_scene(s, 5);
  for (const bool rans : {true, false}) {
    EncodeOptions o = small_options();
    o.rans = rans;
    o.settings.push_back({L4D_ENC_PROFILE, L4D_PROFILE_INDEXED});
    const Bytes file = encode(scene, o).bytes;
    expect_same_for_all_queries(file);
    const PackedPair pair = pack_on_both(file, all_query());
    const Bytes& windows = pair.device.arrays[kPackedWindow];
    EXPECT_GT(std::count_if(windows.begin(), windows.end(), [](unsigned char b) { return b != 0; }),
              2000);
  }
}

// Every second page by another codec: some are decoded here, some there.
TEST_F(Packed, PagesOfBothKindsInOneStream) {
  StreamEditor mixed(escape_file(3000, 1, true));
  const StreamEditor streams(escape_file(3000, 1, false));
  size_t page = 0, changed = 0;
  for (size_t l = 0; l < mixed.layers.size(); ++l) {
    for (size_t d = 0; d < mixed.layers[l].directory.size(); ++d) {
      EditedDirectoryPage& to = mixed.layers[l].directory[d];
      const EditedDirectoryPage& from = streams.layers[l].directory[d];
      ASSERT_EQ(to.pages.size(), from.pages.size());
      for (size_t p = 0; p < to.pages.size(); ++p) {
        ASSERT_EQ(to.page.pages[p].num_gaussians, from.page.pages[p].num_gaussians);
        if (page++ % 2 == 0 || to.page.pages[p].has_sh_detail()) continue;
        to.pages[p] = from.pages[p];
        ++changed;
      }
    }
  }
  ASSERT_GT(changed, 3u);
  const Bytes file = mixed.build();
  expect_same_for_all_queries(file);
  const DeviceResult expanded = decode_on_device(file, all_query());
  EXPECT_TRUE(same_bits("sh", expanded.arrays.sh, decode(file, all_query()).sh));
}

TEST_F(Packed, AnySubsetOfArrays) {
  Random random(3);
  const Bytes files[] = {escape_file(900, 1, true), escape_file(900, 1, false)};
  for (const Bytes& file : files) {
    std::vector<uint32_t> subsets = {0};
    for (unsigned k = 0; k < kNumPackedArrays; ++k) {
      subsets.push_back(1u << k);
      subsets.push_back(kAllPackedArrays & ~(1u << k));
    }
    for (int i = 0; i < 20; ++i) subsets.push_back(random.below(kAllPackedArrays + 1));
    for (const uint32_t arrays : subsets) {
      PackedRequest request;
      request.arrays = arrays;
      ASSERT_TRUE(same_packed(pack_on_both(file, time_query(1.0), request))) << arrays;
    }
  }
}

TEST_F(Packed, NoCapacityForEscapes) {
  for (const bool rans : {true, false}) {
    const Bytes file = escape_file(3000, 1, rans);
    const PackedPair whole = pack_on_both(file, all_query());
    uint64_t least = UINT64_MAX;
    for (const uint64_t count : whole.host.num_escapes) least = std::min(least, count);
    ASSERT_GT(least, 1u);
    for (const uint64_t capacity : {uint64_t{0}, uint64_t{1}, least - 1}) {
      PackedRequest request;
      request.escape_capacity = capacity;
      const PackedPair pair = pack_on_both(file, all_query(), request);
      EXPECT_EQ(pair.host.verdict.status, L4D_ERR_BUFFER_TOO_SMALL);
      EXPECT_EQ(pair.device.verdict.status, L4D_ERR_BUFFER_TOO_SMALL);
      EXPECT_NE(pair.device.detail.find("escape_capacity"), std::string::npos);
      EXPECT_EQ(pair.device.num_escapes, whole.host.num_escapes);
      for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        const Bytes& found = pair.device.arrays[kPackedEscape + 3 * c];
        if (capacity == 0) continue;
        // Rows of three numbers at least.
        const size_t sure = static_cast<size_t>(capacity) * 3 * sizeof(uint16_t);
        EXPECT_EQ(std::memcmp(found.data(), whole.host.arrays[kPackedEscape + 3 * c].data(), sure),
                  0);
      }
    }
    PackedRequest enough;
    enough.escape_capacity =
        *std::max_element(whole.host.num_escapes.begin(), whole.host.num_escapes.end());
    EXPECT_TRUE(same_packed(pack_on_both(file, all_query(), enough)));
  }
}

TEST_F(Packed, RefusesWhatHasNoPackedForm) {
  SceneOptions s;
  s.count = 600;
  EncodeOptions half;
  half.preset = "default";
  half.rans = true;
  half.settings = {{L4D_ENC_FIXED_POSITIONS, 0}};
  for (const Bytes& file : {transform_file(), lossless_file(), encode(make_scene(s), half).bytes}) {
    const PackedPair pair = pack_on_both(file, all_query());
    EXPECT_EQ(pair.host.verdict.status, L4D_ERR_FEATURE_UNSUPPORTED);
    EXPECT_EQ(pair.device.verdict.status, L4D_ERR_FEATURE_UNSUPPORTED);
    // Of a request for the expanded form, too.
    PackedRequest expanded;
    expanded.forms = L4D_CUDA_FORM_EXPANDED;
    EXPECT_EQ(pack_on_both(file, all_query(), expanded).device.verdict.status,
              L4D_ERR_FEATURE_UNSUPPORTED);
  }
  PackedRequest request;
  request.forms = L4D_CUDA_FORM_EXPANDED;
  EXPECT_EQ(pack_on_both(dynamic_file(), all_query(), request).device.verdict.status,
            L4D_ERR_INVALID_ARGUMENT);
  for (const uint32_t forms : {0u, 4u}) {
    request.forms = forms;
    EXPECT_EQ(pack_on_both(dynamic_file(), all_query(), request).device.verdict.status,
              L4D_ERR_INVALID_ARGUMENT);
  }
}

TEST_F(Packed, BothFormsOfOneRequest) {
  for (const bool rans : {true, false}) {
    const Bytes file = escape_file(2000, 2, rans);
    DecoderHandle decoder, host;
    decoder.open_memory(file.data(), file.size());
    host.open_memory(file.data(), file.size());
    DeviceDecoding device(decoder);
    PackedRequest both;
    both.forms = L4D_CUDA_FORM_EXPANDED | L4D_CUDA_FORM_PACKED;
    PackedPair pair;
    pair.host = pack_on_host(host, all_query(), both);
    pair.device = pack_on_device(decoder, device, all_query(), both);
    EXPECT_TRUE(same_packed(pair));
    // The request is still there.
    const GaussianArrays expected = decode(file, all_query());
    l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
    request.forms = both.forms;
    const l4d_query query = all_query();
    ASSERT_EQ(l4d_cuda_decoder_prepare(device.get(), &query, &request), L4D_OK);
    const PoisonedMemory workspace(static_cast<size_t>(request.workspace_bytes));
    const PoisonedMemory sh(expected.sh.size() * sizeof(float));
    l4d_cuda_gaussian_buffers buffers = L4D_INIT(l4d_cuda_gaussian_buffers);
    buffers.capacity = request.num_gaussians;
    buffers.sh = sh.floats();
    ASSERT_EQ(l4d_cuda_decoder_decode(device.get(), &buffers, workspace.data(),
                                      request.workspace_bytes, nullptr),
              L4D_OK);
    ASSERT_EQ(l4d_cuda_decoder_finish(device.get()), L4D_OK);
    EXPECT_TRUE(same_bits("sh", sh.read(), expected.sh));
    uint64_t escapes = 0;
    EXPECT_EQ(l4d_cuda_decoder_get_num_escapes(device.get(), 0, &escapes), L4D_ERR_INVALID_STATE);
  }
}

TEST_F(Packed, CodebooksStayUnread) {
  StreamEditor editor(escape_file(900, 1, true));
  ASSERT_FALSE(editor.sh_codebooks.empty());
  for (EditedChunk& codebook : editor.sh_codebooks) codebook.wrong_hash = true;
  const Bytes file = editor.build();
  EXPECT_EQ(decode_on_device(file, all_query()).status, L4D_ERR_CHECKSUM);
  const PackedPair pair = pack_on_both(file, all_query());
  EXPECT_EQ(pair.device.verdict.status, L4D_OK);
  EXPECT_TRUE(same_packed(pair));
}

TEST_F(Packed, CodebooksAreThoseOfTheHost) {
  for (const Bytes& file : {escape_file(900, 1, true), block_codebooks_file(true),
                            block_codebooks_file(false), transform_file()}) {
    DecoderHandle decoder, host;
    decoder.open_memory(file.data(), file.size());
    host.open_memory(file.data(), file.size());
    DeviceDecoding device(decoder);
    const GaussianArrays all = decode(file, all_query());
    int codebooks = 0, blocks = 0;
    const auto compare = [&](uint32_t layer, uint32_t c, uint32_t s, uint32_t block) {
      l4d_codebook expected, found;
      expected = L4D_INIT(l4d_codebook);
      found = L4D_INIT(l4d_codebook);
      ASSERT_EQ(l4d_decoder_get_codebook(host.get(), layer, c, s, block, &expected), L4D_OK);
      ASSERT_EQ(l4d_cuda_decoder_get_codebook(device.get(), layer, c, s, block, &found), L4D_OK);
      ASSERT_EQ(found.num_entries, expected.num_entries);
      ASSERT_EQ(found.dim, expected.dim);
      ASSERT_EQ(found.entries == nullptr, expected.entries == nullptr);
      if (found.entries == nullptr) return;
      ++codebooks;
      if (block != L4D_NO_BLOCK) ++blocks;
      std::vector<float> entries(size_t{found.num_entries} * found.dim);
      const size_t bytes = entries.size() * sizeof(float);
      cuda_check(cudaMemcpy(entries.data(), found.entries, bytes, cudaMemcpyDeviceToHost));
      EXPECT_EQ(std::memcmp(entries.data(), expected.entries, bytes), 0);
    };
    for (uint32_t layer = 0; layer < decoder.info().num_layers; ++layer) {
      for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        for (uint32_t s = 0; s < L4D_MAX_STAGES; ++s) compare(layer, c, s, L4D_NO_BLOCK);
      }
    }
    for (const l4d_bucket_span& r : all.spans) {
      if (r.block == L4D_NO_BLOCK) continue;
      for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) compare(r.layer, c, 0, r.block);
    }
    EXPECT_EQ(blocks > 0, (decoder.info().tools & L4D_TOOL_RCQ) != 0);
    EXPECT_EQ(codebooks > 0, (decoder.info().tools & L4D_TOOL_TRANSFORM) == 0);
    l4d_codebook none = L4D_INIT(l4d_codebook);
    EXPECT_EQ(l4d_cuda_decoder_get_codebook(device.get(), 1000, 0, 0, L4D_NO_BLOCK, &none),
              L4D_ERR_INVALID_ARGUMENT);
  }
}

// Checksums repaired, as in the damage tests of the expanded form.
TEST_F(Packed, DamageIsFoundWhereTheHostFindsIt) {
  Random random(9);
  std::map<std::string, int> seen;
  for (const bool rans : {true, false}) {
    const Bytes file = escape_file(900, 1, rans);
    for (int round = 0; round < 60; ++round) {
      StreamEditor editor(file);
      EditedLayer& layer = editor.layers[random.below(static_cast<uint32_t>(editor.layers.size()))];
      if (layer.directory.empty() || !layer.directory[0].present) continue;
      const uint32_t pages = static_cast<uint32_t>(layer.directory[0].pages.size());
      Bytes& bytes = layer.directory[0].pages[random.below(pages)].raw;
      const uint32_t at = random.below(static_cast<uint32_t>(bytes.size()));
      bytes[at] = static_cast<unsigned char>(bytes[at] ^ (1u << random.below(8)));
      SCOPED_TRACE(testing::Message() << "rans " << rans << ", round " << round << ", byte " << at);
      const PackedPair pair = pack_on_both(editor.build(), all_query());
      ASSERT_TRUE(same_packed(pair));
      const Verdict& v = pair.host.verdict;
      ++seen[v.status == L4D_OK ? "OK" : v.where.substr(0, v.where.find(" at"))];
    }
  }
  for (const auto& [clause, count] : seen) std::cout << clause << ": " << count << "\n";
  EXPECT_GT(seen["spec RANS-7"], 0);
  EXPECT_GT(seen["spec VQ-2"], 0);
}

}  // namespace
}  // namespace l4d::test
