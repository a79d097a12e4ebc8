// SPDX-License-Identifier: Apache-2.0
// What a few bytes can make a decoder hold, hand out or plan, structure by structure, and what
// stops it. The table that the test prints is that of docs/hostile-input.md.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#ifdef L4D_TEST_RENDERER
#include "l4d/render.hpp"
#endif
#include "l4d/experimental/copy.h"
#include "l4d/members.h"
#include "tests/common/codec.h"
#include "tests/common/flat.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"
#include "tests/decoder/allocation_meter.h"
#include "tests/hostile/small_files.h"

namespace l4d {
namespace {

using namespace test;

constexpr uint64_t kMiB = uint64_t{1} << 20;
constexpr uint64_t kGaussianBytes = (3 + 1 + 1 + 4 + 8 + 1 + 48) * sizeof(float);
struct Cost {
  l4d_status status = L4D_OK;
  uint64_t held = 0;       // most bytes that the library had allocated
  uint64_t gaussians = 0;  // handed out or selected
};

enum class Use { kOpen, kSelect, kSlice };

Cost cost_of(const Bytes& file, uint64_t memory, Use use, uint64_t max_gaussians = 0) {
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.max_memory_bytes = memory;
  options.max_gaussians = max_gaussians;
  Cost cost;
  const AllocationMeter meter;
  const DecoderHandle d(&options);
  cost.status = l4d_decoder_open_memory(d.get(), file.data(), file.size());
  if (cost.status == L4D_OK && use != Use::kOpen) {
    l4d_query all = all_query();
    l4d_selection selection = L4D_INIT(l4d_selection);
    cost.status = l4d_decoder_select(d.get(), &all, &selection);
    if (cost.status == L4D_OK) cost.gaussians = selection.num_gaussians;
  }
  if (cost.status == L4D_OK && use == Use::kSlice) {
    l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
    cost.status = l4d_decoder_slice(d.get(), 1e-3, &splats);
  }
  cost.held = meter.peak();
  return cost;
}

void append(Bytes& to, const Bytes& from) { to.insert(to.end(), from.begin(), from.end()); }

void set_gaussians(StreamEditor& editor, uint64_t n) {
  editor.header.num_gaussians = n;
  editor.header.layers.at(0).num_gaussians = n;
}

// A file with one permanent layer and one page in it. SH degree 3.
StreamEditor one_page() {
  StreamEditor editor(small_files().at(2).bytes);
  const auto place = editor.find([](const LayerHeader& l) { return l.permanent; });
  EditedLayer layer = editor.layers[place.layer];
  LayerHeader header = editor.header.layers[place.layer];
  EditedDirectoryPage& d = layer.directory.at(place.directory);
  d.page.pages.resize(1);
  d.pages.resize(1);
  d.says_layer = 0;
  editor.layers = {layer};
  editor.header.layers = {header};
  set_gaussians(editor, layer.directory[0].page.pages[0].num_gaussians);
  return editor;
}

// Streams of a page of n Gaussians, none longer than a constant.
Bytes constant_page(const StreamEditor& editor) {
  const SceneHeader& header = editor.header;
  const LayerHeader& layer = header.layers.at(0);
  Bytes raw;
  for (int axis = 0; axis < 3; ++axis) append(raw, constant_stream(0x8000, 16));
  if (header.opacity.coding == ScalarCodingId::kSq) {
    append(raw, constant_stream(1, header.opacity.bits));
  }
  if (layer.scale_factor.coding == ScalarCodingId::kSq) {
    append(raw, constant_stream(1, layer.scale_factor.bits));
  }
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const ComponentCoding& coding = header.component(layer, c);
    if (!coding.vq()) continue;
    // Depth 0: neither indices nor escapes.
    if (coding.has_depth()) append(raw, constant_stream(0, 4));
    if (coding.has_depth()) continue;
    const unsigned width = bit_width(coding.stages[0].num_entries);
    if (width > 0) append(raw, constant_stream(0, width));
  }
  return raw;
}

// A page of constants that `records` records name.
Bytes repeated_page(uint32_t records, uint32_t directory_codec) {
  StreamEditor editor = one_page();
  editor.header.sh.escapes = true;  // so that depths are coded, and may be 0
  EditedDirectoryPage& d = editor.layers[0].directory[0];
  d.page.pages[0].num_gaussians = kMaxPageGaussians;
  d.pages[0].raw = constant_page(editor);
  d.pages[0].codec = 0;
  d.chunk.codec = directory_codec;
  d.on_bytes = [&](Bytes& b) {
    DirectoryPage page = d.page;
    page.pages.assign(records, d.page.pages[0]);
    b = serialize_directory_page(page, d.says_layer, d.says_index);
  };
  set_gaussians(editor, uint64_t{kMaxPageGaussians} * records);
  return editor.build();
}

void print_row(const char* what, uint64_t in, uint64_t out, const char* unit, const char* stop) {
  std::printf("| %-46s | %9llu | %12llu %s | %9.0f | %s |\n", what,
              static_cast<unsigned long long>(in), static_cast<unsigned long long>(out), unit,
              static_cast<double>(out) / static_cast<double>(in), stop);
}

// A page of constants: 270 bytes of attributes for a fraction of a bit each.
TEST(Amplification, ConstantPage) {
  const Bytes file = repeated_page(1, 0);
  const Cost cost = cost_of(file, 256 * kMiB, Use::kSlice);
  EXPECT_EQ(cost.status, L4D_OK);
  EXPECT_EQ(cost.gaussians, kMaxPageGaussians);
  print_row("constant streams, depth 0, one page", file.size(), cost.gaussians * kGaussianBytes,
            "B out", "DIR-4; the caller's arrays");
  print_row("the same, held while slicing", file.size(), cost.held, "B held", "max_memory_bytes");
  // Under a limit that the bucket does not fit in it is refused before it is allocated.
  const Cost tight = cost_of(file, 8 * kMiB, Use::kSlice);
  EXPECT_EQ(tight.status, L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_LT(tight.held, 8 * kMiB + kMiB);
}

#ifdef L4D_TEST_RENDERER
// A page of constants whose Gaussians each cover the image: each is a splat of every tile.
TEST(Amplification, HugeSplats) {
  StreamEditor editor = one_page();
  editor.header.sh.escapes = true;
  EditedDirectoryPage& d = editor.layers[0].directory[0];
  d.page.pages[0].num_gaussians = kMaxPageGaussians;
  d.pages[0].raw = constant_page(editor);
  d.pages[0].codec = 0;
  set_gaussians(editor, kMaxPageGaussians);
  const Bytes file = editor.build();
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  const SplatArrays splats = decoder.slice(1e-3);
  ASSERT_EQ(splats.count(), kMaxPageGaussians);
  // Looks at the Gaussians, which all lie in one place, from so near that they fill the image.
  const double size = std::sqrt(static_cast<double>(
      std::min({splats.covariance[0], splats.covariance[3], splats.covariance[5]})));
  l4d_camera camera = L4D_INIT(l4d_camera);
  camera.width = 640;
  camera.height = 360;
  camera.fx = camera.fy = 2000;
  camera.cx = 320;
  camera.cy = 180;
  for (size_t k = 0; k < 3; ++k) {
    camera.world_to_camera[5 * k] = 1;
    camera.world_to_camera[4 * k + 3] = -static_cast<double>(splats.position[k]);
  }
  camera.near_plane = 1e-3 * size;
  camera.world_to_camera[11] += size;
  std::vector<float> whole(size_t{3} * camera.width * camera.height), batches(whole.size());
  const auto held = [&](uint64_t memory, std::vector<float>& rgb) {
    l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
    options.max_memory_bytes = memory;
    RendererHandle renderer(&options);
    const AllocationMeter meter;
    renderer.set_decoder(decoder);
    renderer.set_time(1e-3);
    renderer.render(camera, rgb.data());
    EXPECT_EQ(renderer.stats().instances, uint64_t{kMaxPageGaussians} * 40 * 23);
    return meter.peak();
  };
  const uint64_t unlimited = held(0, whole);
  print_row("splats that each cover 640x360", file.size(), unlimited, "B held",
            "batches of 256 MiB at most");
  EXPECT_LT(unlimited, 280 * kMiB);
  const uint64_t limited = held(20 * kMiB, batches);
  print_row("the same, with 20 MiB for the renderer", file.size(), limited, "B held",
            "batches; l4d_renderer_options.max_memory_bytes");
  EXPECT_LT(limited, 20 * kMiB + kMiB / 4);
  EXPECT_EQ(whole, batches);
  std::vector<float> none(whole.size());
  EXPECT_THROW(held(8 * kMiB, none), Error);
}
#endif

// Records of one page cost 72 bytes each, and a codec of the directory makes them cost next to
// nothing: a query that meets two of them is refused.
TEST(Amplification, RecordsThatShareAPage) {
  for (const uint32_t pages : {2u, 64u, 2000u}) {
    const Bytes file = repeated_page(pages, 1);
    const Cost cost = cost_of(file, 256 * kMiB, Use::kSelect);
    EXPECT_EQ(cost.status, L4D_ERR_CORRUPT);
    EXPECT_LT(cost.held, 2 * kMiB);
    if (pages < 2000) continue;
    print_row("records that share a page, refused", file.size(), cost.held, "B held", "CHNK-4");
    EXPECT_EQ(cost_of(file, 256 * kMiB, Use::kOpen, 1000000).status, L4D_ERR_LIMIT_EXCEEDED);
    const Cost tight = cost_of(file, kMiB, Use::kSelect);
    EXPECT_EQ(tight.status, L4D_ERR_LIMIT_EXCEEDED);
    EXPECT_LT(tight.held, kMiB);
  }
}

// What a whole check of a file does, in numbers that do not depend on the machine.
struct Effort {
  l4d_status status = L4D_OK;
  uint64_t violations = 0;
  uint64_t reads = 0;   // calls of the reader: at least one for a page, or a page table entry
  bool shares = false;  // CHNK-4 is among the violations
};

Effort effort_of_validation(const Bytes& file) {
  struct Input {
    const Bytes* file;
    Effort effort;
  } input{&file, {}};
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = &input;
  reader.read_at = [](void* user, void* to, size_t n, uint64_t offset) -> int64_t {
    Input& in = *static_cast<Input*>(user);
    ++in.effort.reads;
    std::copy_n(in.file->data() + offset, n, static_cast<unsigned char*>(to));
    return static_cast<int64_t>(n);
  };
  reader.size = [](void* user) {
    return static_cast<int64_t>(static_cast<Input*>(user)->file->size());
  };
  const l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  const auto note = [](void* user, const l4d_violation* v) {
    Effort& effort = static_cast<Input*>(user)->effort;
    effort.shares = effort.shares || std::string(v->clause) == "CHNK-4";
  };
  input.effort.status = l4d_validate(&reader, &options, note, &input, &input.effort.violations);
  return input.effort;
}

// 16,000 records of one page ask for a billion Gaussians.
TEST(Amplification, ValidatingRecordsThatShareAPage) {
  const Bytes file = repeated_page(16000, 1);
  const Effort effort = effort_of_validation(file);
  EXPECT_EQ(effort.status, L4D_OK);
  EXPECT_TRUE(effort.shares);
  EXPECT_LE(effort.violations, 4u);
  EXPECT_LE(effort.reads, 40u);
  print_row("16,000 such records, validated", file.size(), effort.reads, "reads", "CHNK-4");
}

// Forty layers of a million directory pages each, whose page tables the file does not hold.
Bytes far_page_tables() {
  StreamEditor editor = one_page();
  editor.header.timeline.num_frames = 1u << 24;
  LayerHeader layer = editor.header.layers[0];
  layer.permanent = false;
  layer.mean_t = CoordinateCodingId::kF16;
  layer.num_gaussians = 1;
  layer.level = 23;
  layer.directory_bits = 4;
  EditedLayer empty = editor.layers[0];
  empty.directory.clear();
  editor.header.num_gaussians = 40;
  editor.header.layers.assign(40, layer);
  editor.layers.assign(40, empty);
  return editor.build();
}

TEST(Amplification, PageTablesBeyondTheFile) {
  const Bytes file = far_page_tables();
  const Effort effort = effort_of_validation(file);
  EXPECT_EQ(effort.status, L4D_OK);
  EXPECT_GE(effort.violations, 1u);
  EXPECT_LE(effort.violations, file.size());
  EXPECT_LE(effort.reads, file.size());
  print_row("page tables beyond the file, validated", file.size(), effort.reads, "reads", "CHNK-1");
  // A tolerant decoder need not look for a million directory pages to know that they are lost.
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.tolerant = 1;
  DecoderHandle d(&options);
  d.open_memory(file.data(), file.size());
  l4d_query all = all_query();
  l4d_selection selection = L4D_INIT(l4d_selection);
  ASSERT_EQ(l4d_decoder_select(d.get(), &all, &selection), L4D_OK) << l4d_last_error_message();
  l4d_counters counters = L4D_INIT(l4d_counters);
  ASSERT_EQ(l4d_decoder_get_counters(d.get(), &counters), L4D_OK);
  // What the file holds of each table, once together and once by entries.
  EXPECT_LE(counters.reads, 2 * 40 * file.size() / PageTableEntry::kBytes);
}

// A directory page of 64 MiB that zstd packs into a few kB.
TEST(Amplification, PackedDirectory) {
  StreamEditor editor = one_page();
  EditedDirectoryPage& d = editor.layers[0].directory[0];
  d.chunk.codec = 1;
  d.on_bytes = [](Bytes& b) { b.resize(kMaxDirectoryPageBytes, 0); };
  const Bytes file = editor.build();
  const Cost cost = cost_of(file, 256 * kMiB, Use::kSelect);
  EXPECT_EQ(cost.status, L4D_OK);
  EXPECT_LT(cost.held, 256 * kMiB);
  print_row("zstd in a directory page", file.size(), cost.held, "B held",
            "CHNK-8; max_memory_bytes");
  const Cost tight = cost_of(file, 32 * kMiB, Use::kSelect);
  EXPECT_EQ(tight.status, L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_LT(tight.held, kMiB);
  d.chunk.raw_bytes = static_cast<uint32_t>(kMaxDirectoryPageBytes + 1);
  EXPECT_EQ(cost_of(editor.build(), 256 * kMiB, Use::kSelect).status, L4D_ERR_CORRUPT);
}

// zstd under the columns of a page: 65536 values come from a few bytes, and no more than those fit.
TEST(Amplification, PackedPlanes) {
  StreamEditor editor = one_page();
  editor.header.sh.escapes = true;
  EditedDirectoryPage& d = editor.layers[0].directory[0];
  d.page.pages[0].num_gaussians = kMaxPageGaussians;
  Bytes raw;
  const std::vector<uint16_t> zeros(kMaxPageGaussians, 0x8000);
  for (int axis = 0; axis < 3; ++axis) append(raw, planes_stream(zeros, 16, false, 3));
  const Bytes rest = constant_page(editor);
  raw.insert(raw.end(), rest.begin() + 9, rest.end());
  d.pages[0].raw = raw;
  d.pages[0].codec = 0;
  set_gaussians(editor, kMaxPageGaussians);
  const Bytes file = editor.build();
  EXPECT_EQ(cost_of(file, 256 * kMiB, Use::kSlice).status, L4D_OK);
  print_row("zstd in planes: three columns of positions", raw.size(),
            uint64_t{6} * kMaxPageGaussians, "B held", "CHNK-5: n is known");
  // One value more than there are Gaussians.
  const std::vector<uint16_t> more(kMaxPageGaussians + 1, 0x8000);
  Bytes bomb = planes_stream(more, 16, false, 3);
  bomb.insert(bomb.end(), raw.begin(), raw.end());
  d.pages[0].raw = bomb;
  EXPECT_EQ(cost_of(editor.build(), 256 * kMiB, Use::kSlice).status, L4D_ERR_CORRUPT);
}

// Whole pages under zstd: raw_bytes is compared with what n Gaussians can take.
TEST(Amplification, PackedPage) {
  StreamEditor editor = one_page();
  editor.header.sh.escapes = true;
  EditedDirectoryPage& d = editor.layers[0].directory[0];
  d.page.pages[0].num_gaussians = kMaxPageGaussians;
  d.pages[0].raw = Bytes(static_cast<size_t>(max_page_bytes(editor.header, kMaxPageGaussians)), 0);
  d.pages[0].codec = 1;
  set_gaussians(editor, kMaxPageGaussians);
  const Bytes file = editor.build();
  const Cost cost = cost_of(file, 256 * kMiB, Use::kSlice);
  EXPECT_EQ(cost.status, L4D_ERR_CORRUPT);  // zeros are packed streams, and too many of them
  EXPECT_LT(cost.held, 96 * kMiB);
  print_row("zstd around a page", file.size(), cost.held, "B held", "CHNK-8; max_memory_bytes");
  d.pages[0].raw.push_back(0);
  const Cost over = cost_of(editor.build(), 256 * kMiB, Use::kSlice);
  EXPECT_EQ(over.status, L4D_ERR_CORRUPT);
  // The bucket itself is prepared before its pages are read.
  EXPECT_LT(over.held, cost.held);
}

// Codebooks cost three bytes a column, and all stages of all layers may name the same ones.
TEST(Amplification, ConstantCodebooks) {
  StreamEditor editor = one_page();
  editor.header.sh.coding = ComponentCodingId::kVq;
  editor.header.sh.escapes = true;
  Bytes raw;
  for (unsigned k = 0; k < editor.header.sh_dim(); ++k) append(raw, constant_stream(0x8000, 16));
  StageCoding stage;
  stage.num_entries = kMaxCodebookEntries;
  editor.header.sh.stages.assign(L4D_MAX_STAGES, stage);
  EditedChunk codebook;
  codebook.raw = raw;
  editor.sh_codebooks.assign(L4D_MAX_STAGES, codebook);
  EditedDirectoryPage& d = editor.layers[0].directory[0];
  d.page.pages[0].num_gaussians = 1;
  d.pages[0].raw = constant_page(editor);
  d.pages[0].codec = 0;
  set_gaussians(editor, 1);
  const Bytes file = editor.build();
  const Cost cost = cost_of(file, 256 * kMiB, Use::kSlice);
  EXPECT_EQ(cost.status, L4D_OK);
  print_row("eight SH codebooks of constants", file.size(), cost.held, "B held",
            "CODE-2, CODE-3; max_memory_bytes");
  const Cost tight = cost_of(file, 16 * kMiB, Use::kSlice);
  EXPECT_EQ(tight.status, L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_LT(tight.held, 17 * kMiB);
}

// A block codebook takes two bytes to a column and is a MiB long; a directory page has 256 blocks.
TEST(Amplification, BlockCodebooks) {
  StreamEditor editor(small_files().at(3).bytes);
  const auto place = editor.find([](const LayerHeader& l) { return l.level > 0; });
  const LayerHeader& layer = editor.header.layers[place.layer];
  EditedDirectoryPage& d = editor.at(place);
  constexpr unsigned kBlocks = 100;
  const BlockRecord block = d.page.blocks[0];
  PageRecord record = d.page.pages[0];
  record.num_gaussians = 1;
  d.page.blocks.assign(kBlocks, block);
  std::array<EditedChunk, L4D_COMPONENT_COUNT> tables = d.tables[0];
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (block.tables[c].num_entries == 0) continue;
    for (BlockRecord& b : d.page.blocks) b.tables[c].num_entries = kMaxCodebookEntries;
    const unsigned width = bit_width(layer.component[c].stages[0].num_entries);
    tables[c].raw = width == 0 ? Bytes{} : constant_stream(0, width);
    append(tables[c].raw, constant_stream(0, 1));
  }
  d.tables.assign(kBlocks, tables);
  // One bucket for each block.
  const uint64_t buckets = num_buckets(layer.level);
  d.page.pages.clear();
  d.pages.clear();
  Bytes raw;
  for (int s = 0; s < 4; ++s) append(raw, constant_stream(0x8000, 16));
  if (editor.header.opacity.coding == ScalarCodingId::kSq) {
    append(raw, constant_stream(1, editor.header.opacity.bits));
  }
  append(raw, constant_stream(1, layer.scale_factor.bits));
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const ComponentCoding& coding = editor.header.component(layer, c);
    if (!coding.vq()) continue;
    ASSERT_FALSE(coding.has_depth());
    const uint32_t entries =
        block.tables[c].num_entries != 0 ? kMaxCodebookEntries : coding.stages[0].num_entries;
    if (bit_width(entries) > 0) append(raw, constant_stream(0, bit_width(entries)));
  }
  EditedChunk chunk;
  chunk.raw = raw;
  const uint64_t pages = std::min<uint64_t>(buckets, kBlocks);
  for (uint32_t b = 0; b < pages; ++b) {
    record.bucket = b;
    record.block = b;
    record.visible_begin = 0;
    record.visible_end = 255;
    d.page.pages.push_back(record);
    d.pages.push_back(chunk);
  }
  LayerHeader& edited = editor.header.layers[place.layer];
  editor.header.num_gaussians += pages - edited.num_gaussians;
  edited.num_gaussians = pages;
  const Bytes file = editor.build();
  const Cost cost = cost_of(file, 256 * kMiB, Use::kSlice);
  EXPECT_EQ(cost.status, L4D_OK);
  print_row("block codebooks of constants", file.size(), cost.held, "B held",
            "RCQ-4, DIR-11; max_memory_bytes");
  const Cost tight = cost_of(file, 3 * kMiB, Use::kSlice);
  EXPECT_EQ(tight.status, L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_LT(tight.held, 4 * kMiB);
}

// Metadata strings may be shared, but not spelled out beyond the size of the header.
TEST(Amplification, SharedMetadata) {
  StreamEditor editor = one_page();
  for (int i = 0; i < 5000; ++i) editor.header.metadata.emplace_back("", "");
  editor.on_scene_header = share_metadata;
  const Bytes file = editor.build();
  const Cost cost = cost_of(file, 256 * kMiB, Use::kOpen);
  EXPECT_EQ(cost.status, L4D_OK);
  print_row("metadata entries that share a string", file.size(), cost.held, "B held",
            "HEAD-1 (tables), HEAD-13");
  EXPECT_LT(cost.held, 40 * file.size());
}

// `count` standing members, copies of one stream, and an index if asked for.
Bytes many_members(const Bytes& stream, uint32_t count, bool with_index) {
  Bytes file;
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = &file;
  writer.write = [](void* user, const void* src, size_t n) {
    const auto* bytes = static_cast<const unsigned char*>(src);
    append(*static_cast<Bytes*>(user), Bytes(bytes, bytes + n));
    return 0;
  };
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  p.is_member = 1;
  p.role = L4D_MEMBER_STANDING;
  const l4d_reader reader = memory_reader(stream);
  for (p.number = 0; p.number < count; ++p.number) {
    EXPECT_EQ(l4d_copy_member(&reader, nullptr, &p, &writer, nullptr), L4D_OK);
  }
  if (!with_index) return file;
  const Bytes members = file;
  const l4d_reader whole = memory_reader(members);
  l4d_members* list = nullptr;
  EXPECT_EQ(l4d_members_open(&whole, nullptr, &list), L4D_OK);
  EXPECT_EQ(l4d_write_member_index(list, &writer, nullptr), L4D_OK);
  l4d_members_destroy(list);
  return file;
}

uint64_t cost_of_list(const Bytes& file, uint64_t memory, l4d_status want) {
  const l4d_reader reader = memory_reader(file);
  l4d_members_options options = L4D_INIT(l4d_members_options);
  options.max_memory_bytes = memory;
  const AllocationMeter meter;
  l4d_members* list = nullptr;
  EXPECT_EQ(l4d_members_open(&reader, &options, &list), want);
  const uint64_t held = meter.peak();
  l4d_members_destroy(list);
  return held;
}

// A list of members has an entry for each, whether it comes from their headers or from an index.
TEST(Amplification, Members) {
  constexpr uint32_t kMembers = 3000;
  for (const bool with_index : {false, true}) {
    const Bytes file = many_members(tiny_file(), kMembers, with_index);
    const uint64_t held = cost_of_list(file, 256 * kMiB, L4D_OK);
    print_row(with_index ? "the same with an index" : "3,000 members", file.size(), held, "B held",
              "max_memory_bytes");
    EXPECT_LT(held, kMembers * 600);
    EXPECT_LT(cost_of_list(file, kMiB / 8, L4D_ERR_LIMIT_EXCEEDED), kMiB / 2);
  }
}

}  // namespace
}  // namespace l4d
