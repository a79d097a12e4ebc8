// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/query_reads.h"

#include <algorithm>

#include "decoder/read/losses.h"
#include "decoder/read/page_reads.h"
#include "decoder/read/query_buckets.h"

namespace l4d {
namespace {

class QueryReads {
 public:
  QueryReads(SceneFile& file, std::vector<ByteRange>* out)
      : file_(file), out_(*out), memory_(file.memory()) {}

  Status add_page_tables(const QueryBuckets& buckets) {
    for (const BucketRun& run : buckets.runs) {
      const Entries e = entries_of(run);
      if (e.first == e.end) continue;
      L4D_RETURN_IF_ERROR(add(table_offset(run.layer, e.first),
                              uint64_t{e.end - e.first} * PageTableEntry::kBytes));
    }
    return {};
  }

  Status add_directory(const QueryBuckets& buckets) {
    constexpr uint32_t kWindow = 4096;
    Bytes storage;
    for (const BucketRun& run : buckets.runs) {
      const Entries e = entries_of(run);
      for (uint32_t begin = e.first; begin < e.end; begin += kWindow) {
        const uint32_t end = std::min(e.end, begin + kWindow);
        ByteSpan table;
        const Status status =
            file_.source().read(table_offset(run.layer, begin),
                                uint64_t{end - begin} * PageTableEntry::kBytes, storage, &table);
        if (!status.ok() && !is_loss(status)) return status;
        if (status.ok()) L4D_RETURN_IF_ERROR(add_entries(run.layer, begin, table));
      }
    }
    return {};
  }

  // Pages and RCQ tables of the tasks whose span is wanted.
  Status add_chunks(const Plan& plan, const std::vector<bool>& wanted) {
    const bool with_detail = plan.detail == L4D_DETAIL_FULL;
    MemoryCharge scratch(file_.memory());
    L4D_RETURN_IF_ERROR(scratch.take(2 * plan.tasks.size() * (sizeof(PageChunk) + sizeof(ChunkRun)),
                                     "the reads of a query"));
    PageReads reads;
    const BlockRecord* last_block = nullptr;
    for (size_t t = 0; t < plan.tasks.size(); ++t) {
      const PageTask& task = plan.tasks[t];
      if (!wanted[task.span]) continue;
      reads.add(task.record, t, with_detail);
      const BlockRecord* const block = task.block();
      if (block == nullptr || block == last_block) continue;
      last_block = block;
      for (const RcqTableRef& table : block->tables) {
        if (table.num_entries > 0) L4D_RETURN_IF_ERROR(add(table.chunk));
      }
    }
    for (const PageChunk& part : reads.parts()) L4D_RETURN_IF_ERROR(add(part.chunk));
    return {};
  }

  // Codebooks and entropy tables that the pages of a plan are decoded with.
  Status add_tables_of(const Plan& plan) {
    const SceneHeader& header = file_.header();
    // Of each layer: whether pages of it are read, and whether some are coded by rANS.
    std::vector<bool> has_pages(header.layers.size()), has_rans(header.layers.size());
    std::vector<bool> has_blocks(header.layers.size());
    const BlockRecord* last_block = nullptr;
    for (const PageTask& task : plan.tasks) {
      has_pages[task.layer] = true;
      if (is_rans_page(task.record)) has_rans[task.layer] = true;
      const BlockRecord* const block = task.block();
      if (block == nullptr || block == last_block) continue;
      last_block = block;
      for (const RcqTableRef& table : block->tables) {
        if (table.num_entries > 0) has_blocks[task.layer] = true;
      }
    }
    if (!plan.tasks.empty()) L4D_RETURN_IF_ERROR(add_codebooks(header.sh, false));
    for (size_t l = 0; l < header.layers.size(); ++l) {
      if (!has_pages[l]) continue;
      L4D_RETURN_IF_ERROR(add_tables(header.layers[l], has_rans[l], has_blocks[l]));
    }
    return {};
  }

  // Codebooks and entropy tables of all layers, and page tables of at most so many bytes in all.
  Status add_stream(uint64_t max_page_table_bytes) {
    const SceneHeader& header = file_.header();
    uint64_t page_table_bytes = 0;
    L4D_RETURN_IF_ERROR(add_codebooks(header.sh, true));
    for (const LayerHeader& layer : header.layers) {
      if (layer.num_gaussians == 0) continue;
      L4D_RETURN_IF_ERROR(add_tables(layer, true, true));
      page_table_bytes += uint64_t{num_directory_pages(layer)} * PageTableEntry::kBytes;
    }
    if (page_table_bytes > max_page_table_bytes) return {};
    for (const LayerHeader& layer : header.layers) {
      if (layer.num_gaussians == 0) continue;
      const uint64_t bytes = uint64_t{num_directory_pages(layer)} * PageTableEntry::kBytes;
      L4D_RETURN_IF_ERROR(add(layer.page_table_offset, bytes));
    }
    return {};
  }

 private:
  struct Entries {
    uint32_t first = 0, end = 0;
  };

  uint64_t table_offset(uint32_t layer, uint32_t entry) const {
    return file_.header().layers[layer].page_table_offset +
           uint64_t{entry} * PageTableEntry::kBytes;
  }

  // Entries of the layer's page table that the file holds.
  Entries entries_of(const BucketRun& run) const {
    const LayerHeader& layer = file_.header().layers[run.layer];
    const uint64_t size = file_.source().size();
    const uint64_t held = (size - std::min(size, layer.page_table_offset)) / PageTableEntry::kBytes;
    const uint32_t first = run.buckets.first >> layer.directory_bits;
    const uint64_t end =
        std::min<uint64_t>((run.buckets.last >> layer.directory_bits) + uint64_t{1}, held);
    return {first, static_cast<uint32_t>(std::max<uint64_t>(end, first))};
  }

  Status add_entries(uint32_t layer, uint32_t first, ByteSpan table) {
    for (size_t at = 0; at < table.size(); at += PageTableEntry::kBytes) {
      PageTableEntry entry;
      const Status status = PageTableEntry::parse(table.subspan(at, PageTableEntry::kBytes),
                                                  table_offset(layer, first) + at, &entry);
      if (status.ok()) L4D_RETURN_IF_ERROR(add(entry.chunk));
    }
    return {};
  }

  Status add_tables(const LayerHeader& layer, bool with_entropy, bool with_residual) {
    if (with_entropy && layer.has_entropy) L4D_RETURN_IF_ERROR(add(layer.entropy));
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      L4D_RETURN_IF_ERROR(add_codebooks(layer.component[c], with_residual));
    }
    return {};
  }
  Status add_codebooks(const ComponentCoding& coding, bool with_residual) {
    for (unsigned s = 0; s < coding.num_codebooks(); ++s) {
      L4D_RETURN_IF_ERROR(add(coding.codebook(s).codebook));
    }
    return with_residual && coding.has_rcq ? add(coding.rcq.codebook) : Status();
  }

  Status add(const ChunkRef& chunk) { return add(chunk.offset, chunk.stored_bytes); }
  Status add(uint64_t offset, uint64_t bytes) {
    // What the file does not hold no reader is asked for.
    const uint64_t size = file_.source().size();
    if (bytes == 0 || offset > size || bytes > size - offset) return {};
    // A vector that grows holds the old elements, the new ones and room for as many again.
    if (out_.size() == out_.capacity()) {
      const uint64_t more = std::max<uint64_t>(out_.size(), 64);
      L4D_RETURN_IF_ERROR(memory_.take(3 * more * sizeof(ByteRange), "the reads of a query"));
    }
    out_.push_back({offset, bytes});
    return {};
  }

  SceneFile& file_;
  std::vector<ByteRange>& out_;
  MemoryCharge memory_;
};

}  // namespace

Status find_table_reads(SceneFile& file, uint64_t max_page_table_bytes,
                        std::vector<ByteRange>* out) {
  out->clear();
  return QueryReads(file, out).add_stream(max_page_table_bytes);
}

Status find_page_table_reads(SceneFile& file, const QueryBuckets& buckets,
                             std::vector<ByteRange>* out) {
  out->clear();
  return QueryReads(file, out).add_page_tables(buckets);
}

Status find_directory_reads(SceneFile& file, const QueryBuckets& buckets,
                            std::vector<ByteRange>* out) {
  out->clear();
  QueryReads reads(file, out);
  L4D_RETURN_IF_ERROR(reads.add_page_tables(buckets));
  return reads.add_directory(buckets);
}

Status find_chunk_reads(SceneFile& file, const Plan& plan, const std::vector<bool>& wanted,
                        std::vector<ByteRange>* out) {
  out->clear();
  return QueryReads(file, out).add_chunks(plan, wanted);
}

Status find_plan_table_reads(SceneFile& file, const Plan& plan, std::vector<ByteRange>* out) {
  out->clear();
  return QueryReads(file, out).add_tables_of(plan);
}

}  // namespace l4d
