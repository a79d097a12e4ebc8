// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "l4d/l4d.h"
#include "training/model/buckets.h"
#include "training/step/backend.h"

namespace l4d::train {

// Keeps a model that is larger than the back end: rows that are visible at some instant of the
// windows of images that steps draw from are in the back end, all others are in buckets. A step
// changes rows that it shows alone (with sparse Adam), so a row that is away misses nothing. The
// back end is borrowed; it is loaded, and its rows are moved, through this class alone.
class Residence {
 public:
  // capacity: rows in the back end at most.
  Residence(Backend* backend, BucketOptions options, uint64_t capacity)
      : backend_(backend), buckets_(std::move(options)), capacity_(capacity) {}

  // Takes a model over: rows with `away` 0 go to the back end, which must hold them. Exposures are
  // the caller's.
  void place(const ModelState& whole, const l4d_timeline& timeline);
  // All rows in the order of their ids. `cumulative` is of those in the back end.
  ModelState whole();

  // Moves rows, so that those that are visible in `windows` are in the back end and no others.
  // step: steps done. Returns false and moves none if they exceed its capacity. The weights of
  // targets must be renewed then.
  bool renew(const std::vector<TimeInterval>& windows, uint64_t step);
  // Rows that the last renew() needed.
  uint64_t needed() const { return needed_; }

  // Until come_home(), the rows that are visible at `time` are in the back end: to render, and for
  // nothing else. Returns false and changes nothing if they exceed its capacity.
  bool visit(double time);
  // What was in the back end before visits is there again, bit for bit.
  void come_home();
  // A model of the rows that are visible at `time` alone.
  ModelState rows_at(double time);

  uint64_t count() const { return backend_->count() + buckets_.rows(); }
  uint64_t capacity() const { return capacity_; }
  const BucketStore& buckets() const { return buckets_; }

 private:
  Backend* backend_;
  BucketStore buckets_;
  const uint64_t capacity_;
  uint64_t needed_ = 0;
  // During visits.
  bool visiting_ = false;
  double visited_ = 0;
  std::vector<uint32_t> guests_;       // ids, sorted
  std::vector<uint32_t> guests_away_;  // their `away`
  std::vector<uint32_t> absent_;       // ids of rows that made way, sorted
};

// The parts of a sequence that instants are in: runs of neighbours in the list are one part. times:
// of all instants; which: indices of those that are there, sorted.
std::vector<TimeInterval> intervals_of(const std::vector<TimeInterval>& times,
                                       const std::vector<uint32_t>& which);

}  // namespace l4d::train
