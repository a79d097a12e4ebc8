// SPDX-License-Identifier: Apache-2.0
#include "decoder/copy/damaged_pages.h"

#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "decoder/copy/blank_detail.h"
#include "decoder/read/losses.h"
#include "libl4dcodec/base/hash.h"

namespace l4d {
namespace {

class DamageSearch {
 public:
  DamageSearch(SceneFile& file, PageDecoder& pages, Plan& plan, std::map<size_t, Bytes>& blanks)
      : file_(file), pages_(pages), plan_(plan), blanks_(blanks) {}

  Status run() {
    std::vector<size_t> kept;
    Status first;
    uint64_t num_gaussians = 0;
    for (size_t i = 0; i < plan_.tasks.size(); ++i) {
      Status status;
      Bytes blank;
      L4D_RETURN_IF_ERROR(check_page(i, &blank, &status));
      file_.trim();
      if (!status.ok()) {
        if (first.ok()) first = status;
        continue;
      }
      num_gaussians += plan_.tasks[i].record.num_gaussians;
      if (!blank.empty()) blanks_.emplace(kept.size(), std::move(blank));
      kept.push_back(i);
    }
    if (kept.empty() && !first.ok()) return first;
    for (size_t i = 0; i < kept.size(); ++i) {
      if (kept[i] != i) plan_.tasks[i] = std::move(plan_.tasks[kept[i]]);
    }
    plan_.tasks.resize(kept.size());
    plan_.num_gaussians = num_gaussians;
    return {};
  }

 private:
  // *found: what is wrong with the page. *blank: an SH chunk in place of one that alone is wrong.
  // Other failures concern the call.
  Status check_page(size_t index, Bytes* blank, Status* found) {
    PageTask& task = plan_.tasks[index];
    L4D_RETURN_IF_ERROR(check_layer(task.layer, found));
    if (found->ok()) *found = take(task);
    if (!found->ok()) return {};
    const ChunkRef& detail = task.record.sh_detail;
    const bool has_detail = is_in_file(detail);
    LostPages lost;
    L4D_RETURN_IF_ERROR(pages_.prove(plan_, index, has_detail, &lost));
    if (lost.empty() && has_detail) return {};
    *found = lost.empty() ? beyond_file(detail) : std::move(lost.front().status);
    const bool base_is_right = lost.empty() || lost.front().detail_only;
    return base_is_right ? replace_detail(&task, blank, found) : Status();
  }

  Status replace_detail(PageTask* task, Bytes* blank, Status* found) {
    PageRecord& record = task->record;
    const Status made = make_blank_detail(file_, *task, blank);
    if (!made.ok() && !is_loss(made)) return made;
    // A short file must not make a long one.
    if (!made.ok() || blank->empty() || blank->size() / 2 > record.sh_detail.stored_bytes) {
      blank->clear();
      return {};
    }
    const auto size = static_cast<uint32_t>(blank->size());
    record.sh_detail = {0, hash64(*blank), size, size, record.sh_detail.codec};
    *found = Status();
    return {};
  }

  // The tables of a layer are copied as a whole.
  Status check_layer(uint32_t index, Status* found) {
    const auto inserted = layers_.try_emplace(index);
    Status& known = inserted.first->second;
    if (inserted.second) {
      known = check_tables(index);
      if (!known.ok() && !is_loss(known)) return std::move(known);
    }
    *found = known;
    return {};
  }

  Status check_tables(uint32_t index) {
    const LayerHeader& layer = file_.header().layers[index];
    L4D_RETURN_IF_ERROR(check_page_table(layer));
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      const ComponentCoding& coding = layer.component[c];
      const CodebookData* codebook = nullptr;
      for (unsigned s = 0; s < coding.num_codebooks(); ++s) {
        L4D_RETURN_IF_ERROR(file_.codebooks().codebook(index, c, s, &codebook));
      }
      if (!coding.has_rcq) continue;
      L4D_RETURN_IF_ERROR(
          file_.codebooks().codebook(index, c, CodebookCache::kRcqStage, &codebook));
    }
    if (!layer.has_entropy) return {};
    if (rans_codable(file_.header(), layer)) {
      const EntropyTables* tables = nullptr;
      return file_.codebooks().entropy_tables(index, &tables);
    }
    Bytes storage;
    ByteSpan bytes;
    MemoryCharge charge(file_.memory());
    return read_stored(file_, layer.entropy, &charge, storage, &bytes);
  }

  // The copy has as many entries, so that a short file must not make a long one.
  Status check_page_table(const LayerHeader& layer) const {
    const uint64_t bytes = uint64_t{num_directory_pages(layer)} * PageTableEntry::kBytes;
    if (is_in_file(layer.page_table_offset, bytes)) return {};
    return Status(L4D_ERR_TRUNCATED, "CHNK-1", layer.page_table_offset,
                  "the file ends within a page table");
  }

  bool is_in_file(uint64_t begin, uint64_t bytes) const {
    const uint64_t size = file_.source().size();
    return begin <= size && bytes <= size - begin;
  }
  bool is_in_file(const ChunkRef& chunk) const {
    return is_in_file(chunk.offset, chunk.stored_bytes);
  }
  static Status beyond_file(const ChunkRef& chunk) {
    return Status(L4D_ERR_TRUNCATED, "CHNK-1", chunk.offset, "the file ends within a chunk");
  }

  // Chunks that share bytes would be read over and over, and copied as often.
  Status take(const PageTask& task) {
    if (!is_in_file(task.record.chunk)) return beyond_file(task.record.chunk);
    uint64_t bytes = task.record.chunk.stored_bytes;
    if (is_in_file(task.record.sh_detail)) bytes += task.record.sh_detail.stored_bytes;
    if (task.record.block != kNoBlock &&
        blocks_.emplace(task.layer, task.directory_index, task.record.block).second) {
      for (const RcqTableRef& table : task.block()->tables) {
        if (table.num_entries > 0) bytes += table.chunk.stored_bytes;
      }
    }
    if (bytes > file_.source().size() - taken_) {
      return corrupt("CHNK-4", task.record.chunk.offset, "chunks share stored bytes");
    }
    taken_ += bytes;
    return {};
  }

  SceneFile& file_;
  PageDecoder& pages_;
  Plan& plan_;
  std::map<size_t, Bytes>& blanks_;
  std::map<uint32_t, Status> layers_;
  std::set<std::tuple<uint32_t, uint32_t, uint32_t>> blocks_;  // layer, directory page, block
  uint64_t taken_ = 0;
};

}  // namespace

Status drop_damaged(SceneFile& file, PageDecoder& pages, Plan* plan,
                    std::map<size_t, Bytes>* blanks) {
  return DamageSearch(file, pages, *plan, *blanks).run();
}

Status read_stored(SceneFile& file, const ChunkRef& chunk, MemoryCharge* charge, Bytes& storage,
                   ByteSpan* bytes) {
  L4D_RETURN_IF_ERROR(charge->take(chunk.stored_bytes, "a chunk"));
  L4D_RETURN_IF_ERROR(file.source().read(chunk.offset, chunk.stored_bytes, storage, bytes));
  if (hash64(*bytes) == chunk.hash) return {};
  return Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset, "checksum of a chunk does not match");
}

}  // namespace l4d
