// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/plan.h"

#include <algorithm>
#include <string>
#include <utility>

#include "decoder/read/losses.h"

namespace l4d {
namespace {

bool may_be_visible(const PageRecord& page, const Interval& t, double center, double width) {
  const double unit = width / 64;
  return t.end >= center + (page.visible_begin - 128) * unit &&
         t.begin <= center + (page.visible_end - 128) * unit;
}

class Planner {
 public:
  Planner(SceneFile& file, const Interval& interval, bool whole_buckets, Losses* losses, Plan* out)
      : file_(file),
        timeline_(file.header().timeline),
        interval_(interval),
        whole_buckets_(whole_buckets),
        losses_(losses),
        out_(*out),
        scan_(file.directory()) {}

  // Runs of buckets of one layer follow each other; finish_layer() comes after the last of them.
  Status add_buckets(uint32_t index, const BucketRange& buckets) {
    const LayerHeader& layer = file_.header().layers[index];
    if (read_.layer != index) {
      read_ = LayerRead();
      read_.layer = index;
    }
    const uint32_t first = buckets.first >> layer.directory_bits;
    uint32_t last = buckets.last >> layer.directory_bits;
    if (losses_ != nullptr) leave_out_of_file(index, first, buckets, &last);
    if (last == UINT32_MAX) return {};
    // A whole-file query of a long file would hold every directory page at once; a window bounds
    // it.
    constexpr uint32_t kWindow = 64;
    std::vector<DirectoryPageRef>& pages = out_.scratch.pages;
    for (uint32_t begin = first; begin <= last; begin += kWindow) {
      const uint32_t end = std::min(last, begin + kWindow - 1);
      L4D_RETURN_IF_ERROR(read_directory(index, begin, end, buckets, &pages));
      for (uint32_t d = begin; d <= end; ++d) {
        const DirectoryPageRef& page = pages[d - begin];
        if (read_.last_index != d) L4D_RETURN_IF_ERROR(count(index, d, page));
        if (page == nullptr) continue;
        const size_t num_records = page->page.pages.size();
        // A vector that grows holds the old elements, the new ones and room for as many again.
        constexpr uint64_t kBytesPerPage = 3 * (sizeof(PageTask) + sizeof(l4d_bucket_span));
        if (out_.memory == nullptr) out_.memory = std::make_unique<MemoryCharge>(file_.memory());
        L4D_RETURN_IF_ERROR(out_.memory->take(num_records * kBytesPerPage, "a plan"));
        add_pages(index, layer, d, page, buckets);
        // Now and then, so that records that share their bytes do not fill memory first.
        if (out_.tasks.size() >= 2 * num_checked_) L4D_RETURN_IF_ERROR(check_shared_bytes());
      }
      if (interval_.everything) file_.trim();
    }
    return {};
  }

  // Holds the records of a layer against its header, if all of them have been read.
  Status finish_layer() {
    const LayerRead read = std::exchange(read_, LayerRead());
    if (read.layer == UINT32_MAX) return {};
    const LayerHeader& layer = file_.header().layers[read.layer];
    if (read.num_pages != num_directory_pages(layer)) return {};
    if (read.num_gaussians == layer.num_gaussians) return {};
    const Status status = wrong_sum(read);
    if (losses_ == nullptr) return status;
    losses_->add_missing(read.layer, num_buckets(layer.level),
                         layer.num_gaussians - read.num_gaussians, status);
    return {};
  }

  // Fails where two parts of pages have stored bytes in common: a few bytes could otherwise stand
  // for any number of Gaussians.
  Status check_shared_bytes() {
    using Extent = PlanScratch::Extent;
    num_checked_ = std::max(out_.tasks.size(), kFewTasks);
    MemoryCharge charge(file_.memory());
    L4D_RETURN_IF_ERROR(charge.take(2 * sizeof(Extent) * out_.tasks.size(), "a plan"));
    std::vector<Extent>& parts = out_.scratch.parts;
    parts.clear();
    parts.reserve(2 * out_.tasks.size());
    for (const PageTask& task : out_.tasks) {
      for (const ChunkRef* chunk : {&task.record.chunk, &task.record.sh_detail}) {
        // What the file does not hold is refused when it is read.
        const uint64_t size = file_.source().size();
        const bool in_file = chunk->offset <= size && chunk->stored_bytes <= size - chunk->offset;
        if (chunk->stored_bytes == 0 || !in_file) continue;
        parts.push_back({chunk->offset, chunk->offset + chunk->stored_bytes});
      }
    }
    std::sort(parts.begin(), parts.end(),
              [](const Extent& a, const Extent& b) { return a.begin < b.begin; });
    for (size_t i = 1; i < parts.size(); ++i) {
      if (parts[i].begin < parts[i - 1].end) {
        return corrupt("CHNK-4", parts[i].begin, "two pages share stored bytes");
      }
    }
    return {};
  }

 private:
  // What has been read of the directory of the layer at hand.
  struct LayerRead {
    uint32_t layer = UINT32_MAX;
    uint32_t num_pages = 0;      // of the directory, without those that are lost
    uint64_t num_gaussians = 0;  // of all records on them, selected or not
    // The last directory page, to which listed buckets may come back: null and its status where it
    // is lost.
    uint32_t last_index = UINT32_MAX;
    DirectoryPageRef last_page;
    Status last_status;
  };
  static constexpr size_t kFewTasks = 4096;

  Status wrong_sum(const LayerRead& read) const {
    const LayerHeader& layer = file_.header().layers[read.layer];
    return corrupt("DIR-5", layer.page_table_offset,
                   "the records of layer " + std::to_string(read.layer) + " hold " +
                       (read.num_gaussians > layer.num_gaussians ? "at least " : "") +
                       std::to_string(read.num_gaussians) + " Gaussians, its header says " +
                       std::to_string(layer.num_gaussians));
  }

  // Counts directory page d, null where it is lost.
  Status count(uint32_t index, uint32_t d, const DirectoryPageRef& page) {
    read_.last_index = d;
    read_.last_page = page;
    if (page == nullptr) return {};
    out_.directory_bytes += page->stored_bytes;
    ++read_.num_pages;
    for (const PageRecord& record : page->page.pages) read_.num_gaussians += record.num_gaussians;
    if (read_.num_gaussians > file_.header().layers[index].num_gaussians) return wrong_sum(read_);
    return {};
  }

  // Directory pages [first, *last] of which the table entries are beyond the end of the file are
  // lost at once: a header of a few bytes can ask for a million of them. Leaves the others;
  // UINT32_MAX where there are none.
  void leave_out_of_file(uint32_t index, uint32_t first, const BucketRange& buckets,
                         uint32_t* last) {
    const LayerHeader& layer = file_.header().layers[index];
    const uint64_t size = file_.source().size();
    const uint64_t room = size - std::min(size, layer.page_table_offset);
    const uint64_t entries = room / PageTableEntry::kBytes;
    if (*last < entries) return;
    const uint32_t begin = static_cast<uint32_t>(std::max<uint64_t>(entries, first));
    const uint64_t offset = layer.page_table_offset + uint64_t{begin} * PageTableEntry::kBytes;
    losses_->add_directory_page(
        index, std::max(buckets.first, begin << layer.directory_bits), buckets.last,
        Status(L4D_ERR_TRUNCATED, "CHNK-1", offset, "the file ends within a page table"));
    *last = begin == first ? UINT32_MAX : begin - 1;
  }

  // The directory pages [begin, end] of a layer; null for those that are lost.
  Status read_directory(uint32_t index, uint32_t begin, uint32_t end, const BucketRange& buckets,
                        std::vector<DirectoryPageRef>* out) {
    const bool again = read_.last_index == begin;
    std::vector<DirectoryPageRef>& fresh = out_.scratch.fresh;
    std::vector<DirectoryCache::Failure>& failures = out_.scratch.failures;
    fresh.clear();
    failures.clear();
    if (!again || begin < end) {
      L4D_RETURN_IF_ERROR(file_.directory().pages(index, again ? begin + 1 : begin, end, &fresh,
                                                  losses_ == nullptr ? nullptr : &failures));
    }
    out->clear();
    if (again) {
      out->push_back(read_.last_page);
      if (read_.last_page == nullptr) add_loss(index, begin, buckets, read_.last_status);
    }
    out->insert(out->end(), fresh.begin(), fresh.end());
    for (DirectoryCache::Failure& failure : failures) {
      add_loss(index, failure.index, buckets, failure.status);
      if (failure.index == end) read_.last_status = std::move(failure.status);
    }
    return {};
  }

  void add_loss(uint32_t index, uint32_t d, const BucketRange& buckets, const Status& status) {
    const LayerHeader& layer = file_.header().layers[index];
    const uint32_t first = std::max(buckets.first, d << layer.directory_bits);
    const uint32_t last =
        std::min(buckets.last, (d << layer.directory_bits) + (1u << layer.directory_bits) - 1);
    losses_->add_directory_page(index, first, last, status);
  }

  void add_pages(uint32_t index, const LayerHeader& layer, uint32_t directory_index,
                 const DirectoryPageRef& directory, const BucketRange& buckets) {
    const DirectoryPage& page = directory->page;
    const double width = bucket_width(timeline_, layer.level);
    const auto wanted = [&](const PageRecord& record) {
      const double center = bucket_center(timeline_, layer.level, record.bucket);
      return interval_.everything || layer.permanent ||
             may_be_visible(record, interval_, center, width);
    };
    // Pages of a bucket lie next to each other.
    size_t bucket_begin = 0;
    uint64_t next_in_bucket = 0;
    bool bucket_wanted = false;
    for (size_t p = 0; p < page.pages.size(); ++p) {
      const PageRecord& record = page.pages[p];
      if (record.bucket < buckets.first || record.bucket > buckets.last) continue;
      if (p == 0 || record.bucket != page.pages[bucket_begin].bucket) {
        bucket_begin = p;
        next_in_bucket = 0;
        bucket_wanted = false;
        for (size_t q = p; q < page.pages.size() && page.pages[q].bucket == record.bucket; ++q) {
          bucket_wanted = bucket_wanted || wanted(page.pages[q]);
        }
      }
      const uint64_t first_in_bucket = next_in_bucket;
      next_in_bucket += record.num_gaussians;
      if (!(whole_buckets_ ? bucket_wanted : wanted(record))) continue;
      const double center = bucket_center(timeline_, layer.level, record.bucket);
      const uint32_t block =
          record.block == kNoBlock ? L4D_NO_BLOCK : range_block(directory_index, record.block);
      if (out_.spans.empty() || out_.spans.back().layer != index ||
          out_.spans.back().bucket != record.bucket || out_.spans.back().block != block) {
        out_.spans.push_back(
            {out_.num_gaussians, 0, center, width, index, record.bucket, block, layer.level});
      }
      out_.tasks.push_back({record, index, directory_index,
                            static_cast<uint32_t>(out_.spans.size() - 1), out_.num_gaussians,
                            first_in_bucket, record.block == kNoBlock ? nullptr : directory});
      out_.spans.back().count += record.num_gaussians;
      out_.num_gaussians += record.num_gaussians;
      out_.bytes += record.chunk.stored_bytes;
      out_.sh_bytes += record.sh_detail.stored_bytes;
    }
  }

  SceneFile& file_;
  const l4d_timeline& timeline_;
  const Interval interval_;
  const bool whole_buckets_;
  Losses* losses_;
  Plan& out_;
  const DirectoryScan scan_;
  LayerRead read_;
  size_t num_checked_ = kFewTasks;
};

}  // namespace

Status make_plan(SceneFile& file, const l4d_query& query, Losses* losses, Plan* out) {
  out->clear();
  QueryBuckets& buckets = out->scratch.buckets;
  L4D_RETURN_IF_ERROR(find_query_buckets(file.header(), query, &buckets));
  out->detail = query.point.detail;
  Planner planner(file, buckets.interval, query.whole_buckets != 0, losses, out);
  for (size_t i = 0; i < buckets.runs.size(); ++i) {
    const BucketRun& run = buckets.runs[i];
    L4D_RETURN_IF_ERROR(planner.add_buckets(run.layer, run.buckets));
    const bool last = i + 1 == buckets.runs.size() || buckets.runs[i + 1].layer != run.layer;
    if (last) L4D_RETURN_IF_ERROR(planner.finish_layer());
  }
  L4D_RETURN_IF_ERROR(planner.check_shared_bytes());
  if (out->detail == L4D_DETAIL_FULL) out->bytes += out->sh_bytes;
  return {};
}

void Plan::clear() {
  tasks.clear();
  spans.clear();
  num_gaussians = 0;
  detail = L4D_DETAIL_FULL;
  bytes = sh_bytes = directory_bytes = 0;
  scratch.pages.clear();
  scratch.fresh.clear();
  scratch.failures.clear();
  if (memory == nullptr) return;
  const auto bytes_of = [](const auto& v) { return uint64_t{v.capacity()} * sizeof(v[0]); };
  memory->shrink_to(bytes_of(tasks) + bytes_of(spans) + bytes_of(scratch.buckets.runs) +
                    bytes_of(scratch.pages) + bytes_of(scratch.fresh) + bytes_of(scratch.parts));
}

void write_ids(const Plan& plan, l4d_gaussian_id* out) {
  for (const PageTask& task : plan.tasks) {
    for (uint64_t i = 0; i < task.record.num_gaussians; ++i) {
      out[task.first + i] = {task.layer, task.record.bucket, task.first_in_bucket + i};
    }
  }
}

}  // namespace l4d
