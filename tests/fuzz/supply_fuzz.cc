// SPDX-License-Identifier: Apache-2.0
// Streams that are supplied piece by piece (stream.h, rate.h): pieces in any order, plans, spans,
// rungs and slices between them; then all that is planned, until nothing lacks.
#include <algorithm>
#include <cstdlib>

#include "l4d/rate.h"
#include "tests/fuzz/stream_mutator.h"
#include "tests/hostile/session.h"

namespace {

using namespace l4d;

constexpr size_t kSteps = 16;
constexpr size_t kControlBytes = 2 + 4 * kSteps;
constexpr uint64_t kMaxRanges = 256;
constexpr int kMaxRounds = 4096;

void require(bool holds) {
  if (!holds) std::abort();
}

struct Player {
  const Bytes& file;
  l4d_decoder* decoder = nullptr;

  void supply(uint64_t offset, uint64_t size) {
    require(offset <= file.size() && size <= file.size() - offset);
    const l4d_status status =
        l4d_decoder_supply(decoder, offset, file.data() + offset, static_cast<size_t>(size));
    require(status != L4D_ERR_INTERNAL && status != L4D_ERR_INVALID_ARGUMENT);
  }
  l4d_plan_query query(const uint8_t* step) const {
    l4d_plan_query q;
    l4d_plan_query_init(&q);
    q.time = step[1] / 32.0;
    q.ahead = (step[2] - 64) / 32.0;
    q.max_tier = (step[3] & 3) == 3 ? UINT32_MAX : step[3] & 3;
    q.max_level = (step[3] & 4) != 0 ? step[3] >> 5 : UINT32_MAX;
    q.detail = (step[3] & 8) != 0 ? L4D_DETAIL_BASE_COLOR : L4D_DETAIL_FULL;
    q.merge_gap = (step[3] & 16) != 0 ? 0 : q.merge_gap;
    return q;
  }
  // Returns the number of ranges; hands the first ones over if `give`.
  uint64_t plan(const l4d_plan_query& q, bool give) {
    l4d_planned_range ranges[kMaxRanges];
    uint64_t count = 0;
    const l4d_status status = l4d_decoder_plan(decoder, &q, ranges, kMaxRanges, &count);
    require(status != L4D_ERR_INTERNAL && status != L4D_ERR_NEED_DATA);
    if (status != L4D_OK) return 0;
    for (uint64_t i = 0; i < std::min(count, kMaxRanges); ++i) {
      const l4d_planned_range& r = ranges[i];
      require(r.size > 0 && r.useful_bytes > 0 && r.useful_bytes <= r.size);
      if (give) supply(r.offset, r.size);
    }
    return count;
  }
  void look(const uint8_t* step) {
    l4d_time_span spans[16];
    uint64_t count = 0;
    const l4d_plan_query q = query(step);
    require(l4d_decoder_get_buffered(decoder, &q, spans, 16, &count) != L4D_ERR_INTERNAL);
    l4d_rung rungs[16];
    uint32_t num_rungs = 0;
    const l4d_status status = l4d_decoder_get_rungs(decoder, rungs, 16, &num_rungs);
    require(status != L4D_ERR_INTERNAL);
    if (status != L4D_OK) return;
    require(num_rungs > 0);
    l4d_rung_state state;
    require(l4d_decoder_get_rung_state(decoder, q.time, 1,
                                       &rungs[step[2] % std::min(num_rungs, 16u)],
                                       &state) != L4D_ERR_INTERNAL);
  }
  l4d_status slice(double time) {
    l4d_splat_buffers splats;
    l4d_splat_buffers_init(&splats);
    const l4d_status status = l4d_decoder_slice(decoder, time, &splats);
    require(status != L4D_ERR_INTERNAL);
    return status;
  }
};

}  // namespace

// Options, then steps of four bytes (which, and how), then a file.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < kControlBytes) return 0;
  const Bytes file(data + kControlBytes, data + size);
  l4d_decoder_options options = test::session_options();
  options.tolerant = data[0] & 1;
  options.cache_bytes = (data[0] & 2) != 0 ? 1 : options.cache_bytes;
  options.threads = 1;
  Player player{file};
  require(l4d_decoder_create(&options, &player.decoder) == L4D_OK);
  require(l4d_decoder_open_supplied(player.decoder, file.size()) == L4D_OK);
  for (size_t i = 0; i < kSteps && !file.empty(); ++i) {
    const uint8_t* const step = data + 2 + 4 * i;
    const uint64_t offset = (step[1] | uint64_t{step[2]} << 8) % file.size();
    switch (step[0] % 6) {
      case 0:
        player.supply(offset, std::min<uint64_t>(file.size() - offset, 1 + 64u * step[3]));
        break;
      case 1:
        (void)player.plan(player.query(step), (step[0] & 128) != 0);
        break;
      case 2:
        player.look(step);
        break;
      case 3:
        (void)player.slice(step[1] / 32.0);
        break;
      case 4:
        (void)l4d_decoder_set_layers(player.decoder, UINT32_MAX, step[1] % 4);
        break;
      default:
        (void)l4d_decoder_set_detail(player.decoder, step[1] % 2);
    }
  }
  // Plans come to an end, and then a slice lacks nothing, unless memory does not hold it.
  (void)l4d_decoder_set_layers(player.decoder, UINT32_MAX, UINT32_MAX);
  (void)l4d_decoder_set_detail(player.decoder, L4D_DETAIL_FULL);
  l4d_plan_query query;
  l4d_plan_query_init(&query);
  query.time = data[1] / 32.0;
  int rounds = 0;
  while (!file.empty() && rounds < kMaxRounds && player.plan(query, true) > 0) {
    if (player.slice(query.time) != L4D_ERR_NEED_DATA && options.tolerant == 0) break;
    ++rounds;
  }
  l4d_counters counters;
  l4d_counters_init(&counters);
  if (l4d_decoder_get_counters(player.decoder, &counters) == L4D_OK) {
    require(counters.memory_bytes <= test::kSessionMemory);
  }
  l4d_decoder_destroy(player.decoder);
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_input(data, size, max_size, kControlBytes, seed);
}
