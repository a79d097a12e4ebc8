// SPDX-License-Identifier: Apache-2.0
// Where the chunks of a file lie, which pages need them, and what decodes without those.
#pragma once

#include <string>
#include <vector>

#include "l4d/members.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"

namespace l4d::test {

struct Chunk {
  enum Kind { kPage, kDirectory, kBlockCodebook, kResidualCodebook, kCodebook };
  std::string name;
  ChunkRef ref;
  Kind kind = kPage;
  uint32_t layer = 0;
  uint32_t directory = 0;
  uint32_t page = 0;  // in its directory page
  uint32_t block = 0;
  unsigned component = 0;
  bool needed_by_all = false;
};

struct Anatomy {
  struct Page {
    ChunkRef ref;
    uint32_t layer, directory, index, bucket, block;
    uint64_t first, count;  // Gaussians of a decode of everything
    std::array<bool, L4D_COMPONENT_COUNT> has_table;
  };

  explicit Anatomy(const Bytes& file);

  std::vector<Page> pages;  // in stored order
  std::vector<Chunk> chunks;
  StreamEditor editor;

  // At most this many of each kind, evenly spread.
  std::vector<Chunk> some_chunks(size_t most) const;
  Chunk page_chunk(size_t page) const;
  // Indices of pages that cannot be decoded without the chunk.
  std::vector<size_t> lost_with(const Chunk& chunk) const;
  uint64_t gaussians(const std::vector<size_t>& of) const;
  // The same stream, but that it never had this page.
  Bytes rebuilt_without(size_t page) const;
  uint64_t tables_begin() const;   // first page table
  uint64_t payload_begin() const;  // first page
};

// One byte in the middle of the chunk changed.
Bytes damage(const Bytes& file, const Chunk& chunk);

DecoderHandle tolerant_decoder(const Bytes& bytes);
// Decodes into arrays of the selection's size and cuts them to what came.
GaussianArrays decode_rest(const DecoderHandle& decoder, const l4d_query& query);
GaussianArrays without(const GaussianArrays& all, const Anatomy& anatomy,
                       const std::vector<size_t>& lost);
std::vector<l4d_loss> losses_of(const DecoderHandle& decoder);
l4d_counters counters_of(const DecoderHandle& decoder);
l4d_writer writer_to(Bytes* out);  // appends
// A tolerant copy.
l4d_status copy_rest(const Bytes& stream, Bytes* out);
// Status of a strict decode of everything, whose detail must name the clause.
l4d_status strict_failure(const Bytes& bytes, const std::string& clause);

}  // namespace l4d::test
