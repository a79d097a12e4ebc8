// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/query.h"

#include <algorithm>
#include <string>

#include "l4d/attributes.hpp"
#include "l4d/experimental/packed.h"

namespace l4d {
namespace {

template <typename Buffers>
Status check_capacity(const Plan& plan, Buffers* out) {
  out->count = plan.num_gaussians;
  if (out->spans != nullptr) out->num_spans = plan.spans.size();
  if (plan.num_gaussians > out->capacity) {
    return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is " + std::to_string(out->capacity) +
                                                ", the query selects " +
                                                std::to_string(plan.num_gaussians) + " Gaussians");
  }
  if (out->spans != nullptr && plan.spans.size() > out->span_capacity) {
    return Status(L4D_ERR_BUFFER_TOO_SMALL,
                  "span_capacity is " + std::to_string(out->span_capacity) +
                      ", the query selects " + std::to_string(plan.spans.size()));
  }
  return {};
}

template <typename Buffers>
void describe_output(const Plan& plan, Buffers* out) {
  if (out->spans != nullptr) {
    std::copy(plan.spans.begin(), plan.spans.end(), out->spans);
    out->num_spans = plan.spans.size();
  }
  out->count = plan.num_gaussians;
}

}  // namespace

Status select_query(OpenStream& stream, const l4d_query& query, l4d_selection* out) {
  Plan plan;
  L4D_RETURN_IF_ERROR(stream.plan(query, &plan));
  out->num_gaussians = plan.num_gaussians;
  out->num_spans = plan.spans.size();
  out->num_pages = plan.tasks.size();
  out->bytes = plan.bytes;
  out->sh_bytes = plan.sh_bytes;
  out->directory_bytes = plan.directory_bytes;
  return {};
}

Status find_ranges(OpenStream& stream, const l4d_query& query, l4d_bucket_span* out,
                   uint64_t capacity, uint64_t* count) {
  Plan plan;
  L4D_RETURN_IF_ERROR(stream.plan(query, &plan));
  std::copy_n(plan.spans.begin(), std::min<uint64_t>(capacity, plan.spans.size()), out);
  *count = plan.spans.size();
  return {};
}

Status decode_query(OpenStream& stream, const l4d_query& query, l4d_gaussian_buffers* out,
                    uint64_t* num_buckets) {
  Plan plan;
  L4D_RETURN_IF_ERROR(stream.plan(query, &plan));
  L4D_RETURN_IF_ERROR(check_capacity(plan, out));
  LostPages lost;
  L4D_RETURN_IF_ERROR(stream.pages().expand(plan, 0, plan.tasks.size(), *out,
                                            stream.progress("decode"), stream.if_tolerant(&lost)));
  if (out->id != nullptr) write_ids(plan, out->id);
  if (!lost.empty()) {
    stream.losses().add_pages(plan, lost);
    const std::vector<RowMove> moves = remove_lost(lost, &plan);
    const uint32_t degree = stream.file().header().sh_degree;
    for_each_decoded(
        [&](const AttributeInfo& a, float* rows) { move_rows(moves, a.numbers(degree), rows); },
        *out);
    move_rows(moves, 1, out->mean_t_double);
    move_rows(moves, 2, out->window);
    move_rows(moves, stream.file().header().sh_dim(), out->sh_half);
    move_rows(moves, 1, out->id);
  }
  describe_output(plan, out);
  *num_buckets = plan.spans.size();
  return {};
}

Status decode_query_packed(OpenStream& stream, const l4d_query& query, l4d_packed_buffers* out,
                           uint64_t* num_buckets) {
  Plan plan;
  L4D_RETURN_IF_ERROR(stream.plan(query, &plan));
  L4D_RETURN_IF_ERROR(check_capacity(plan, out));
  LostPages lost;
  L4D_RETURN_IF_ERROR(
      stream.pages().pack(plan, *out, stream.progress("decode"), stream.if_tolerant(&lost)));
  if (!lost.empty()) {
    stream.losses().add_pages(plan, lost);
    size_t stages[L4D_COMPONENT_COUNT] = {};
    for (const l4d_bucket_span& r : plan.spans) {
      const SceneHeader& header = stream.file().header();
      for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        stages[c] = std::max(stages[c], header.component(header.layers[r.layer], c).stages.size());
      }
    }
    const std::vector<RowMove> moves = remove_lost(lost, &plan);
    move_rows(moves, 3, out->position);
    move_rows(moves, 1, out->mean_t);
    move_rows(moves, 1, out->opacity);
    move_rows(moves, 1, out->scale_factor);
    move_rows(moves, 2, out->window);
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const l4d_packed_component& to = out->component[c];
      move_rows(moves, 1, to.depth);
      for (size_t s = 0; to.index != nullptr && s < stages[c]; ++s) {
        move_rows(moves, 1, to.index + s * static_cast<size_t>(out->capacity));
      }
    }
  }
  describe_output(plan, out);
  *num_buckets = plan.spans.size();
  return {};
}

}  // namespace l4d
