// SPDX-License-Identifier: Apache-2.0
// Damage that checksums do not show: the device finds what the host finds, and touches nothing
// else.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <string>

#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/common/stream_editor.h"
#include "tests/gpu/decode_support.h"

namespace l4d::test {
namespace {

Verdict of_host(const Bytes& bytes, const l4d_query& query, GaussianArrays* out) {
  const l4d_decoder_options options = decoder_options(L4D_BACKEND_REFERENCE, 1);
  DecoderHandle decoder(&options);
  try {
    decoder.open_memory(bytes.data(), bytes.size());
    *out = decoder.decode(query);
  } catch (const Error& e) {
    return verdict(e.status(), l4d_last_error_message());
  }
  return {};
}

// What the host says of a file, once the device has said the same.
Verdict same_verdict(const Bytes& bytes) {
  GaussianArrays expected;
  const Verdict host = of_host(bytes, all_query(), &expected);
  DecoderHandle decoder;
  DeviceResult found;
  try {
    decoder.open_memory(bytes.data(), bytes.size());
    found = DeviceDecoding(decoder).decode(all_query());
  } catch (const Error& e) {
    found.status = e.status();
    found.detail = l4d_last_error_message();
  }
  EXPECT_EQ(verdict(found.status, found.detail), host) << found.detail;
  if (host.status == L4D_OK && found.status == L4D_OK) {
    EXPECT_TRUE(same_bits("sh", found.arrays.sh, expected.sh));
    EXPECT_TRUE(same_bits("rotor", found.arrays.rotor, expected.rotor));
    EXPECT_TRUE(same_bits("log_scale", found.arrays.log_scale, expected.log_scale));
    EXPECT_TRUE(same_bits("position", found.arrays.position, expected.position));
    EXPECT_TRUE(same_bits("mean_t", found.arrays.mean_t, expected.mean_t));
    EXPECT_TRUE(same_bits("opacity", found.arrays.opacity, expected.opacity));
    if (!expected.window.empty()) {
      EXPECT_EQ(found.arrays.window, expected.window);
    }
  }
  return host;
}

Bytes transforms(uint64_t count, const char* preset, std::vector<Setting> settings) {
  SceneOptions s;
  s.count = count;
  s.sh_degree = 1;
  EncodeOptions o;
  o.preset = preset;
  o.rans = true;
  o.settings = std::move(settings);
  o.settings.push_back({L4D_ENC_MERGE_COUNT, 40});
  return encode(make_scene(s), o).bytes;
}

Bytes windows() {
  SceneOptions s;
  s.count = 900;
  EncodeOptions o;
  o.preset = "default";
  o.rans = true;
  o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 200}};
  return encode(windowed_scene(s, 4), o).bytes;
}

Bytes codebooks_with_escapes() {
  SceneOptions s;
  s.count = 900;
  const TestScene scene = make_scene(s);
  std::vector<float> weights(scene.count());
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<float>(i % 40);
  EncodeOptions o = small_options();
  o.rans = true;
  o.settings.push_back({L4D_ENC_ESCAPE_THRESHOLD, 30});
  o.stages = {{L4D_ENC_STAGES, {1.0f, 0.5f, 0.25f}}};
  for (uint32_t w = L4D_WEIGHT_SH; w <= L4D_WEIGHT_ROTOR_TEMPORAL; ++w) {
    o.weights.emplace_back(w, &weights);
  }
  return encode(scene, o).bytes;
}

class Damage : public OnDevice<testing::Test> {};

// Flips bits of rANS blocks and of what maps contexts to tables, checksums repaired.
TEST_F(Damage, OfPagesAndTablesIsFoundWhereTheHostFindsIt) {
  Random random(5);
  std::map<std::string, int> seen;
  SceneOptions large;
  large.count = 12000;
  large.permanent = 1;
  large.sh_degree = 1;
  EncodeOptions in_parts;
  in_parts.preset = "default";
  in_parts.rans = true;
  const Bytes files[] = {transforms(600, "default", {{L4D_ENC_PAGE_SIZE, 200}}),
                         transforms(600, "default", {{L4D_ENC_FIXED_POSITIONS, 0}}),
                         transforms(700, "indexed", {{L4D_ENC_CODEBOOK_SIZE, 50}}),
                         codebooks_with_escapes(),
                         windows(),
                         encode(make_scene(large), in_parts).bytes};
  for (const Bytes& file : files) {
    for (int round = 0; round < 60; ++round) {
      StreamEditor editor(file);
      EditedLayer& layer = editor.layers[random.below(static_cast<uint32_t>(editor.layers.size()))];
      if (layer.directory.empty()) continue;
      EditedDirectoryPage& directory =
          layer.directory[random.below(static_cast<uint32_t>(layer.directory.size()))];
      if (!directory.present) continue;
      const uint32_t page = random.below(static_cast<uint32_t>(directory.pages.size()));
      Bytes* bytes = &directory.pages[page].raw;
      if (random.below(4) == 0 && !directory.details[page].raw.empty()) {
        bytes = &directory.details[page].raw;
      }
      // The end of the chunk of tables is the maps; what an index of a table is can be any.
      if (random.below(4) == 0) bytes = &layer.entropy.raw;
      const bool tables = bytes == &layer.entropy.raw;
      const uint32_t size = static_cast<uint32_t>(bytes->size());
      // Often among the states and the first words, where channels of small values are.
      const uint32_t reach = random.below(2) == 0 && !tables ? std::min(size, 400u) : size;
      const uint32_t at =
          tables ? size - 1 - random.below(std::min(size, 300u)) : random.below(reach);
      (*bytes)[at] = static_cast<unsigned char>(tables ? (*bytes)[at] ^ (1 + random.below(3))
                                                       : (*bytes)[at] ^ (1u << random.below(8)));
      if (!tables && random.below(8) == 0) bytes->resize(size - 1 - random.below(size / 2));
      SCOPED_TRACE(testing::Message() << "round " << round << ", byte " << at);
      const Verdict v = same_verdict(editor.build());
      ++seen[v.status == L4D_OK ? "OK" : v.where.substr(0, v.where.find(" at"))];
      if (HasFailure()) return;
    }
  }
  for (const auto& [clause, count] : seen) {
    RecordProperty(clause, count);
    std::cout << clause << ": " << count << "\n";
  }
  for (const char* clause :
       {"spec RANS-1", "spec RANS-7", "spec RANS-8", "spec TRAN-6", "spec VQ-2"}) {
    EXPECT_GT(seen[clause], 0) << clause;
  }
}

// Headers that allow less than the pages hold.
TEST_F(Damage, OfLimitsIsFoundWhereTheHostFindsIt) {
  const Bytes fixed = transforms(600, "default", {{L4D_ENC_PAGE_SIZE, 200}});
  std::set<std::string> seen;
  const auto check = [&](const Bytes& file, const std::function<void(SceneHeader&)>& edit) {
    StreamEditor editor(file);
    edit(editor.header);
    const Verdict v = same_verdict(editor.build());
    EXPECT_EQ(v.status, L4D_ERR_CORRUPT);
    seen.insert(v.where.substr(0, v.where.find(" at")));
  };
  check(fixed, [](SceneHeader& h) { --h.position_bits; });
  check(fixed, [](SceneHeader& h) { --h.opacity.bits; });
  const Bytes half = transforms(600, "indexed", {{L4D_ENC_CODEBOOK_SIZE, 50}});
  check(half, [](SceneHeader& h) {
    for (LayerHeader& l : h.layers) --l.scale_factor.bits;
  });
  EXPECT_TRUE(seen.count("spec RANS-8"));
  EXPECT_TRUE(seen.count("spec STRM-3"));
}

// Lengths count from another number, or begins have one bit less.
TEST_F(Damage, OfWindowsIsFoundWhereTheHostFindsIt) {
  std::set<std::string> seen;
  const auto check = [&](const std::function<void(LayerHeader&)>& edit) {
    StreamEditor editor(windows());
    // Pages of raw positions are the host's, which decodes them before the device begins.
    for (LayerHeader& layer : editor.header.layers) {
      if (layer.flat() && !layer.raw_position) edit(layer);
    }
    const Verdict v = same_verdict(editor.build());
    EXPECT_EQ(v.status, L4D_ERR_CORRUPT);
    seen.insert(v.where.substr(0, v.where.find(" at")));
  };
  check([](LayerHeader& layer) { layer.window_length = 0; });
  check([](LayerHeader& layer) { layer.window_length = 100; });
  EXPECT_EQ(seen, std::set<std::string>{"spec WIND-3"});
  check([](LayerHeader& layer) { layer.window_begin_bits -= layer.window_begin_bits > 1 ? 1 : 0; });
  EXPECT_TRUE(seen.count("spec STRM-3"));
}

// Of a decode on the host of the opacities alone.
l4d_status opacity_status(const Bytes& file, size_t count) {
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  std::vector<float> opacity(count);
  l4d_gaussian_buffers buffers = L4D_INIT(l4d_gaussian_buffers);
  buffers.capacity = count;
  buffers.opacity = opacity.data();
  const l4d_query query = all_query();
  return l4d_decoder_decode(decoder.get(), &query, &buffers);
}

TEST_F(Damage, LeavesRowsOfOtherPagesAndNoTraceInItsOwn) {
  const Bytes file = transforms(2000, "default", {{L4D_ENC_PAGE_SIZE, 200}});
  StreamEditor editor(file);
  // Of escapes any bits are right.
  const StreamEditor::Place place =
      editor.find([](const LayerHeader& layer) { return !layer.raw_position; });
  ASSERT_GT(editor.at(place).pages.size(), 2u);
  const uint64_t n = editor.at(place).page.pages[1].num_gaussians;
  const GaussianArrays expected = decode(file, all_query(), L4D_BACKEND_REFERENCE);
  // A bit that the host notices, which is not any one in every coding.
  Bytes& bytes = editor.at(place).pages[1].raw;
  Bytes damaged;
  for (size_t at = bytes.size() / 4; at < bytes.size() && damaged.empty(); ++at) {
    bytes[at] ^= 0x10;
    const Bytes changed = editor.build();
    if (opacity_status(changed, expected.count()) == L4D_ERR_CORRUPT) damaged = changed;
    bytes[at] ^= 0x10;
  }
  ASSERT_FALSE(damaged.empty());

  DecoderHandle decoder;
  decoder.open_memory(damaged.data(), damaged.size());
  DeviceDecoding device(decoder);
  l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
  const l4d_query query = all_query();
  ASSERT_EQ(l4d_cuda_decoder_prepare(device.get(), &query, &request), L4D_OK);
  const PoisonedMemory workspace(static_cast<size_t>(request.workspace_bytes));
  const PoisonedMemory array(static_cast<size_t>(request.num_gaussians) * sizeof(float));
  const std::vector<float> before = array.read();
  l4d_cuda_gaussian_buffers buffers = L4D_INIT(l4d_cuda_gaussian_buffers);
  buffers.capacity = request.num_gaussians;
  buffers.opacity = array.floats();
  ASSERT_EQ(l4d_cuda_decoder_decode(device.get(), &buffers, workspace.data(),
                                    request.workspace_bytes, nullptr),
            L4D_OK);
  ASSERT_EQ(l4d_cuda_decoder_finish(device.get()), L4D_ERR_CORRUPT);
  const std::vector<float> found = array.read();
  std::vector<float> wanted = expected.opacity;
  // The damaged page is the second one of the first layer.
  const uint64_t first = editor.at(place).page.pages[0].num_gaussians;
  std::copy_n(before.begin() + static_cast<std::ptrdiff_t>(first), n,
              wanted.begin() + static_cast<std::ptrdiff_t>(first));
  EXPECT_TRUE(same_bits("opacity", found, wanted));
}

TEST_F(Damage, OfChecksumsAndSizesIsFoundByPrepare) {
  const Bytes file = transforms(600, "default", {{L4D_ENC_PAGE_SIZE, 200}});
  StreamEditor hash(file);
  const StreamEditor::Place place = hash.find([](const LayerHeader&) { return true; });
  hash.at(place).pages[0].wrong_hash = true;
  EXPECT_EQ(same_verdict(hash.build()).status, L4D_ERR_CHECKSUM);
  StreamEditor cut(file);
  cut.at(place).pages[0].raw.resize(100);
  EXPECT_EQ(same_verdict(cut.build()).where.substr(0, 11), "spec RANS-1");
  StreamEditor state(file);
  std::fill_n(state.at(place).pages[0].raw.begin(), 4, static_cast<unsigned char>(0));
  EXPECT_EQ(same_verdict(state.build()).where.substr(0, 11), "spec RANS-3");
}

}  // namespace
}  // namespace l4d::test
