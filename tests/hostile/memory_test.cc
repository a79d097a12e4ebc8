// SPDX-License-Identifier: Apache-2.0
// Structures that cost a file little and a decoder much, in number rather than in size: none may
// carry it past the limit on memory.
#include <gtest/gtest.h>

#include <functional>

#include "l4d/experimental/packed.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"
#include "tests/decoder/allocation_meter.h"
#include "tests/hostile/small_files.h"

namespace l4d {
namespace {

using namespace test;

constexpr uint64_t kMiB = uint64_t{1} << 20;
// Working memory of one thread, handle and strings: what is not charged to the limit.
constexpr uint64_t kUncharged = 4 * kMiB;

bool permanent(const LayerHeader& l) { return l.permanent; }

// One layer, with `change` made to its only directory page as it is written.
Bytes one_layer(uint64_t gaussians, const std::function<void(StreamEditor&)>& prepare,
                const std::function<void(DirectoryPage&)>& change) {
  StreamEditor editor(small_files().at(0).bytes);
  const auto place = editor.find(permanent);
  EditedLayer layer = editor.layers[place.layer];
  LayerHeader header = editor.header.layers[place.layer];
  header.num_gaussians = editor.header.num_gaussians = gaussians;
  EditedDirectoryPage& only = layer.directory.at(0);
  only.page.pages.resize(1);
  only.pages.resize(1);
  only.says_layer = 0;
  only.chunk.codec = 1;
  editor.layers = {layer};
  editor.header.layers = {header};
  prepare(editor);
  EditedDirectoryPage& d = editor.layers[0].directory[0];
  d.on_bytes = [&](Bytes& b) {
    DirectoryPage page = d.page;
    change(page);
    b = serialize_directory_page(page, d.says_layer, d.says_index);
  };
  return editor.build();
}

void append(Bytes& to, const Bytes& from) { to.insert(to.end(), from.begin(), from.end()); }

// A small page many times, each to be decoded for one Gaussian: what a decoder notes for each page
// must not add up beyond the limit.
TEST(Memory, ManyPages) {
  constexpr uint32_t kRecords = 200000;
  const Bytes file = one_layer(
      kRecords,
      [](StreamEditor& e) {
        EditedDirectoryPage& d = e.layers[0].directory[0];
        d.page.pages[0].num_gaussians = 1;
        d.pages[0].raw = Bytes(1, 0);
        d.pages[0].codec = 0;
      },
      [](DirectoryPage& page) {
        page.pages.assign(kRecords, page.pages[0]);
        for (uint32_t i = 0; i < kRecords; ++i) page.pages[i].chunk.offset += i;
      });
  ASSERT_LT(file.size(), 600000u);
  constexpr uint64_t kLimit = 64 * kMiB;
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.max_memory_bytes = kLimit;
  std::vector<float> opacity(kRecords);
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = kRecords;
  b.opacity = opacity.data();
  const l4d_query all = all_query();
  const AllocationMeter meter;
  const DecoderHandle d(&options);
  d.check(l4d_decoder_open_memory(d.get(), file.data(), file.size()));
  const l4d_status status = l4d_decoder_decode(d.get(), &all, &b);
  EXPECT_EQ(status, L4D_ERR_LIMIT_EXCEEDED) << l4d_status_name(status);
  EXPECT_LT(meter.peak(), kLimit + kUncharged);
}

// Pages that lie apart by a little are read in one call. What lies between them counts too.
TEST(Memory, GapsBetweenPages) {
  static constexpr uint32_t kRecords = 60000, kRun = 400, kGap = 4000;
  const Bytes file = [&] {
    Bytes bytes = one_layer(
        kRecords,
        [](StreamEditor& e) {
          EditedDirectoryPage& d = e.layers[0].directory[0];
          d.page.pages[0].num_gaussians = 1;
          d.pages[0].raw = Bytes(1, 0);
          d.pages[0].codec = 0;
        },
        [](DirectoryPage& page) {
          const PageRecord first = page.pages[0];
          page.pages.clear();
          for (uint32_t i = 0; i < kRecords; ++i) {
            PageRecord r = first;
            r.chunk.offset += uint64_t{i % kRun} * kGap;
            page.pages.push_back(r);
          }
        });
    bytes.resize(bytes.size() + uint64_t{kRun} * kGap, 0);
    return bytes;
  }();
  constexpr uint64_t kLimit = 64 * kMiB;
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.max_memory_bytes = kLimit;
  std::vector<float> opacity(kRecords);
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = kRecords;
  b.opacity = opacity.data();
  const l4d_query all = all_query();
  const l4d_reader reader = memory_reader(file);
  const AllocationMeter meter;
  DecoderHandle d(&options);
  d.open(reader);
  const l4d_status status = l4d_decoder_decode(d.get(), &all, &b);
  EXPECT_TRUE(status == L4D_ERR_CORRUPT || status == L4D_ERR_LIMIT_EXCEEDED)
      << l4d_status_name(status);
  EXPECT_LT(meter.peak(), kLimit + kUncharged);
}

// Escapes of constants: gathered for the packed form, page by page.
TEST(Memory, PackedEscapes) {
  constexpr uint32_t kRecords = 16;
  constexpr uint64_t kGaussians = uint64_t{kRecords} * kMaxPageGaussians;
  const Bytes file = one_layer(
      kGaussians,
      [](StreamEditor& e) {
        e.header.sh_degree = 3;
        e.header.sh.coding = ComponentCodingId::kVq;
        e.header.sh.escapes = true;
        e.header.sh.stages.resize(1);
        e.header.sh.stages[0].num_entries = 1;
        LayerHeader& layer = e.header.layers[0];
        e.header.opacity.coding = layer.scale_factor.coding = ScalarCodingId::kConstant;
        for (ComponentCoding& c : layer.component) c.coding = ComponentCodingId::kZero;
        EditedDirectoryPage& d = e.layers[0].directory[0];
        d.page.pages[0].num_gaussians = kMaxPageGaussians;
        Bytes raw;
        for (int axis = 0; axis < 3; ++axis) append(raw, constant_stream(0x8000, 16));
        append(raw, constant_stream(kEscapeDepth, 4));
        for (unsigned k = 0; k < 48; ++k) append(raw, constant_stream(0x8000, 16));
        d.pages[0].raw = raw;
        d.pages[0].codec = 0;
        d.page.pages.assign(kRecords, d.page.pages[0]);
        d.pages.assign(kRecords, d.pages[0]);
      },
      [](DirectoryPage&) {});
  constexpr uint64_t kLimit = 48 * kMiB;
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.max_memory_bytes = kLimit;
  std::vector<uint8_t> depth(kGaussians);
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  b.capacity = kGaussians;
  b.component[L4D_COMPONENT_SH].depth = depth.data();
  const l4d_query all = all_query();
  const AllocationMeter meter;
  const DecoderHandle d(&options);
  d.check(l4d_decoder_open_memory(d.get(), file.data(), file.size()));
  const l4d_status status = l4d_decoder_decode_packed(d.get(), &all, &b);
  EXPECT_TRUE(status == L4D_OK || status == L4D_ERR_LIMIT_EXCEEDED) << l4d_status_name(status);
  // The columns of a page of 65536 escapes are working memory.
  EXPECT_LT(meter.peak(), kLimit + 16 * kMiB);
}

// Page tables say that nothing is there, a million times; all layers may share one. The first layer
// that has been read breaks DIR-5, and no other is.
TEST(Memory, EmptyDirectoryPages) {
  constexpr uint32_t kEntries = 1u << 15;
  StreamEditor editor(small_files().at(0).bytes);
  const auto place = editor.find([](const LayerHeader& l) { return !l.permanent; });
  LayerHeader layer = editor.header.layers[place.layer];
  editor.header.timeline.num_frames = 1u << 20;
  layer.level = 14;
  layer.directory_bits = 0;
  layer.num_gaussians = 1;
  constexpr uint32_t kLayers = 42;
  editor.header.layers.assign(kLayers, layer);
  editor.header.num_gaussians = kLayers;
  EditedLayer empty = editor.layers[place.layer];
  empty.directory.clear();
  editor.layers.assign(1, empty);
  Bytes table;
  for (uint32_t i = 0; i < kEntries; ++i) PageTableEntry().append(table);
  Bytes file = editor.build();
  // The table lies at the end, and all layers name it.
  const uint64_t at = file.size();
  editor.on_scene_header = [&](Bytes& b) {
    SceneHeader header;
    if (!parse_scene_header(b, 0, &header).ok()) throw std::runtime_error("bad header");
    for (LayerHeader& l : header.layers) l.page_table_offset = at + 4096;
    b = serialize_scene_header(header);
  };
  file = editor.build();
  ASSERT_LT(file.size(), at + 4096);
  file.resize(at + 4096, 0);
  append(file, table);
  ASSERT_EQ(num_directory_pages(layer), kEntries);
  constexpr uint64_t kLimit = 16 * kMiB;
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.max_memory_bytes = kLimit;
  const AllocationMeter meter;
  const DecoderHandle d(&options);
  d.check(l4d_decoder_open_memory(d.get(), file.data(), file.size()));
  const l4d_query all = all_query();
  l4d_selection selection = L4D_INIT(l4d_selection);
  const l4d_status status = l4d_decoder_select(d.get(), &all, &selection);
  EXPECT_TRUE(status == L4D_ERR_CORRUPT || status == L4D_ERR_LIMIT_EXCEEDED)
      << l4d_last_error_message();
  EXPECT_LT(meter.peak(), kLimit + kUncharged);
  // A tolerant decoder reads them all.
  options.tolerant = 1;
  DecoderHandle tolerant(&options);
  tolerant.open_memory(file.data(), file.size());
  EXPECT_EQ(l4d_decoder_select(tolerant.get(), &all, &selection), L4D_OK)
      << l4d_last_error_message();
  EXPECT_LT(meter.peak(), kLimit + kUncharged);
}

}  // namespace
}  // namespace l4d
