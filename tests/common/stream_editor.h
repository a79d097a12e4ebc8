// SPDX-License-Identifier: Apache-2.0
// Takes a file apart, lets a test change any part, and puts it together again with sizes, offsets
// and checksums repaired, so that exactly one rule is broken.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/file_header.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d::test {

// A chunk's content, and what to say of it that is not true.
struct EditedChunk {
  Bytes raw;
  uint32_t codec = 0;
  std::optional<Bytes> stored;        // instead of raw under codec
  std::optional<uint32_t> raw_bytes;  // instead of raw.size()
  std::optional<uint64_t> offset;     // instead of its place
  bool wrong_hash = false;
};

struct EditedDirectoryPage {
  bool present = false;              // false: the page table says that it is empty
  DirectoryPage page;                // chunk references are filled in by build()
  std::vector<EditedChunk> pages;    // beside page.pages; of rans32 pages the stored bytes
  std::vector<EditedChunk> details;  // likewise, SH chunks; without bytes a record stays as it is
  std::vector<std::array<EditedChunk, L4D_COMPONENT_COUNT>> tables;  // beside page.blocks
  uint32_t says_layer = 0, says_index = 0;
  EditedChunk chunk;                     // raw is made by build()
  std::function<void(Bytes&)> on_bytes;  // after serialisation
};

struct EditedLayer {
  std::array<std::vector<EditedChunk>, L4D_COMPONENT_COUNT> codebooks;
  std::array<EditedChunk, L4D_COMPONENT_COUNT> rcq;
  EditedChunk entropy;  // where the header has it
  std::vector<EditedDirectoryPage> directory;
  // After its own checksum: damages a page table entry.
  std::function<void(Bytes& table)> on_page_table;
};

// One stream of a page: where it lies in the raw bytes and what it holds.
struct PageStream {
  std::string name;  // "position.x", "opacity", "sh.depth", "sh.index.0", "sh.escape.17", ...
  size_t begin = 0, end = 0;
  size_t n = 0;
  unsigned width = 0;
};

class StreamEditor {
 public:
  explicit StreamEditor(const Bytes& file);

  FileHeader file;
  SceneHeader header;
  std::vector<EditedChunk> sh_codebooks;
  std::vector<EditedLayer> layers;
  std::function<void(Bytes&)> on_scene_header;  // after serialisation, before its checksum
  std::function<void(Bytes&)> on_file_header;   // after its checksum

  Bytes build();

  // The first layer that `wanted` accepts, its first directory page in use.
  struct Place {
    size_t layer = 0, directory = 0;
  };
  Place find(const std::function<bool(const LayerHeader&)>& wanted) const;
  EditedDirectoryPage& at(const Place& p) { return layers[p.layer].directory[p.directory]; }

  // Streams of page `page`; replace_stream() finds one by name.
  std::vector<PageStream> streams(const Place& place, size_t page) const;
  PageStream stream(const Place& place, size_t page, const std::string& name) const;
  void replace_stream(const Place& place, size_t page, const std::string& name, const Bytes& bytes);

 private:
  const BlockRecord* block_of(const Place& place, size_t page) const;
};

}  // namespace l4d::test
