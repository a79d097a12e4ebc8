// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/losses.h"

#include <cstring>

namespace l4d {

bool is_loss(const Status& status) {
  switch (status.code()) {
    case L4D_ERR_IO:
    case L4D_ERR_NEED_DATA:
    case L4D_ERR_TRUNCATED:
    case L4D_ERR_CORRUPT:
    case L4D_ERR_CHECKSUM:
    case L4D_ERR_FEATURE_UNSUPPORTED:
      return true;
    default:
      return false;
  }
}

void Losses::add(const l4d_loss& loss) {
  if (!query_.empty()) {
    l4d_loss& last = query_.back();
    // All that lies behind the end of a file has that one cause.
    const bool same_place = last.offset == loss.offset || loss.status == L4D_ERR_TRUNCATED;
    if (last.layer == loss.layer && last.status == loss.status && same_place &&
        last.detail_only == loss.detail_only && std::strcmp(last.clause, loss.clause) == 0 &&
        last.bucket <= loss.bucket && (last.num_pages == 0) == (loss.num_pages == 0)) {
      last.num_buckets = std::max(last.num_buckets, loss.bucket + loss.num_buckets - last.bucket);
      last.num_pages += loss.num_pages;
      last.num_gaussians += loss.num_gaussians;
      return;
    }
  }
  query_.push_back(loss);
}

void Losses::add_directory_page(uint32_t layer, uint32_t first, uint32_t last,
                                const Status& status) {
  l4d_loss loss{};
  loss.status = status.code();
  loss.layer = layer;
  loss.bucket = first;
  loss.num_buckets = last - first + 1;
  loss.offset = status.offset();
  loss.clause = status.clause();
  add(loss);
  buckets_ += loss.num_buckets;
}

void Losses::add_missing(uint32_t layer, uint32_t num_buckets, uint64_t num_gaussians,
                         const Status& status) {
  l4d_loss loss{};
  loss.status = status.code();
  loss.layer = layer;
  loss.num_buckets = num_buckets;
  loss.num_gaussians = num_gaussians;
  loss.offset = status.offset();
  loss.clause = status.clause();
  add(loss);
  gaussians_ += num_gaussians;
}

void Losses::add_pages(const Plan& plan, const LostPages& lost) {
  const PageTask* before = nullptr;
  for (const LostPage& page : lost) {
    const PageTask& task = plan.tasks[page.task];
    l4d_loss loss{};
    loss.status = page.status.code();
    loss.layer = task.layer;
    loss.bucket = task.record.bucket;
    loss.num_buckets = 1;
    loss.num_pages = 1;
    loss.num_gaussians = task.record.num_gaussians;
    loss.offset = page.status.offset();
    loss.clause = page.status.clause();
    loss.detail_only = page.detail_only;
    add(loss);
    if (page.detail_only) {
      ++details_;
      continue;
    }
    ++pages_;
    gaussians_ += task.record.num_gaussians;
    if (before == nullptr || before->layer != task.layer ||
        before->record.bucket != task.record.bucket) {
      ++buckets_;
    }
    before = &task;
  }
}

std::vector<RowMove> remove_lost(const LostPages& lost, Plan* plan) {
  std::vector<RowMove> moves;
  std::vector<l4d_bucket_span> spans;
  size_t next = 0;
  uint64_t at = 0;
  for (size_t t = 0; t < plan->tasks.size(); ++t) {
    if (next < lost.size() && lost[next].task == t) {
      const bool whole = !lost[next].detail_only;
      ++next;
      if (whole) continue;
    }
    const PageTask& task = plan->tasks[t];
    const l4d_bucket_span& span = plan->spans[task.span];
    if (spans.empty() || spans.back().layer != span.layer || spans.back().bucket != span.bucket ||
        spans.back().block != span.block) {
      spans.push_back(span);
      spans.back().first = at;
      spans.back().count = 0;
    }
    const size_t n = task.record.num_gaussians;
    if (task.first != at) {
      const size_t from = static_cast<size_t>(task.first), to = static_cast<size_t>(at);
      if (!moves.empty() && moves.back().from + moves.back().count == from) {
        moves.back().count += n;
      } else {
        moves.push_back({from, to, n});
      }
    }
    spans.back().count += n;
    at += n;
  }
  plan->spans = std::move(spans);
  plan->num_gaussians = at;
  return moves;
}

}  // namespace l4d
