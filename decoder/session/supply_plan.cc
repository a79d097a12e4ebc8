// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/supply_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "decoder/read/query_reads.h"

namespace l4d {
namespace {

// The size of the first read. It holds headers and tables of most files.
constexpr uint64_t kHeadBytes = 65536;
// A directory of no more is read whole.
constexpr uint64_t kMaxDirectoryBytes = 512 << 10;
// Pages that are needed within the same time are planned in the order of the file.
constexpr double kStepSeconds = 0.5;
constexpr double kBeforeAll = -std::numeric_limits<double>::infinity();

// A range that is lacking, and the instants that lack it.
struct Lack {
  uint64_t offset, size;
  double begin, end;
  uint32_t kind;
};

class SupplyPlanner {
 public:
  SupplyPlanner(OpenStream& stream, const BucketCache& cache, const l4d_plan_query& query)
      : stream_(stream), cache_(cache), query_(query) {}

  Status run() {
    if (stream_.is_waiting()) return add_headers();
    const SceneHeader& header = stream_.file().header();
    const Sequence sequence = sequence_of(header.timeline);
    const double other = query_.time + query_.ahead;
    begin_ = std::clamp(std::min(query_.time, other), sequence.begin, sequence.end);
    end_ = std::clamp(std::max(query_.time, other), sequence.begin, sequence.end);
    std::vector<l4d_byte_range> ranges;
    L4D_RETURN_IF_ERROR(find_table_reads(stream_.file(), UINT64_MAX, &ranges));
    for (const l4d_byte_range& range : ranges) add(range, kBeforeAll, end_, L4D_RANGE_TABLES);
    L4D_RETURN_IF_ERROR(add_directory());
    return add_pages();
  }

  std::vector<Lack>& lacks() { return lacks_; }
  double begin() const { return begin_; }
  double end() const { return end_; }

 private:
  Status add_headers() {
    SceneFile& file = stream_.file();
    const ByteSource& source = file.source();
    add({0, std::min(source.size(), kHeadBytes)}, kBeforeAll, end_, L4D_RANGE_INDEX);
    Bytes storage;
    ByteSpan bytes;
    FileHeader header;
    if (!file.source().read(0, FileHeader::kBytes, storage, &bytes).ok()) return {};
    L4D_RETURN_IF_ERROR(FileHeader::parse(bytes, &header));
    // The rest of the head comes with it.
    if (!source.holds(header.header_offset, header.header_bytes)) {
      add({header.header_offset, header.header_bytes}, kBeforeAll, end_, L4D_RANGE_INDEX);
    }
    return {};
  }

  l4d_query window() const {
    l4d_query query{};
    query.struct_size = sizeof query;
    query.kind = L4D_QUERY_RANGE;
    query.max_level = query_.max_level;
    query.max_tier = query_.max_tier;
    query.time_begin = begin_;
    query.time_end = end_;
    query.detail = query_.detail;
    query.whole_buckets = 1;
    return query;
  }

  Status add_directory() {
    SceneFile& file = stream_.file();
    QueryBuckets buckets, all;
    L4D_RETURN_IF_ERROR(find_query_buckets(file.header(), window(), &buckets));
    for (uint32_t l = 0; l < file.header().layers.size(); ++l) {
      const LayerHeader& layer = file.header().layers[l];
      if (layer.num_gaussians > 0) all.runs.push_back({l, {0, num_buckets(layer.level) - 1}});
    }
    std::vector<l4d_byte_range> ranges;
    L4D_RETURN_IF_ERROR(find_directory_reads(file, all, &ranges));
    uint64_t bytes = 0;
    for (const l4d_byte_range& range : ranges) bytes += range.size;
    if (bytes > kMaxDirectoryBytes) {
      L4D_RETURN_IF_ERROR(find_directory_reads(file, buckets, &ranges));
    }
    for (const l4d_byte_range& range : ranges) add(range, kBeforeAll, end_, L4D_RANGE_INDEX);
    return {};
  }

  Status add_pages() {
    Plan plan;
    Losses missing;
    L4D_RETURN_IF_ERROR(make_plan(stream_.file(), window(), &missing, &plan));
    const bool with_detail = query_.detail == L4D_DETAIL_FULL;
    for (size_t first = 0, end; first < plan.tasks.size(); first = end) {
      const uint32_t index = plan.tasks[first].span;
      end = first;
      while (end < plan.tasks.size() && plan.tasks[end].span == index) ++end;
      const l4d_bucket_span& span = plan.spans[index];
      if (cache_.holds_whole(span, plan.detail)) continue;
      double begin = end_, until = begin_;
      find_visible(plan, first, end, &begin, &until);
      for (size_t t = first; t < end; ++t) {
        const PageTask& task = plan.tasks[t];
        add_chunk(task.record.chunk, begin, until, L4D_RANGE_BASE);
        if (with_detail && task.record.has_sh_detail()) {
          add_chunk(task.record.sh_detail, begin, until, L4D_RANGE_DETAIL);
        }
        const BlockRecord* const block = task.block();
        if (block == nullptr || (t > first && plan.tasks[t - 1].block() == block)) continue;
        for (const RcqTableRef& table : block->tables) {
          if (table.num_entries > 0) add_chunk(table.chunk, begin, until, L4D_RANGE_TABLES);
        }
      }
    }
    return {};
  }

  // When some page of a bucket is visible within the window: then the bucket is decoded.
  void find_visible(const Plan& plan, size_t first, size_t end, double* begin,
                    double* until) const {
    for (size_t t = first; t < end; ++t) {
      const PageTask& task = plan.tasks[t];
      const l4d_bucket_span& span = plan.spans[task.span];
      if (stream_.file().header().layers[task.layer].permanent) {
        *begin = begin_;
        *until = end_;
        return;
      }
      const double unit = span.width / 64;
      const double from = span.center + (task.record.visible_begin - 128) * unit;
      const double to = span.center + (task.record.visible_end - 128) * unit;
      if (from > end_ || to < begin_) continue;
      *begin = std::min(*begin, std::max(from, begin_));
      *until = std::max(*until, std::min(to, end_));
    }
  }

  void add_chunk(const ChunkRef& chunk, double begin, double end, uint32_t kind) {
    add({chunk.offset, chunk.stored_bytes}, begin, end, kind);
  }
  void add(l4d_byte_range range, double begin, double end, uint32_t kind) {
    const ByteSource& source = stream_.file().source();
    // What the file does not hold nobody can supply.
    if (range.offset > source.size() || range.size > source.size() - range.offset) return;
    const uint64_t from = source.gap_begin(range.offset);
    if (from - range.offset >= range.size || source.is_lost(from)) return;
    lacks_.push_back({from, range.offset + range.size - from, begin, end, kind});
  }

  OpenStream& stream_;
  const BucketCache& cache_;
  const l4d_plan_query& query_;
  double begin_ = 0, end_ = 0;
  std::vector<Lack> lacks_;
};

// Ascending: what comes first.
struct Urgency {
  int kind;
  double step;
  uint64_t offset;
  bool operator<(const Urgency& o) const {
    if (kind != o.kind) return kind < o.kind;
    return step != o.step ? step < o.step : offset < o.offset;
  }
};

Urgency urgency_of(const Lack& lack, const l4d_plan_query& query) {
  const int kind = lack.kind <= L4D_RANGE_TABLES ? 0 : static_cast<int>(lack.kind);
  // Backwards, what is left last is seen first.
  const double wait = query.ahead < 0 ? query.time - lack.end : lack.begin - query.time;
  const double step = kind == 0 ? 0 : std::floor(std::max(wait, 0.0) / kStepSeconds);
  return {kind, step, lack.offset};
}

}  // namespace

Status plan_supplies(OpenStream& stream, const BucketCache& cache, const l4d_plan_query& query,
                     std::vector<l4d_planned_range>* out) {
  out->clear();
  SupplyPlanner planner(stream, cache, query);
  L4D_RETURN_IF_ERROR(planner.run());
  std::vector<Lack>& lacks = planner.lacks();
  const auto before = [&](const Lack& a, const Lack& b) {
    return urgency_of(a, query) < urgency_of(b, query);
  };
  std::sort(lacks.begin(), lacks.end(), before);
  uint64_t useful = 0;
  const Lack* last = nullptr;
  for (const Lack& lack : lacks) {
    const double needed_at = query.ahead < 0 ? lack.end : lack.begin;
    uint64_t from = lack.offset;
    const uint64_t end = lack.offset + lack.size;
    // Tables and directory may name the same bytes as the head of the file.
    if (last != nullptr && urgency_of(*last, query).kind == urgency_of(lack, query).kind &&
        urgency_of(*last, query).step == urgency_of(lack, query).step) {
      l4d_planned_range& range = out->back();
      const uint64_t range_end = range.offset + range.size;
      from = std::max(from, range_end);
      if (from >= end) continue;
      if (from - range_end <= query.merge_gap && end - range.offset <= query.max_range_bytes) {
        range.size = end - range.offset;
        range.useful_bytes += end - from;
        range.needed_at = std::min(range.needed_at, needed_at);
        useful += end - from;
        continue;
      }
    }
    while (from < end) {
      if (query.max_bytes > 0 && useful >= query.max_bytes) return {};
      const uint64_t size = std::min(end - from, query.max_range_bytes);
      const double at =
          lack.kind <= L4D_RANGE_TABLES && lack.begin == kBeforeAll ? kBeforeAll : needed_at;
      out->push_back({from, size, size, at, lack.kind, 0});
      useful += size;
      from += size;
    }
    last = &lack;
  }
  return {};
}

Status find_buffered(OpenStream& stream, const BucketCache& cache, const l4d_plan_query& query,
                     std::vector<l4d_time_span>* out) {
  out->clear();
  SupplyPlanner planner(stream, cache, query);
  L4D_RETURN_IF_ERROR(planner.run());
  if (stream.is_waiting()) return {};
  std::vector<Lack>& lacks = planner.lacks();
  std::sort(lacks.begin(), lacks.end(),
            [](const Lack& a, const Lack& b) { return a.begin < b.begin; });
  double at = planner.begin();
  for (const Lack& lack : lacks) {
    if (lack.begin > at) out->push_back({at, lack.begin});
    at = std::max(at, lack.end);
  }
  if (at < planner.end() || lacks.empty()) out->push_back({at, planner.end()});
  return {};
}

}  // namespace l4d
