// SPDX-License-Identifier: Apache-2.0
#include "training/step/residence.h"

#include <algorithm>

namespace l4d::train {
namespace {

bool contains(const std::vector<uint32_t>& sorted, uint32_t id) {
  return std::binary_search(sorted.begin(), sorted.end(), id);
}

template <typename Wanted>
std::vector<uint8_t> mask_of(const std::vector<RowSpan>& spans, const Wanted& wanted) {
  std::vector<uint8_t> mask;
  mask.reserve(spans.size());
  for (const RowSpan& span : spans) mask.push_back(wanted(span) ? 1 : 0);
  return mask;
}

}  // namespace

void Residence::place(const ModelState& whole, const l4d_timeline& timeline) {
  std::vector<size_t> here, away;
  for (size_t i = 0; i < whole.count; ++i) (whole.away[i] == 0 ? here : away).push_back(i);
  visiting_ = false;
  buckets_.clear();
  ModelState none;
  none.allocate(0, whole.sh_degree());
  ModelState resident = merged(whole.rows(here), none, std::max<uint64_t>(capacity_, here.size()));
  resident.next_id = whole.next_id;
  resident.cumulative = whole.cumulative;
  backend_->load(std::move(resident), timeline);
  buckets_.add(whole.rows(away));
}

ModelState Residence::whole() {
  come_home();
  ModelState resident = backend_->save();
  ModelState away = buckets_.copy(BucketStore::Wanted([](const RowSpan&) { return true; }));
  ModelState all = merged(resident, away, resident.count + away.count);
  all.cumulative = std::move(resident.cumulative);
  return all;
}

bool Residence::renew(const std::vector<TimeInterval>& windows, uint64_t step) {
  come_home();
  const BucketStore::Wanted is_needed(windows);
  const auto goes = [&](const RowSpan& span) { return !is_needed(span); };
  const std::vector<uint8_t> leaves = mask_of(backend_->spans(), goes);
  const uint64_t stay = static_cast<uint64_t>(std::count(leaves.begin(), leaves.end(), 0));
  needed_ = stay + buckets_.count(is_needed);
  if (needed_ > capacity_) return false;
  ModelState entering = buckets_.take(is_needed);
  if (entering.count == 0 && stay == leaves.size()) return true;
  for (size_t i = 0; i < entering.count; ++i) {
    // The steps without the row do not count as steps that did not show it.
    entering.last_shown[i] += static_cast<uint32_t>(step) + 1 - entering.away[i];
    entering.away[i] = 0;
  }
  ModelState left = backend_->swap_rows(leaves, entering);
  std::fill(left.away.begin(), left.away.end(), static_cast<uint32_t>(step) + 1);
  buckets_.add(left);
  return true;
}

bool Residence::visit(double time) {
  if (visiting_ && visited_ == time) return true;
  come_home();
  const BucketStore::Wanted is_needed(std::vector<TimeInterval>{{time, time}});
  const std::vector<RowSpan> spans = backend_->spans();
  const uint64_t more = buckets_.count(is_needed);
  std::vector<uint8_t> leaves(spans.size(), 0);
  if (spans.size() + more > capacity_) {
    leaves = mask_of(spans, [&](const RowSpan& span) { return !is_needed(span); });
    const auto stay = static_cast<uint64_t>(std::count(leaves.begin(), leaves.end(), 0));
    if (stay + more > capacity_) return false;
  }
  ModelState guests = buckets_.take(is_needed);
  guests_ = guests.id;
  guests_away_ = guests.away;
  const ModelState absent = backend_->swap_rows(leaves, guests);
  absent_ = absent.id;
  visiting_ = true;
  visited_ = time;
  buckets_.add(absent);
  return true;
}

void Residence::come_home() {
  if (!visiting_) return;
  const std::vector<uint8_t> leaves =
      mask_of(backend_->spans(), [&](const RowSpan& span) { return contains(guests_, span.id); });
  // Mostly nobody made way: then no row is looked at.
  const BucketStore::Wanted nothing(std::vector<TimeInterval>{});
  const BucketStore::Wanted is_absent(
      [&](const RowSpan& span) { return contains(absent_, span.id); });
  const ModelState entering = buckets_.take(absent_.empty() ? nothing : is_absent);
  ModelState guests = backend_->swap_rows(leaves, entering);
  guests.away = guests_away_;
  visiting_ = false;
  buckets_.add(guests);
}

ModelState Residence::rows_at(double time) {
  const BucketStore::Wanted is_needed(std::vector<TimeInterval>{{time, time}});
  const ModelState resident = backend_->save();
  std::vector<size_t> here;
  const std::vector<RowSpan> spans = spans_of(resident);
  for (size_t i = 0; i < spans.size(); ++i) {
    if (is_needed(spans[i])) here.push_back(i);
  }
  const ModelState away = buckets_.copy(is_needed);
  return merged(resident.rows(here), away, here.size() + away.count);
}

std::vector<TimeInterval> intervals_of(const std::vector<TimeInterval>& times,
                                       const std::vector<uint32_t>& which) {
  std::vector<TimeInterval> out;
  for (size_t k = 0; k < which.size(); ++k) {
    const TimeInterval& time = times[which[k]];
    if (k > 0 && which[k] == which[k - 1] + 1) {
      out.back().end = time.end;
    } else {
      out.push_back(time);
    }
  }
  return out;
}

}  // namespace l4d::train
