// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/read_ahead.h"

#include <utility>

#include "decoder/read/query_reads.h"

namespace l4d {
namespace {

// A directory is read whole while it takes no more than so many blocks; page tables, codebooks and
// entropy tables likewise.
constexpr uint64_t kMaxIndexBlocks = 8;

uint64_t sum_of(const std::vector<ByteRange>& ranges) {
  uint64_t bytes = 0;
  for (const ByteRange& range : ranges) bytes += range.size;
  return bytes;
}

}  // namespace

void fetch_index(SceneFile& file) {
  ByteSource& source = file.source();
  if (!source.fetches()) return;
  const uint64_t most = kMaxIndexBlocks * source.block_bytes();
  std::vector<ByteRange> tables, directory;
  if (!find_table_reads(file, most, &tables).ok() || sum_of(tables) > most) return;
  source.fetch(std::move(tables), FetchedFor::kStream, file.memory());
  // Reading entries asks for nothing: either they are at hand, or there are too many.
  QueryBuckets all;
  for (uint32_t l = 0; l < file.header().layers.size(); ++l) {
    const LayerHeader& layer = file.header().layers[l];
    if (layer.num_gaussians == 0) continue;
    const uint64_t bytes = uint64_t{num_directory_pages(layer)} * PageTableEntry::kBytes;
    if (!source.is_fetched(layer.page_table_offset, bytes)) return;
    all.runs.push_back({l, {0, num_buckets(layer.level) - 1}});
  }
  if (!find_directory_reads(file, all, &directory).ok() || sum_of(directory) > most) return;
  source.fetch(std::move(directory), FetchedFor::kStream, file.memory());
}

void fetch_directory(SceneFile& file, const l4d_query& needed, const l4d_query& query) {
  if (!file.source().fetches()) return;
  QueryBuckets buckets;
  if (!find_query_buckets(file.header(), needed, &buckets).ok()) return;
  bool at_hand = true;
  for (const BucketRun& run : buckets.runs) {
    const uint32_t bits = file.header().layers[run.layer].directory_bits;
    at_hand = at_hand && file.directory().holds(run.layer, run.buckets.first >> bits,
                                                run.buckets.last >> bits);
  }
  std::vector<ByteRange> ranges;
  if (at_hand || !find_query_buckets(file.header(), query, &buckets).ok() ||
      !find_page_table_reads(file, buckets, &ranges).ok()) {
    return;
  }
  file.source().fetch(std::move(ranges), FetchedFor::kPageTable, file.memory());
  if (!find_directory_reads(file, buckets, &ranges).ok()) return;
  file.source().fetch(std::move(ranges), FetchedFor::kDirectory, file.memory());
}

void fetch_chunks(SceneFile& file, const Plan& plan, const std::vector<bool>& wanted) {
  if (!file.source().fetches()) return;
  std::vector<ByteRange> ranges;
  if (!find_plan_table_reads(file, plan, &ranges).ok()) return;
  file.source().fetch(std::move(ranges), FetchedFor::kStream, file.memory());
  if (!find_chunk_reads(file, plan, wanted, &ranges).ok()) return;
  const bool base = plan.detail != L4D_DETAIL_FULL;
  file.source().fetch(std::move(ranges), base ? FetchedFor::kBase : FetchedFor::kPages,
                      file.memory());
}

bool are_chunks_fetched(SceneFile& file, const Plan& plan, const std::vector<bool>& wanted) {
  std::vector<ByteRange> ranges;
  if (!find_chunk_reads(file, plan, wanted, &ranges).ok()) return false;
  for (const ByteRange& range : ranges) {
    if (!file.source().is_fetched(range.offset, range.size)) return false;
  }
  return true;
}

}  // namespace l4d
