// SPDX-License-Identifier: Apache-2.0
// Directory pages: read on demand, kept for the next query, shared by all queries that need one.
#pragma once

#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "decoder/read/chunk_reader.h"
#include "libl4dcodec/container/directory.h"

namespace l4d {

// A directory page and the memory it takes, which is charged as long as anyone holds the page.
struct LoadedDirectoryPage {
  explicit LoadedDirectoryPage(MemoryBudget& budget) : memory(budget) {}
  DirectoryPage page;         // without records where no bucket of it holds Gaussians
  uint64_t stored_bytes = 0;  // of table entry and page
  MemoryCharge memory;
};
// Must go before the stream that the page is of.
using DirectoryPageRef = std::shared_ptr<const LoadedDirectoryPage>;

class DirectoryCache {
 public:
  DirectoryCache(ChunkReader& reader, const SceneHeader& header)
      : reader_(reader), header_(header) {}
  ~DirectoryCache() { drop(); }
  DirectoryCache(const DirectoryCache&) = delete;
  DirectoryCache& operator=(const DirectoryCache&) = delete;

  struct Failure {
    uint32_t index = 0;
    Status status;
  };
  // The directory pages [first, last] of a layer, in order. With `failures`, a page that is lost
  // (is_loss) is null in *out and listed there; without, it ends the call.
  Status pages(uint32_t layer, uint32_t first, uint32_t last, std::vector<DirectoryPageRef>* out,
               std::vector<Failure>* failures = nullptr);
  Status page(uint32_t layer, uint32_t index, DirectoryPageRef* out);
  // Whether pages() would read nothing.
  bool holds(uint32_t layer, uint32_t first, uint32_t last) const;

  // Drops all pages where they take more than a budget: what a long playback has passed.
  void trim();

 private:
  friend class DirectoryScan;
  using PageKey = std::pair<uint32_t, uint32_t>;  // layer, index
  struct Extent {
    uint64_t end = 0;
    PageKey page;
  };
  Status read_entries(uint32_t layer, uint32_t first, uint32_t end, Bytes& storage, ByteSpan* out);
  Status load(uint32_t layer, uint32_t index, ByteSpan entry);
  Status load_run(uint32_t layer, uint32_t first, uint32_t end, std::vector<Failure>* failures);
  // Of a scan: fails where another page has been read from bytes of this one's chunk.
  Status take_extent(const PageKey& key, const ChunkRef& chunk);
  void drop();

  ChunkReader& reader_;
  const SceneHeader& header_;
  std::map<PageKey, DirectoryPageRef> cache_;
  uint64_t cache_memory_ = 0;  // of pages and of their places in cache_
  DirectoryPageRef empty_;     // stands for all pages without records
  bool in_scan_ = false;
  std::map<uint64_t, Extent> extents_;  // read in this scan, by their begins
};

// While one is there no byte of the file is decoded for two pages of the directory: the second one
// fails with CHNK-4.
class DirectoryScan {
 public:
  explicit DirectoryScan(DirectoryCache& directory) : directory_(directory) {
    directory_.in_scan_ = true;
  }
  ~DirectoryScan();
  DirectoryScan(const DirectoryScan&) = delete;
  DirectoryScan& operator=(const DirectoryScan&) = delete;

 private:
  DirectoryCache& directory_;
};

}  // namespace l4d
