// SPDX-License-Identifier: Apache-2.0
#include "training/density/relocate.h"

#include <algorithm>

#include "training/density/relocate_row.h"
#include "training/density/temporal_split.h"

namespace l4d::train {
namespace {

struct Child {
  uint64_t target, row;
};

// The rows of the step's share that are torn, whose statistics begin anew then.
std::vector<uint64_t> take_torn(const DensityStep& step, const DensityArrays& arrays) {
  std::vector<uint64_t> torn;
  if (!(step.split_above > 0)) return torn;
  for (uint64_t i = 0; i < step.count; ++i) {
    if (arrays.id[i] % step.cycle != step.turn || arrays.time_visits[i] < kSplitVisits) continue;
    if (!is_dead(step, arrays, i) && is_torn(step, arrays, i)) torn.push_back(i);
    arrays.time_gradient[i] = arrays.time_magnitude[i] = 0;
    arrays.time_visits[i] = 0;
  }
  return torn;
}

}  // namespace

void accumulate_weights(const Rows<const float>& value, const float* coverage, const float* error,
                        uint64_t count, float beta, std::vector<double>* cumulative) {
  const auto excess = [&](uint64_t i) {
    return coverage[i] > 0 ? static_cast<double>(error[i] / coverage[i]) : 0.0;
  };
  double mean = 0;
  for (uint64_t i = 0; i < count; ++i) mean += excess(i);
  mean /= static_cast<double>(std::max<uint64_t>(count, 1));
  cumulative->resize(static_cast<size_t>(count));
  double sum = 0;
  for (uint64_t i = 0; i < count; ++i) {
    const double opacity = linear_opacity(static_cast<double>(value.opacity[i]), true);
    const double e = mean > 0 ? excess(i) / mean : 0;
    if (std::isfinite(opacity) && opacity >= static_cast<double>(kDeadOpacity)) {
      sum += opacity * (1 + static_cast<double>(beta) * e);
    }
    (*cumulative)[i] = sum;
  }
}

DensityChange change_density(const DensityStep& step, const DensityArrays& arrays) {
  DensityChange change;
  if (arrays.sampled == 0 || !(arrays.cumulative[arrays.sampled - 1] > 0)) return change;
  std::vector<Child> children, halves;
  const std::vector<uint64_t> torn = take_torn(step, arrays);
  const auto find_parent = [&](uint32_t id, uint64_t row) {
    if (halves.size() < torn.size()) {
      halves.push_back({torn[halves.size()], row});
      return true;
    }
    const uint64_t target = target_of(step, arrays, id);
    if (target != kNoTarget) children.push_back({target, row});
    return target != kNoTarget;
  };
  for (uint64_t i = 0; i < step.count; ++i) {
    if (arrays.id[i] % step.cycle != step.turn || !is_dead(step, arrays, i)) continue;
    if (find_parent(arrays.id[i], i)) ++change.relocated;
  }
  for (uint64_t k = 0; k < step.births; ++k) {
    const uint32_t id = step.next_id + static_cast<uint32_t>(k);
    const uint64_t row = step.count + change.born;
    if (!find_parent(id, row)) continue;
    arrays.id[row] = id;
    ++change.born;
  }
  std::sort(children.begin(), children.end(), [](const Child& a, const Child& b) {
    return a.target != b.target ? a.target < b.target : a.row < b.row;
  });
  for (size_t k = 0; k < children.size();) {
    const uint64_t target = children[k].target;
    size_t end = k;
    while (end < children.size() && children[end].target == target) ++end;
    const int copies = static_cast<int>(std::min<size_t>(end - k + 1, kMaxCopies));
    shrink_target(step, arrays, target, copies);
    for (; k < end; ++k) place_child(step, arrays, target, children[k].row);
  }
  for (const Child& half : halves) split_life(step, arrays, half.target, half.row);
  change.split = halves.size();
  return change;
}

}  // namespace l4d::train
