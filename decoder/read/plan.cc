// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/plan.h"

#include <algorithm>
#include <string>

#include "decoder/read/losses.h"

namespace l4d {
namespace {

// The instants a query asks for, clamped to the sequence.
struct Interval {
  double begin = 0;
  double end = 0;
  bool everything = false;  // whenever it is visible
};

Status query_interval(const l4d_query& query, const l4d_timeline& timeline, Interval* out) {
  const double begin = timeline.time_begin;
  const double end = begin + sequence_duration(timeline);
  if (query.kind == L4D_QUERY_ALL || query.kind == L4D_QUERY_BUCKETS) {
    *out = {begin, end, true};
    return {};
  }
  if (query.kind != L4D_QUERY_TIME && query.kind != L4D_QUERY_RANGE) {
    return invalid_argument("unknown kind of query");
  }
  const double last = query.kind == L4D_QUERY_TIME ? query.time_begin : query.time_end;
  if (!(query.time_begin <= last)) {
    return invalid_argument("time_end is before time_begin, or one is not a number");
  }
  *out = {std::clamp(query.time_begin, begin, end), std::clamp(last, begin, end), false};
  return {};
}

Status check_buckets(const l4d_query& query, const SceneHeader& header) {
  if (query.num_buckets > 0 && query.buckets == nullptr) return invalid_argument("buckets is NULL");
  for (uint64_t i = 0; i < query.num_buckets; ++i) {
    const l4d_bucket& b = query.buckets[i];
    if (b.layer >= header.layers.size() || b.bucket >= num_buckets(header.layers[b.layer].level)) {
      return invalid_argument("buckets[" + std::to_string(i) + "] does not exist");
    }
    if (i == 0) continue;
    const l4d_bucket& before = query.buckets[i - 1];
    if (b.layer < before.layer || (b.layer == before.layer && b.bucket <= before.bucket)) {
      return invalid_argument("buckets are not in strictly ascending order");
    }
  }
  return {};
}

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
        out_(*out) {}

  Status add_layer(uint32_t index) {
    const LayerHeader& layer = file_.header().layers[index];
    BucketRange buckets{0, num_buckets(layer.level) - 1};
    if (!interval_.everything) {
      buckets = buckets_of_phases(phase_of_time(timeline_, interval_.begin),
                                  phase_of_time(timeline_, interval_.end), layer.level);
    }
    return add_buckets(index, buckets);
  }

  // Runs of buckets of one layer follow each other; finish_layer() comes after the last of them.
  Status add_buckets(uint32_t index, const BucketRange& buckets) {
    const LayerHeader& layer = file_.header().layers[index];
    if (layer.num_gaussians == 0) return {};
    if (read_.layer != index) read_ = {index, UINT32_MAX, 0, 0};
    const uint32_t first = buckets.first >> layer.directory_bits;
    uint32_t last = buckets.last >> layer.directory_bits;
    if (losses_ != nullptr) leave_out_of_file(index, first, buckets, &last);
    if (last == UINT32_MAX) return {};
    // A whole-file query of a long file would hold every directory page at once; a window bounds
    // it.
    constexpr uint32_t kWindow = 64;
    std::vector<const DirectoryPage*> pages;
    for (uint32_t begin = first; begin <= last; begin += kWindow) {
      const uint32_t end = std::min(last, begin + kWindow - 1);
      L4D_RETURN_IF_ERROR(read_directory(index, begin, end, buckets, &pages));
      for (uint32_t d = begin; d <= end; ++d) {
        const DirectoryPage* const page = pages[d - begin];
        // Listed buckets may come back to the page of those before them.
        if (read_.last_page != d) L4D_RETURN_IF_ERROR(count(index, d, page));
        if (page == nullptr) continue;
        // A vector that grows holds the old elements, the new ones and room for as many again.
        constexpr uint64_t kBytesPerPage = 3 * (sizeof(PageTask) + sizeof(l4d_range));
        if (out_.memory == nullptr) out_.memory = std::make_unique<MemoryCharge>(file_.memory());
        L4D_RETURN_IF_ERROR(out_.memory->take(page->pages.size() * kBytesPerPage, "a plan"));
        add_pages(index, layer, d, *page, buckets);
        // Now and then, so that records that share their bytes do not fill memory first.
        if (out_.tasks.size() >= 2 * num_checked_) L4D_RETURN_IF_ERROR(check_shared_bytes());
      }
      if (interval_.everything) file_.trim();
    }
    return {};
  }

  // Holds the records of a layer against its header, if all of them have been read.
  Status finish_layer() {
    const LayerRead read = read_;
    read_ = LayerRead();
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
    struct Extent {
      uint64_t begin, end;
    };
    num_checked_ = std::max(out_.tasks.size(), kFewTasks);
    MemoryCharge charge(file_.memory());
    L4D_RETURN_IF_ERROR(charge.take(2 * sizeof(Extent) * out_.tasks.size(), "a plan"));
    std::vector<Extent> parts;
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
    uint32_t last_page = UINT32_MAX;
    uint32_t num_pages = 0;      // of the directory, without those that are lost
    uint64_t num_gaussians = 0;  // of all records on them, selected or not
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

  // Counts directory page d, null where it is empty or lost.
  Status count(uint32_t index, uint32_t d, const DirectoryPage* page) {
    const uint64_t bytes = file_.directory_bytes(index, d);
    out_.directory_bytes += bytes;
    read_.last_page = d;
    read_.num_pages += bytes > 0;  // 0: it could not be read
    if (page == nullptr) return {};
    for (const PageRecord& record : page->pages) read_.num_gaussians += record.num_gaussians;
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
                        std::vector<const DirectoryPage*>* out) {
    const Status status = file_.directory_pages(index, begin, end, out);
    if (status.ok() || losses_ == nullptr || !is_loss(status)) return status;
    const LayerHeader& layer = file_.header().layers[index];
    out->assign(end - begin + 1, nullptr);
    std::vector<const DirectoryPage*> one;
    for (uint32_t d = begin; d <= end; ++d) {
      const Status failed = file_.directory_pages(index, d, d, &one);
      if (failed.ok()) {
        (*out)[d - begin] = one[0];
        continue;
      }
      if (!is_loss(failed)) return failed;
      const uint32_t first = std::max(buckets.first, d << layer.directory_bits);
      const uint32_t last =
          std::min(buckets.last, (d << layer.directory_bits) + (1u << layer.directory_bits) - 1);
      losses_->add_directory_page(index, first, last, failed);
    }
    return {};
  }

  void add_pages(uint32_t index, const LayerHeader& layer, uint32_t directory_index,
                 const DirectoryPage& page, const BucketRange& buckets) {
    const double width = bucket_width(timeline_, layer.level);
    const auto wanted = [&](const PageRecord& record) {
      const double center = bucket_center(timeline_, layer.level, record.bucket);
      return interval_.everything || layer.permanent ||
             may_be_visible(record, interval_, center, width);
    };
    // Pages of a bucket lie next to each other.
    size_t bucket_begin = 0;
    bool bucket_wanted = false;
    for (size_t p = 0; p < page.pages.size(); ++p) {
      const PageRecord& record = page.pages[p];
      if (record.bucket < buckets.first || record.bucket > buckets.last) continue;
      if (p == 0 || record.bucket != page.pages[bucket_begin].bucket) {
        bucket_begin = p;
        bucket_wanted = false;
        for (size_t q = p; q < page.pages.size() && page.pages[q].bucket == record.bucket; ++q) {
          bucket_wanted = bucket_wanted || wanted(page.pages[q]);
        }
      }
      if (!(whole_buckets_ ? bucket_wanted : wanted(record))) continue;
      const double center = bucket_center(timeline_, layer.level, record.bucket);
      const uint32_t block =
          record.block == kNoBlock ? L4D_NO_BLOCK : block_id(directory_index, record.block);
      if (out_.ranges.empty() || out_.ranges.back().layer != index ||
          out_.ranges.back().bucket != record.bucket || out_.ranges.back().block != block) {
        out_.ranges.push_back(
            {out_.num_gaussians, 0, center, width, index, record.bucket, block, layer.level});
      }
      out_.tasks.push_back({record, index, directory_index,
                            static_cast<uint32_t>(out_.ranges.size() - 1), out_.num_gaussians});
      out_.ranges.back().count += record.num_gaussians;
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
  LayerRead read_;
  size_t num_checked_ = kFewTasks;
};

// Runs of buckets that follow each other are looked up at once.
Status add_listed_buckets(const l4d_query& query, const SceneHeader& header, Planner* planner) {
  for (uint64_t i = 0; i < query.num_buckets;) {
    const l4d_bucket& first = query.buckets[i];
    uint32_t last = first.bucket;
    for (++i; i < query.num_buckets && query.buckets[i].layer == first.layer &&
              query.buckets[i].bucket == last + 1;
         ++i) {
      ++last;
    }
    if (header.layers[first.layer].level > query.max_level) continue;
    L4D_RETURN_IF_ERROR(planner->add_buckets(first.layer, {first.bucket, last}));
    const bool more = i < query.num_buckets && query.buckets[i].layer == first.layer;
    if (!more) L4D_RETURN_IF_ERROR(planner->finish_layer());
  }
  return {};
}

}  // namespace

Status make_plan(SceneFile& file, const l4d_query& query, Losses* losses, Plan* out) {
  *out = Plan();
  if (query.detail > L4D_DETAIL_BASE_COLOR) return invalid_argument("unknown detail");
  out->detail = query.detail;
  if (query.whole_buckets > 1) return invalid_argument("whole_buckets is 0 or 1");
  Interval interval;
  L4D_RETURN_IF_ERROR(query_interval(query, file.header().timeline, &interval));
  Planner planner(file, interval, query.whole_buckets != 0, losses, out);
  const SceneHeader& header = file.header();
  if (query.kind == L4D_QUERY_BUCKETS) {
    L4D_RETURN_IF_ERROR(check_buckets(query, header));
    L4D_RETURN_IF_ERROR(add_listed_buckets(query, header, &planner));
  } else {
    for (uint32_t i = 0; i < header.layers.size(); ++i) {
      if (header.layers[i].level > query.max_level) continue;
      L4D_RETURN_IF_ERROR(planner.add_layer(i));
      L4D_RETURN_IF_ERROR(planner.finish_layer());
    }
  }
  L4D_RETURN_IF_ERROR(planner.check_shared_bytes());
  if (out->detail == L4D_DETAIL_FULL) out->bytes += out->sh_bytes;
  return {};
}

}  // namespace l4d
