// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/read_ahead.h"

#include "decoder/read/read_ahead.h"

namespace l4d {
namespace {

// A larger step is a seek.
constexpr double kMaxStepSeconds = 0.5;
constexpr double kAheadSeconds = 1;

}  // namespace

l4d_query ReadAhead::window(const l4d_query& instant) const {
  l4d_query query = instant;
  if (!playing_) return query;
  query.kind = L4D_QUERY_RANGE;
  query.time_end = query.time_begin + kAheadSeconds;
  return query;
}

void ReadAhead::fetch_directory(const l4d_query& instant) {
  if (!stream_.file().source().fetches()) return;
  stream_.begin_query();
  const double step = instant.time_begin - time_;
  if (step != 0) playing_ = has_time_ && step > 0 && step <= kMaxStepSeconds;
  time_ = instant.time_begin;
  has_time_ = true;
  l4d::fetch_directory(stream_.file(), instant, window(instant));
}

bool ReadAhead::find_wanted(const Plan& plan, bool with_shape) {
  wanted_.assign(plan.spans.size(), false);
  bool any = false;
  for (size_t i = 0; i < plan.spans.size(); ++i) {
    wanted_[i] = !cache_.holds(plan.spans[i], plan.detail, with_shape);
    any = any || wanted_[i];
  }
  return any;
}

void ReadAhead::fetch_buckets(const l4d_query& instant, const Plan& plan, bool with_shape) {
  SceneFile& file = stream_.file();
  if (!file.source().fetches() || !find_wanted(plan, with_shape) ||
      are_chunks_fetched(file, plan, wanted_)) {
    return;
  }
  Plan ahead;
  if (playing_ && make_plan(file, window(instant), nullptr, &ahead).ok()) {
    find_wanted(ahead, with_shape);
    fetch_chunks(file, ahead, wanted_);
  } else {
    fetch_chunks(file, plan, wanted_);
  }
}

void ReadAhead::close() {
  has_time_ = playing_ = false;
  wanted_.clear();
}

}  // namespace l4d
