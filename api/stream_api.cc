// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <vector>

#include "api/decoder_handle.h"
#include "l4d/stream.h"

using l4d::Status;
using l4d::api::call_on;
using l4d::api::init_struct;
using l4d::api::read_struct;
using l4d::api::required;

namespace {

constexpr uint64_t kDefaultMergeGap = 16 << 10;
constexpr uint64_t kDefaultRangeBytes = 1 << 20;

l4d_plan_query default_plan_query() {
  l4d_plan_query q{};
  q.struct_size = sizeof q;
  q.max_level = UINT32_MAX;
  q.max_tier = UINT32_MAX;
  q.detail = L4D_DETAIL_FULL;
  q.merge_gap = kDefaultMergeGap;
  return q;
}

Status check_supplied(l4d::Decoder& decoder) {
  const bool open = decoder.is_waiting() || decoder.is_open();
  if (open && decoder.file().source().is_supplied()) return {};
  return Status(L4D_ERR_INVALID_STATE, "no stream is open for supplies");
}

// Checks a query and a pair of output arguments, and has `find` fill a vector for them.
template <typename T, typename Find>
l4d_status plan_with(l4d_decoder* decoder, const l4d_plan_query* query, T* out, uint64_t capacity,
                     uint64_t* count, const Find& find) {
  const char* bad = required(query);
  if (bad == nullptr) bad = required(count);
  if (bad == nullptr && capacity > 0) bad = required(out);
  return call_on(decoder, bad, [&]() -> Status {
    L4D_RETURN_IF_ERROR(check_supplied(decoder->impl));
    l4d_plan_query q = read_struct(*query, default_plan_query());
    if (!std::isfinite(q.time) || !std::isfinite(q.ahead)) {
      return l4d::invalid_argument("time and ahead are finite");
    }
    if (q.detail > L4D_DETAIL_BASE_COLOR) return l4d::invalid_argument("unknown detail");
    if (q.max_range_bytes == 0) q.max_range_bytes = kDefaultRangeBytes;
    std::vector<T> found;
    L4D_RETURN_IF_ERROR(find(decoder->impl, q, &found));
    std::copy_n(found.begin(), std::min<uint64_t>(capacity, found.size()), out);
    *count = found.size();
    return {};
  });
}

}  // namespace

extern "C" {

void l4d_plan_query_init_(l4d_plan_query* query, size_t struct_size) {
  init_struct(query, struct_size, default_plan_query());
}

l4d_status l4d_decoder_open_supplied(l4d_decoder* decoder, uint64_t size) {
  return call_on(decoder, nullptr, [&]() -> Status {
    decoder->close_device();
    decoder->impl.open_supplied(size);
    return {};
  });
}

l4d_status l4d_decoder_supply(l4d_decoder* decoder, uint64_t offset, const void* data, size_t n) {
  return call_on(decoder, n > 0 ? required(data) : nullptr, [&]() -> Status {
    L4D_RETURN_IF_ERROR(check_supplied(decoder->impl));
    return decoder->impl.supply(offset, l4d::ByteSpan(static_cast<const unsigned char*>(data), n));
  });
}

l4d_status l4d_decoder_plan(l4d_decoder* decoder, const l4d_plan_query* query,
                            l4d_planned_range* ranges, uint64_t capacity, uint64_t* count) {
  return plan_with(decoder, query, ranges, capacity, count,
                   [](l4d::Decoder& d, const l4d_plan_query& q,
                      std::vector<l4d_planned_range>* out) { return d.plan(q, out); });
}

l4d_status l4d_decoder_get_buffered(l4d_decoder* decoder, const l4d_plan_query* query,
                                    l4d_time_span* spans, uint64_t capacity, uint64_t* count) {
  return plan_with(decoder, query, spans, capacity, count,
                   [](l4d::Decoder& d, const l4d_plan_query& q, std::vector<l4d_time_span>* out) {
                     return d.buffered(q, out);
                   });
}

}  // extern "C"
