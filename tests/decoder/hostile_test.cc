// SPDX-License-Identifier: Apache-2.0
// Files that nobody wrote by accident: right checksums, wrong content.
#include <gtest/gtest.h>

#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"
#include "tests/decoder/allocation_meter.h"

namespace l4d {
namespace {

using namespace test;

// Opens, decodes and slices under a limit; what was allocated at most.
struct Cost {
  l4d_status status = L4D_OK;
  uint64_t allocated = 0;
};

Cost cost_of(const Bytes& bytes, uint64_t limit) {
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.max_memory_bytes = limit;
  Cost cost;
  const AllocationMeter meter;
  DecoderHandle d(&o);
  cost.status = l4d_decoder_open_memory(d.get(), bytes.data(), bytes.size());
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  if (cost.status == L4D_OK) cost.status = l4d_decoder_slice(d.get(), 0, &b);
  cost.allocated = meter.peak();
  return cost;
}

// spec: DEC-6
TEST(Hostile, LargeCodebooksAreRefusedBeforeTheyAreAllocated) {
  StreamEditor editor(dynamic_file());
  editor.header.sh.stages[0].num_entries = 65536;
  Bytes raw;
  for (unsigned k = 0; k < editor.header.sh_dim(); ++k) {
    const Bytes constant = constant_stream(0x8000, 16);
    raw.insert(raw.end(), constant.begin(), constant.end());
  }
  editor.sh_codebooks[0].raw = raw;
  const Bytes bytes = editor.build();
  const Cost cost = cost_of(bytes, 1u << 20);
  EXPECT_EQ(cost.status, L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_LT(cost.allocated, 3u << 20);
}

// A FlatBuffer may refer to one table many times: four bytes each. What is made of it must not be
// many times what was charged.
TEST(Hostile, SharedTablesOfADirectoryPageDoNotMultiply) {
  constexpr uint32_t kBlocks = 1000000;
  StreamEditor editor(dynamic_file());
  EditedDirectoryPage& d =
      editor.at(editor.find([](const LayerHeader& l) { return !l.permanent; }));
  const uint32_t layer = d.says_layer, index = d.says_index;
  d.chunk.codec = 1;
  d.on_bytes = [=](Bytes& b) {
    b.clear();
    append_le<uint32_t>(20, b);  // root
    for (const char c : {'L', '4', 'D', 'D'}) b.push_back(static_cast<unsigned char>(c));
    for (const uint16_t v : std::vector<uint16_t>{12, 20, 4, 8, 12, 16})
      append_le<uint16_t>(v, b);  // its vtable
    append_le<uint32_t>(12, b);   // root table, at 20
    append_le<uint32_t>(layer, b);
    append_le<uint32_t>(index, b);
    append_le<uint32_t>(8, b);  // pages, at 40
    append_le<uint32_t>(8, b);  // blocks, at 44
    append_le<uint32_t>(0, b);  // no page
    append_le<uint32_t>(kBlocks, b);
    const uint32_t block = 48 + 4 * kBlocks + 8;
    for (uint32_t i = 0; i < kBlocks; ++i) append_le<uint32_t>(block - (48 + 4 * i), b);
    for (const uint16_t v : std::vector<uint16_t>{6, 8, 4, 0})
      append_le<uint16_t>(v, b);  // vtable of the one block
    append_le<uint32_t>(8, b);    // the block
    append_le<uint32_t>(4, b);    // its tables
    append_le<uint32_t>(0, b);    // none
  };
  const Bytes bytes = editor.build();
  ASSERT_LT(bytes.size(), 4u << 20);
  constexpr uint64_t kLimit = 24u << 20;
  EXPECT_LT(cost_of(bytes, kLimit).allocated, kLimit + (8u << 20));
}

// Chunks may lie anywhere: alignment is no property of the format.
TEST(Hostile, OddOffsets) {
  for (size_t shift = 1; shift < 8; ++shift) {
    StreamEditor editor(dynamic_file());
    for (EditedLayer& l : editor.layers) {
      for (EditedDirectoryPage& d : l.directory) d.chunk.codec = 0;  // read in place
    }
    editor.sh_codebooks[0].codec = 0;
    const Bytes built = editor.build();
    // The same bytes at an odd address, whole file and all.
    Bytes storage(built.size() + shift);
    std::copy(built.begin(), built.end(), storage.begin() + static_cast<std::ptrdiff_t>(shift));
    DecoderHandle d;
    d.open_memory(storage.data() + shift, built.size());
    EXPECT_TRUE(same_bits(decode(dynamic_file(), all_query()), d.decode(all_query())));
  }
}

// Random changes under right checksums: refused, or decoded to something, but never out of bounds.
TEST(Hostile, RandomContentIsSafe) {
  Random random(31);
  const Bytes* const kFiles[] = {&tiny_file(), &staged_file(), &dynamic_file(), &lossless_file()};
  int accepted = 0, refused = 0;
  for (int round = 0; round < 400; ++round) {
    StreamEditor editor(*kFiles[round % 4]);
    const auto damage = [&](Bytes& b) {
      for (uint32_t k = 0; k <= random.below(3) && !b.empty(); ++k) {
        b[random.below(static_cast<uint32_t>(b.size()))] =
            static_cast<unsigned char>(random.below(2) == 0 ? random.below(16) : random.below(256));
      }
    };
    EditedLayer& layer = editor.layers[random.below(static_cast<uint32_t>(editor.layers.size()))];
    EditedDirectoryPage& d =
        layer.directory[random.below(static_cast<uint32_t>(layer.directory.size()))];
    switch (random.below(5)) {
      case 0:
        editor.on_scene_header = damage;
        break;
      case 1:
        d.on_bytes = damage;
        break;
      case 2:
        if (!editor.sh_codebooks.empty()) damage(editor.sh_codebooks[0].raw);
        break;
      default:
        if (!d.pages.empty())
          damage(d.pages[random.below(static_cast<uint32_t>(d.pages.size()))].raw);
        break;
    }
    const Bytes bytes = editor.build();
    const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    DecoderHandle dec(&o);
    try {
      dec.open_memory(bytes.data(), bytes.size());
      if (dec.info().num_gaussians > 100000) continue;  // would only measure the allocator
      dec.decode(all_query());
      dec.slice(0.5);
      validate(bytes);
      ++accepted;
    } catch (const Error& e) {
      ++refused;
      EXPECT_TRUE(e.status() <= L4D_ERR_NOT_L4D || e.status() == L4D_ERR_LIMIT_EXCEEDED)
          << e.what();
      EXPECT_NE(e.status(), L4D_ERR_INTERNAL) << e.what();
    }
  }
  EXPECT_GT(accepted, 20);
  EXPECT_GT(refused, 20);
}

}  // namespace
}  // namespace l4d
