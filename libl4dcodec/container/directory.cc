// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/directory.h"

#include <algorithm>

#include "l4d_generated.h"
#include "libl4dcodec/base/checked.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/container/aligned_bytes.h"
#include "libl4dcodec/container/flat_check.h"
#include "libl4dcodec/entropy/stream.h"

namespace l4d {
namespace {

constexpr char kIdentifier[] = "L4DD";

fbs::ChunkRef to_fbs(const ChunkRef& c) {
  return fbs::ChunkRef(c.offset, c.hash, c.stored_bytes, c.raw_bytes, c.codec, 0);
}

// From the payload to the file. The reader compares the result with the file's size.
Status make_absolute(const SceneHeader& header, uint64_t base, ChunkRef* chunk) {
  if (checked_add(header.payload_offset, chunk->offset, &chunk->offset)) return {};
  return Status(L4D_ERR_TRUNCATED, "CHNK-1", base, "an offset beyond every file");
}

Status parse_block(const fbs::Block& block, uint64_t base, const SceneHeader& header,
                   const LayerHeader& layer, BlockRecord* out) {
  for (const fbs::RcqTable* t : *block.tables()) {
    const unsigned c = t->component();
    if (c == L4D_COMPONENT_SH || c >= L4D_COMPONENT_COUNT || !layer.component[c].has_rcq) {
      return corrupt(
          "RCQ-3", base,
          "block codebook of component " + std::to_string(c) + ", which has no residual codebook");
    }
    if (t->num_entries() < 1 || t->num_entries() > kMaxCodebookEntries) {
      return corrupt("RCQ-4", base,
                     "block codebook of " + std::to_string(t->num_entries()) + " entries");
    }
    if (out->tables[c].num_entries != 0) {
      return corrupt("RCQ-5", base, "two block codebooks of component " + std::to_string(c));
    }
    const fbs::ChunkRef& r = *t->table();
    out->tables[c].num_entries = t->num_entries();
    out->tables[c].chunk = {r.offset(), r.hash(), r.stored_bytes(), r.raw_bytes(), r.codec()};
    L4D_RETURN_IF_ERROR(make_absolute(header, base, &out->tables[c].chunk));
  }
  return {};
}

// Stored bytes of an SH chunk, where the record may have one.
Status parse_sh_detail(const fbs::PageRecord& p, uint64_t base, const SceneHeader& header,
                       ChunkRef* out) {
  if (p.sh_bytes() == 0) {
    if (p.sh_offset() == 0 && p.sh_hash() == 0) return {};
    return corrupt("DIR-13", base, "an SH detail of no bytes has a place or a hash");
  }
  const bool of_streams = p.codec() == static_cast<uint8_t>(ChunkCodec::kStored) ||
                          p.codec() == static_cast<uint8_t>(ChunkCodec::kZstd);
  if (of_streams || !header.has_sh_detail()) {
    return corrupt("DIR-13", base, "SH detail of a page that holds all of SH");
  }
  *out = {p.sh_offset(), p.sh_hash(), p.sh_bytes(), p.sh_bytes(), p.codec()};
  return make_absolute(header, base, out);
}

}  // namespace

uint32_t num_directory_pages(const LayerHeader& layer) {
  const uint64_t span = uint64_t{1} << layer.directory_bits;
  return static_cast<uint32_t>((num_buckets(layer.level) + span - 1) / span);
}

void PageTableEntry::append(Bytes& out) const {
  const size_t begin = out.size();
  append_le<uint64_t>(chunk.offset, out);
  append_le<uint64_t>(chunk.hash, out);
  append_le<uint32_t>(chunk.stored_bytes, out);
  append_le<uint32_t>(chunk.raw_bytes, out);
  append_le<uint32_t>(chunk.codec, out);
  append_le<uint32_t>(static_cast<uint32_t>(hash64(ByteSpan(out.data() + begin, 28))), out);
}

Status PageTableEntry::parse(ByteSpan bytes, uint64_t base, PageTableEntry* out) {
  if (load_le<uint32_t>(bytes.data() + 28) != static_cast<uint32_t>(hash64(bytes.subspan(0, 28)))) {
    return Status(L4D_ERR_CHECKSUM, "DIR-1", base, "checksum of a page table entry does not match");
  }
  out->chunk.offset = load_le<uint64_t>(bytes.data());
  out->chunk.hash = load_le<uint64_t>(bytes.data() + 8);
  out->chunk.stored_bytes = load_le<uint32_t>(bytes.data() + 16);
  out->chunk.raw_bytes = load_le<uint32_t>(bytes.data() + 20);
  out->chunk.codec = load_le<uint32_t>(bytes.data() + 24);
  return {};
}

Bytes serialize_directory_page(const DirectoryPage& page, uint32_t layer, uint32_t index) {
  flatbuffers::FlatBufferBuilder b(1024);
  std::vector<flatbuffers::Offset<fbs::Block>> blocks;
  for (const BlockRecord& block : page.blocks) {
    std::vector<flatbuffers::Offset<fbs::RcqTable>> tables;
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      if (block.tables[c].num_entries == 0) continue;
      const fbs::ChunkRef ref = to_fbs(block.tables[c].chunk);
      tables.push_back(
          fbs::CreateRcqTable(b, static_cast<uint8_t>(c), block.tables[c].num_entries, &ref));
    }
    blocks.push_back(fbs::CreateBlock(b, b.CreateVector(tables)));
  }
  flatbuffers::Offset<flatbuffers::Vector<flatbuffers::Offset<fbs::Block>>> block_vector;
  if (!blocks.empty()) block_vector = b.CreateVector(blocks);
  std::vector<fbs::PageRecord> records;
  for (const PageRecord& p : page.pages) {
    const flatbuffers::span<const uint16_t, 6> bounds(p.bounds.data(), 6);
    records.emplace_back(p.chunk.offset, p.chunk.hash, p.sh_detail.offset, p.sh_detail.hash,
                         p.chunk.stored_bytes, p.chunk.raw_bytes, p.sh_detail.stored_bytes,
                         p.num_gaussians, p.bucket, p.block, static_cast<uint8_t>(p.chunk.codec),
                         p.visible_begin, p.visible_end, uint8_t{0}, bounds);
  }
  const auto record_vector = b.CreateVectorOfStructs(records);
  b.Finish(fbs::CreateDirectoryPage(b, layer, index, record_vector, block_vector), kIdentifier);
  return Bytes(b.GetBufferPointer(), b.GetBufferPointer() + b.GetSize());
}

Status parse_directory_page(ByteSpan unaligned, uint64_t base, const SceneHeader& header,
                            uint32_t layer_index, uint32_t index, DirectoryPage* out) {
  const LayerHeader& layer = header.layers[layer_index];
  const AlignedBytes bytes(unaligned);
  // The page, its blocks, and their tables for three components.
  constexpr flatbuffers::uoffset_t kMaxTables = 1 + kMaxBlocksPerPage * (1 + 3);
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), 16, kMaxTables);
  if (!verifier.VerifyBuffer<fbs::DirectoryPage>(kIdentifier) ||
      !tables_are_whole({bytes.data(), bytes.size()}, fbs::DirectoryPageTypeTable())) {
    return corrupt("DIR-2", base, "the directory page is no valid FlatBuffer of its schema");
  }
  const auto& page = *flatbuffers::GetRoot<fbs::DirectoryPage>(bytes.data());
  if (page.layer() != layer_index || page.index() != index) {
    return corrupt("DIR-2", base, "the directory page is of another layer or range");
  }
  *out = DirectoryPage();
  if (page.blocks() != nullptr) {
    if (page.blocks()->size() > kMaxBlocksPerPage) {
      return corrupt("DIR-11", base, std::to_string(page.blocks()->size()) + " blocks in one page");
    }
    out->blocks.resize(page.blocks()->size());
    for (size_t i = 0; i < out->blocks.size(); ++i) {
      L4D_RETURN_IF_ERROR(parse_block(*page.blocks()->Get(static_cast<flatbuffers::uoffset_t>(i)),
                                      base, header, layer, &out->blocks[i]));
    }
  }
  const uint64_t first = uint64_t{index} << layer.directory_bits;
  const uint64_t end =
      std::min<uint64_t>(first + (uint64_t{1} << layer.directory_bits), num_buckets(layer.level));
  uint64_t previous = first;
  out->pages.reserve(page.pages()->size());
  for (const fbs::PageRecord* p : *page.pages()) {
    if (p->bucket() < previous || p->bucket() >= end) {
      return corrupt(
          "DIR-3", base,
          "bucket " + std::to_string(p->bucket()) + " is out of the page's range or order");
    }
    previous = p->bucket();
    if (p->num_gaussians() < 1 || p->num_gaussians() > kMaxPageGaussians) {
      return corrupt("DIR-4", base, "page of " + std::to_string(p->num_gaussians()) + " Gaussians");
    }
    if (p->block() != kNoBlock && p->block() >= out->blocks.size()) {
      return corrupt("DIR-6", base, "block " + std::to_string(p->block()) + " does not exist");
    }
    if (!out->pages.empty() && out->pages.back().bucket == p->bucket() &&
        out->pages.back().block != p->block()) {
      return corrupt("DIR-8", base, "pages of one bucket in different blocks");
    }
    if (p->visible_begin() > p->visible_end()) {
      return corrupt("DIR-7", base, "visible interval ends before it begins");
    }
    PageRecord r;
    r.chunk = {p->offset(), p->hash(), p->stored_bytes(), p->raw_bytes(), p->codec()};
    L4D_RETURN_IF_ERROR(make_absolute(header, base, &r.chunk));
    L4D_RETURN_IF_ERROR(parse_sh_detail(*p, base, header, &r.sh_detail));
    r.num_gaussians = p->num_gaussians();
    r.bucket = p->bucket();
    r.block = p->block();
    r.visible_begin = p->visible_begin();
    r.visible_end = p->visible_end();
    for (unsigned i = 0; i < 6; ++i) {
      r.bounds[i] = p->bounds()->Get(static_cast<flatbuffers::uoffset_t>(i));
    }
    for (unsigned k = 0; k < 3; ++k) {
      if (!half_is_finite(r.bounds[k]) || !half_is_finite(r.bounds[3 + k]) ||
          half_to_float(r.bounds[k]) > half_to_float(r.bounds[3 + k])) {
        return corrupt("DIR-12", base, "the box of a page is not finite or inside out");
      }
    }
    out->pages.push_back(r);
  }
  return {};
}

}  // namespace l4d
