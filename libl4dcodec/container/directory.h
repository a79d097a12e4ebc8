// SPDX-License-Identifier: Apache-2.0
// The paged directory: a fixed-size page table per layer, whose entries locate directory pages,
// whose records locate pages of Gaussians. A seek reads one table entry and one directory page per
// layer.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d {

constexpr uint32_t kNoBlock = 0xffffffffu;
constexpr uint32_t kMaxBlocksPerPage = 256;

// One entry of a page table, 32 bytes. stored_bytes = 0: no bucket of this range holds Gaussians.
struct PageTableEntry {
  static constexpr size_t kBytes = 32;
  ChunkRef chunk;

  void append(Bytes& out) const;
  static Status parse(ByteSpan bytes, uint64_t base, PageTableEntry* out);  // bytes: kBytes
};

struct PageRecord {
  ChunkRef chunk;      // rans32: the base chunk
  ChunkRef sh_detail;  // rans32: the SH chunk, stored as it is; stored_bytes 0 = none
  uint32_t num_gaussians = 0;
  uint32_t bucket = 0;
  uint32_t block = kNoBlock;  // index within the directory page
  uint8_t visible_begin = 0;  // 1/64 bucket widths, 128 = bucket centre
  uint8_t visible_end = 255;
  std::array<uint16_t, 6> bounds{};  // binary16 in the coded frame

  bool has_sh_detail() const { return sh_detail.stored_bytes != 0; }
};

struct RcqTableRef {
  uint32_t num_entries = 0;  // 0 = the component has no block codebook here
  ChunkRef chunk;
};

struct BlockRecord {
  std::array<RcqTableRef, L4D_COMPONENT_COUNT> tables;
};

struct DirectoryPage {
  std::vector<PageRecord> pages;
  std::vector<BlockRecord> blocks;
};

uint32_t num_directory_pages(const LayerHeader& layer);

// Offsets in `page` count from the payload when written, and from the start of the file when
// parsed.
Bytes serialize_directory_page(const DirectoryPage& page, uint32_t layer, uint32_t index);
Status parse_directory_page(ByteSpan bytes, uint64_t base, const SceneHeader& header,
                            uint32_t layer_index, uint32_t index, DirectoryPage* out);

}  // namespace l4d
