// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/query_buckets.h"

#include <algorithm>
#include <string>

namespace l4d {
namespace {

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

// count: 0 = all
bool is_beyond(uint32_t number, uint32_t count) { return count != 0 && number >= count; }

bool leaves_out(const l4d_query& query, const LayerHeader& layer) {
  return is_beyond(layer.level, query.point.levels) || is_beyond(layer.tier, query.point.tiers) ||
         layer.num_gaussians == 0;
}

// Buckets that follow each other make one run.
void add_listed_buckets(const l4d_query& query, const SceneHeader& header,
                        std::vector<BucketRun>* runs) {
  for (uint64_t i = 0; i < query.num_buckets; ++i) {
    const l4d_bucket& b = query.buckets[i];
    const LayerHeader& layer = header.layers[b.layer];
    if (leaves_out(query, layer)) continue;
    if (!runs->empty() && runs->back().layer == b.layer &&
        runs->back().buckets.last + 1 == b.bucket) {
      ++runs->back().buckets.last;
    } else {
      runs->push_back({b.layer, {b.bucket, b.bucket}});
    }
  }
}

}  // namespace

Status find_query_buckets(const SceneHeader& header, const l4d_query& query, QueryBuckets* out) {
  out->interval = Interval();
  out->runs.clear();
  if (query.point.detail > L4D_DETAIL_BASE_COLOR) return invalid_argument("unknown detail");
  if (query.whole_buckets > 1) return invalid_argument("whole_buckets is 0 or 1");
  L4D_RETURN_IF_ERROR(query_interval(query, header.timeline, &out->interval));
  if (query.kind == L4D_QUERY_BUCKETS) {
    L4D_RETURN_IF_ERROR(check_buckets(query, header));
    add_listed_buckets(query, header, &out->runs);
    return {};
  }
  const Interval& t = out->interval;
  for (uint32_t i = 0; i < header.layers.size(); ++i) {
    const LayerHeader& layer = header.layers[i];
    if (leaves_out(query, layer)) continue;
    BucketRange buckets{0, num_buckets(layer.level) - 1};
    if (!t.everything) {
      buckets = buckets_of_phases(phase_of_time(header.timeline, t.begin),
                                  phase_of_time(header.timeline, t.end), layer.level);
    }
    out->runs.push_back({i, buckets});
  }
  return {};
}

}  // namespace l4d
