// SPDX-License-Identifier: Apache-2.0
// What a tolerant decoder leaves out of a query, and how the rest closes ranks.
#pragma once

#include <algorithm>
#include <vector>

#include "decoder/read/plan.h"

namespace l4d {

// Whether a failure is one of the stream or its reader, which costs what it concerns. Others, such
// as limits and cancelling, concern the call.
bool is_loss(const Status& status);

// A page of a plan that could not be decoded, or of which the SH chunk could not.
struct LostPage {
  size_t task = 0;
  Status status;
  bool detail_only = false;  // its Gaussians are there, their SH without detail
};
using LostPages = std::vector<LostPage>;  // ascending by task

// The losses of the query at hand, and sums over all queries.
class Losses {
 public:
  void begin_query() { query_.clear(); }
  // Directory page `index` of a layer, of whose buckets the query wants [first, last].
  void add_directory_page(uint32_t layer, uint32_t first, uint32_t last, const Status& status);
  // A layer whose records hold fewer Gaussians than its header says.
  void add_missing(uint32_t layer, uint32_t num_buckets, uint64_t num_gaussians,
                   const Status& status);
  void add_pages(const Plan& plan, const LostPages& lost);

  const std::vector<l4d_loss>& query() const { return query_; }
  uint64_t pages() const { return pages_; }
  uint64_t buckets() const { return buckets_; }
  uint64_t gaussians() const { return gaussians_; }
  uint64_t details() const { return details_; }

 private:
  // Adds to the last loss where both have one cause.
  void add(const l4d_loss& loss);

  std::vector<l4d_loss> query_;
  uint64_t pages_ = 0;
  uint64_t buckets_ = 0;
  uint64_t gaussians_ = 0;
  uint64_t details_ = 0;
};

// Rows of decoded arrays that move towards the front because pages before them are lost.
struct RowMove {
  size_t from = 0;
  size_t to = 0;
  size_t count = 0;
};

// Takes pages that are lost, not in detail only, out of the ranges and the count of a plan, whose
// tasks stay. Returns the moves, in order, that leave no gap in arrays that were decoded with the
// plan as it was.
std::vector<RowMove> remove_lost(const LostPages& lost, Plan* plan);

template <typename T>
void move_rows(const std::vector<RowMove>& moves, size_t dim, T* rows) {
  if (rows == nullptr) return;
  for (const RowMove& m : moves) {
    std::copy(rows + dim * m.from, rows + dim * (m.from + m.count), rows + dim * m.to);
  }
}

}  // namespace l4d
