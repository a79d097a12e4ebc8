// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "api/decoder_handle.h"
#include "decoder/session/rate_control.h"

using l4d::Status;
using l4d::api::call_on;
using l4d::api::fail_without_handle;
using l4d::api::guard;
using l4d::api::init_struct;
using l4d::api::keep_last;
using l4d::api::look_at;
using l4d::api::optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

struct l4d_rate {
  l4d_rate(const l4d_rate_options& options, uint32_t num_rungs) : impl(options, num_rungs) {}
  l4d::RateControl impl;
};

namespace {

l4d_rate_options default_rate_options() {
  l4d_rate_options o{};
  o.struct_size = sizeof o;
  o.ahead = 6;
  o.up_buffer = 4;
  return o;
}

// The work of a call on a controller. It calls nothing back.
template <typename Body>
l4d_status with_rate(l4d_rate* rate, const char* bad, const Body& body) {
  if (rate == nullptr) return fail_without_handle();
  return keep_last(guard([&]() -> Status {
    if (bad != nullptr) return l4d::invalid_argument(bad);
    return body(rate->impl);
  }));
}

Status check_open(const l4d::Decoder& decoder) {
  if (decoder.is_waiting()) {
    return Status(L4D_ERR_NEED_DATA, "the headers of the stream have not been supplied yet");
  }
  return decoder.is_open() ? Status() : Status(L4D_ERR_INVALID_STATE, "no stream is open");
}

bool ascend(double a, double b, double c) {
  return std::isfinite(a) && std::isfinite(c) && a <= b && b <= c;
}

std::vector<l4d_rung> rungs_of(const l4d::SceneHeader& header) {
  std::set<uint32_t> tiers;
  bool has_detail = false;
  for (const l4d::LayerHeader& layer : header.layers) {
    if (layer.num_gaussians == 0) continue;
    tiers.insert(layer.tier);
    has_detail = has_detail || (layer.has_entropy && header.has_sh_detail());
  }
  const uint32_t base = has_detail ? L4D_DETAIL_BASE_COLOR : L4D_DETAIL_FULL;
  std::vector<l4d_rung> rungs;
  for (const uint32_t tier : tiers) rungs.push_back({tier, UINT32_MAX, base, 0});
  if (rungs.empty()) rungs.push_back({0, UINT32_MAX, base, 0});
  rungs.back().max_tier = UINT32_MAX;
  if (has_detail) rungs.push_back({UINT32_MAX, UINT32_MAX, L4D_DETAIL_FULL, 0});
  return rungs;
}

Status find_state(l4d::Decoder& decoder, const l4d_plan_query& query, l4d_rung_state* out) {
  std::vector<l4d_planned_range> ranges;
  std::vector<l4d_time_span> spans;
  L4D_RETURN_IF_ERROR(decoder.plan(query, &ranges));
  L4D_RETURN_IF_ERROR(decoder.buffered(query, &spans));
  *out = {};
  for (const l4d_planned_range& range : ranges) out->missing_bytes += range.useful_bytes;
  const l4d::Sequence sequence = l4d::sequence_of(decoder.file().header().timeline);
  const double time = std::clamp(query.time, sequence.begin, sequence.end);
  if (spans.empty() || spans[0].begin > time) return {};
  const bool to_the_end = spans[0].end >= sequence.end;
  out->buffered = to_the_end ? HUGE_VAL : spans[0].end - time;
  return {};
}

}  // namespace

extern "C" {

void l4d_rate_options_init_(l4d_rate_options* options, size_t struct_size) {
  init_struct(options, struct_size, default_rate_options());
}

void l4d_rate_choice_init_(l4d_rate_choice* choice, size_t struct_size) {
  init_struct(choice, struct_size, l4d_rate_choice{});
}

l4d_status l4d_decoder_get_rungs(const l4d_decoder* decoder, l4d_rung* rungs, uint32_t capacity,
                                 uint32_t* count) {
  const char* bad = required(count);
  if (bad == nullptr && capacity > 0) bad = required(rungs);
  return look_at(decoder, bad, [&]() -> Status {
    L4D_RETURN_IF_ERROR(check_open(decoder->impl));
    const std::vector<l4d_rung> all = rungs_of(decoder->impl.file().header());
    *count = static_cast<uint32_t>(all.size());
    std::copy_n(all.begin(), std::min<size_t>(capacity, all.size()), rungs);
    return {};
  });
}

l4d_status l4d_decoder_get_rung_state(l4d_decoder* decoder, double time, double ahead,
                                      const l4d_rung* rung, l4d_rung_state* state) {
  return call_on(decoder, required(rung, state), [&]() -> Status {
    L4D_RETURN_IF_ERROR(check_open(decoder->impl));
    if (!decoder->impl.file().source().is_supplied()) {
      return Status(L4D_ERR_INVALID_STATE, "no stream is open for supplies");
    }
    if (!std::isfinite(time) || !(ahead >= 0) || !std::isfinite(ahead)) {
      return l4d::invalid_argument("time and ahead are finite, and ahead is 0 or more");
    }
    if (rung->detail > L4D_DETAIL_BASE_COLOR) return l4d::invalid_argument("unknown detail");
    l4d_plan_query query;
    l4d_plan_query_init(&query);
    query.time = time;
    query.ahead = ahead;
    query.max_level = rung->max_level;
    query.max_tier = rung->max_tier;
    query.detail = rung->detail;
    query.merge_gap = 0;
    query.max_range_bytes = UINT64_MAX;
    return find_state(decoder->impl, query, state);
  });
}

l4d_status l4d_rate_create(const l4d_rate_options* options, uint32_t num_rungs, l4d_rate** out) {
  const char* bad = required(out);
  if (bad == nullptr) bad = optional(options);
  return keep_last(guard([&]() -> Status {
    if (bad != nullptr) return l4d::invalid_argument(bad);
    *out = nullptr;
    const l4d_rate_options o =
        options == nullptr ? default_rate_options() : read_struct(*options, default_rate_options());
    if (num_rungs == 0 || num_rungs > L4D_MAX_RUNGS) {
      return l4d::invalid_argument("num_rungs is 1 to L4D_MAX_RUNGS");
    }
    if (!(o.up_buffer >= 0 && o.up_buffer < o.ahead && std::isfinite(o.ahead))) {
      return l4d::invalid_argument("ahead is finite, and up_buffer is 0 or more and below ahead");
    }
    if (!(o.start_throughput >= 0 && std::isfinite(o.start_throughput))) {
      return l4d::invalid_argument("start_throughput is finite and 0 or more");
    }
    *out = new l4d_rate(o, num_rungs);
    return {};
  }));
}

void l4d_rate_destroy(l4d_rate* rate) { delete rate; }

l4d_status l4d_rate_add_transfer(l4d_rate* rate, double sent, double first_byte, double last_byte,
                                 uint64_t bytes) {
  return with_rate(rate, nullptr, [&](l4d::RateControl& control) -> Status {
    if (!ascend(sent, first_byte, last_byte)) {
      return l4d::invalid_argument("sent, first_byte and last_byte are finite and ascend");
    }
    control.add(sent, first_byte, last_byte, bytes);
    return {};
  });
}

l4d_status l4d_rate_choose(l4d_rate* rate, const l4d_rung_state* states, uint32_t num_rungs,
                           l4d_rate_choice* choice) {
  return with_rate(rate, required(states, choice), [&](l4d::RateControl& control) -> Status {
    if (num_rungs != control.num_rungs()) {
      return l4d::invalid_argument("num_rungs is not that of the controller");
    }
    for (uint32_t r = 0; r < num_rungs; ++r) {
      if (!(states[r].buffered >= 0)) {
        return l4d::invalid_argument("buffered is not a number of 0 or more");
      }
    }
    l4d_rate_choice found{};
    control.choose(states, &found);
    write_struct(found, choice);
    return {};
  });
}

}  // extern "C"
