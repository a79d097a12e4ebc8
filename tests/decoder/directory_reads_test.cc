// SPDX-License-Identifier: Apache-2.0
// A query reads and decodes each directory page once, whatever is wrong with it and however often
// the query comes back to it.
#include <gtest/gtest.h>

#include <set>
#include <string>

#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"
#include "tests/decoder/damage.h"
#include "tests/decoder/recording_reader.h"

namespace l4d {
namespace {

using namespace test;

// Every other bucket of the layers of a file, so that queries come back to directory pages.
std::vector<l4d_bucket> every_other_bucket(const SceneHeader& header) {
  std::vector<l4d_bucket> buckets;
  for (uint32_t l = 0; l < header.layers.size(); ++l) {
    for (uint32_t b = 0; b < num_buckets(header.layers[l].level); b += 2) buckets.push_back({l, b});
  }
  return buckets;
}

std::vector<l4d_query> queries(const std::vector<l4d_bucket>& buckets) {
  l4d_query listed = all_query();
  listed.kind = L4D_QUERY_BUCKETS;
  listed.buckets = buckets.data();
  listed.num_buckets = buckets.size();
  return {all_query(), time_query(1.0), listed};
}

DecoderHandle open_tolerant(RecordingReader& reader) {
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.tolerant = 1;
  DecoderHandle d(&options);
  d.open(reader.reader());
  return d;
}

// Where the directory pages of a file are, as its page tables say.
std::vector<uint64_t> directory_offsets(const Bytes& file) {
  std::vector<uint64_t> offsets;
  for (const Chunk& chunk : Anatomy(file).chunks) {
    if (chunk.kind == Chunk::kDirectory) offsets.push_back(chunk.ref.offset);
  }
  return offsets;
}

// Cuts the directory of each layer into pages of four buckets.
Bytes with_small_directory_pages(const Bytes& file) {
  constexpr uint32_t kBits = 2;
  StreamEditor editor(file);
  for (uint32_t l = 0; l < editor.layers.size(); ++l) {
    LayerHeader& layer = editor.header.layers[l];
    EditedLayer& edited = editor.layers[l];
    if (edited.directory.size() != 1 || layer.directory_bits <= kBits) continue;
    const EditedDirectoryPage whole = std::move(edited.directory[0]);
    layer.directory_bits = kBits;
    edited.directory.assign(num_directory_pages(layer), EditedDirectoryPage());
    for (uint32_t d = 0; d < edited.directory.size(); ++d) {
      edited.directory[d].says_layer = l;
      edited.directory[d].says_index = d;
    }
    for (size_t p = 0; p < whole.page.pages.size(); ++p) {
      EditedDirectoryPage& to = edited.directory[whole.page.pages[p].bucket >> kBits];
      to.present = true;
      to.page.pages.push_back(whole.page.pages[p]);
      to.pages.push_back(whole.pages[p]);
      to.details.push_back(whole.details[p]);
    }
  }
  return editor.build();
}

TEST(DirectoryReads, ADamagedPageIsReadOnceInAQuery) {
  const Bytes file = with_small_directory_pages(dynamic_file());
  ASSERT_TRUE(validate(file).empty());
  const Anatomy anatomy(file);
  const std::vector<l4d_bucket> buckets = every_other_bucket(anatomy.editor.header);
  size_t with_loss = 0;
  for (const Chunk& chunk : anatomy.chunks) {
    if (chunk.kind != Chunk::kDirectory) continue;
    SCOPED_TRACE(chunk.name);
    const Bytes damaged = damage(file, chunk);
    for (const l4d_query& query : queries(buckets)) {
      RecordingReader reader(damaged);
      const DecoderHandle d = open_tolerant(reader);
      d.select(query);
      const size_t reads = reader.reads_of(chunk.ref.offset);
      EXPECT_LE(reads, 1u);
      EXPECT_EQ(losses_of(d).size(), reads);
      with_loss += reads;
      // The next query asks for it again: the reader may have recovered.
      d.select(query);
      EXPECT_EQ(reader.reads_of(chunk.ref.offset), 2 * reads);
    }
  }
  EXPECT_GT(with_loss, 30u);
}

// A file in which all entries of a page table name one page, which is at *offset.
Bytes with_shared_page(uint64_t* offset) {
  StreamEditor editor(with_small_directory_pages(dynamic_file()));
  const auto place = editor.find([](const LayerHeader& l) { return l.level >= 3; });
  Bytes file = editor.build();
  const size_t table =
      static_cast<size_t>(StreamEditor(file).header.layers[place.layer].page_table_offset);
  const size_t at = table + place.directory * PageTableEntry::kBytes;
  const Bytes entry(file.begin() + static_cast<std::ptrdiff_t>(at),
                    file.begin() + static_cast<std::ptrdiff_t>(at + PageTableEntry::kBytes));
  PageTableEntry parsed;
  EXPECT_TRUE(PageTableEntry::parse(entry, at, &parsed).ok());
  *offset = parsed.chunk.offset;
  for (size_t i = 0; i < editor.layers[place.layer].directory.size(); ++i) {
    std::copy(entry.begin(), entry.end(),
              file.begin() + static_cast<std::ptrdiff_t>(table + i * PageTableEntry::kBytes));
  }
  return file;
}

// spec: CHNK-4
TEST(DirectoryReads, APageThatManyEntriesNameIsDecodedOnce) {
  uint64_t offset = 0;
  const Bytes file = with_shared_page(&offset);
  const std::vector<l4d_bucket> buckets = every_other_bucket(StreamEditor(dynamic_file()).header);
  for (const l4d_query& query : queries(buckets)) {
    SCOPED_TRACE(query.kind);
    RecordingReader reader(file);
    const DecoderHandle d = open_tolerant(reader);
    d.select(query);
    EXPECT_EQ(reader.reads_of(offset), 1u);
    std::set<std::string> clauses;
    for (const l4d_loss& loss : losses_of(d)) {
      clauses.insert(loss.clause);
      EXPECT_EQ(loss.offset, offset);
    }
    // An instant reads pages that follow each other: two at most.
    EXPECT_TRUE(query.kind == L4D_QUERY_TIME || clauses.count("CHNK-4") == 1);
  }
}

// Pages that are larger than what a decoder keeps of the directory, with blocks.
TEST(DirectoryReads, ALargePageIsReadOnceInAQuery) {
  StreamEditor editor(rcq_file());
  size_t with_blocks = 0;
  for (EditedLayer& layer : editor.layers) {
    for (EditedDirectoryPage& d : layer.directory) {
      d.chunk.codec = static_cast<uint32_t>(ChunkCodec::kZstd);
      d.on_bytes = [](Bytes& b) { b.resize(size_t{12} << 20, 0); };
      with_blocks += d.present && !d.page.blocks.empty();
    }
  }
  ASSERT_GT(with_blocks, 0u);
  const Bytes file = editor.build();
  const std::vector<l4d_bucket> buckets = every_other_bucket(editor.header);
  const std::vector<uint64_t> offsets = directory_offsets(file);
  for (const l4d_query& query : queries(buckets)) {
    RecordingReader reader(file);
    const l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
    DecoderHandle d(&options);
    d.open(reader.reader());
    const GaussianArrays found = d.decode(query);
    EXPECT_TRUE(same_bits(found, decode(rcq_file(), query)));
    // DecoderHandle selects first, to size its arrays: two queries.
    for (const uint64_t offset : offsets) EXPECT_LE(reader.reads_of(offset), 2u) << offset;
  }
}

}  // namespace
}  // namespace l4d
