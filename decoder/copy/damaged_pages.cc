// SPDX-License-Identifier: Apache-2.0
#include "decoder/copy/damaged_pages.h"

#include <algorithm>
#include <map>
#include <utility>

#include "decoder/copy/blank_detail.h"
#include "decoder/read/losses.h"
#include "libl4dcodec/base/hash.h"

namespace l4d {
namespace {

class DamageSearch {
 public:
  DamageSearch(SceneFile& file, Plan& plan, std::map<size_t, Bytes>& blanks)
      : file_(file), plan_(plan), blanks_(blanks) {}

  Status run() {
    std::vector<PageTask> kept;
    Status first;
    uint64_t num_gaussians = 0;
    for (PageTask& task : plan_.tasks) {
      Status status;
      Bytes blank;
      L4D_RETURN_IF_ERROR(check_page(task, &status));
      if (status.ok()) L4D_RETURN_IF_ERROR(check_detail(&task, &blank, &status));
      if (!status.ok()) {
        if (first.ok()) first = status;
        continue;
      }
      num_gaussians += task.record.num_gaussians;
      if (!blank.empty()) blanks_.emplace(kept.size(), std::move(blank));
      kept.push_back(std::move(task));
    }
    if (kept.empty() && !first.ok()) return first;
    plan_.tasks = std::move(kept);
    plan_.num_gaussians = num_gaussians;
    return {};
  }

 private:
  // *found: what is wrong with the page. Other failures concern the call.
  Status check_page(const PageTask& task, Status* found) {
    L4D_RETURN_IF_ERROR(check_layer(task.layer, found));
    if (found->ok() && task.record.block != kNoBlock) {
      L4D_RETURN_IF_ERROR(check_block(task, found));
    }
    return check(task.record.chunk, found);
  }

  // Of a page that is right but for its SH chunk. *blank: another one in its place.
  Status check_detail(PageTask* task, Bytes* blank, Status* found) {
    PageRecord& record = task->record;
    if (!record.has_sh_detail()) return {};
    L4D_RETURN_IF_ERROR(check(record.sh_detail, found));
    if (found->ok()) return {};
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

  Status check_layer(uint32_t index, Status* found) {
    const auto inserted = layers_.try_emplace(index);
    Status& known = inserted.first->second;
    if (inserted.second) {
      const LayerHeader& layer = file_.header().layers[index];
      known = check_page_table(layer);
      Status failure;
      const auto add = [&](const ChunkRef& chunk) {
        if (failure.ok()) failure = check(chunk, &known);
      };
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        for_each_table(layer.component[c], add);
      }
      if (layer.has_entropy) add(layer.entropy);
      L4D_RETURN_IF_ERROR(failure);
    }
    *found = known;
    return {};
  }

  // The copy has as many entries, so that a short file must not make a long one.
  Status check_page_table(const LayerHeader& layer) const {
    const uint64_t size = file_.source().size(), begin = layer.page_table_offset;
    const uint64_t bytes = uint64_t{num_directory_pages(layer)} * PageTableEntry::kBytes;
    if (begin <= size && bytes <= size - begin) return {};
    return Status(L4D_ERR_TRUNCATED, "CHNK-1", begin, "the file ends within a page table");
  }

  Status check_block(const PageTask& task, Status* found) {
    const auto [it, added] = blocks_.try_emplace(
        std::make_pair(std::make_pair(task.layer, task.directory_index), task.record.block));
    for (const RcqTableRef& table : task.block()->tables) {
      if (added && table.num_entries > 0) L4D_RETURN_IF_ERROR(check(table.chunk, &it->second));
    }
    *found = it->second;
    return {};
  }

  // Nothing is read once *found has a failure.
  Status check(const ChunkRef& chunk, Status* found) {
    if (!found->ok()) return {};
    Bytes storage;
    ByteSpan bytes;
    MemoryCharge charge(file_.memory());
    Status status = read_stored(file_, chunk, &charge, storage, &bytes);
    if (!status.ok() && !is_loss(status)) return status;
    // Chunks that share bytes would be read over and over.
    read_ += bytes.size();
    if (read_ > file_.source().size()) {
      return corrupt("CHNK-4", chunk.offset, "chunks share stored bytes");
    }
    *found = std::move(status);
    return {};
  }

  SceneFile& file_;
  Plan& plan_;
  std::map<size_t, Bytes>& blanks_;
  std::map<uint32_t, Status> layers_;
  std::map<std::pair<std::pair<uint32_t, uint32_t>, uint32_t>, Status> blocks_;
  uint64_t read_ = 0;
};

}  // namespace

Status drop_damaged(SceneFile& file, Plan* plan, std::map<size_t, Bytes>* blanks) {
  return DamageSearch(file, *plan, *blanks).run();
}

Status read_stored(SceneFile& file, const ChunkRef& chunk, MemoryCharge* charge, Bytes& storage,
                   ByteSpan* bytes) {
  L4D_RETURN_IF_ERROR(charge->take(chunk.stored_bytes, "a chunk"));
  L4D_RETURN_IF_ERROR(file.source().read(chunk.offset, chunk.stored_bytes, storage, bytes));
  if (hash64(*bytes) == chunk.hash) return {};
  return Status(L4D_ERR_CHECKSUM, "CHNK-2", chunk.offset, "checksum of a chunk does not match");
}

}  // namespace l4d
