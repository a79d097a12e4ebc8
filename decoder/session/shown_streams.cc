// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/shown_streams.h"

#include <algorithm>
#include <string>

#include "l4d/experimental/columns.h"

namespace l4d {
namespace {

size_t sh_numbers(uint32_t degree) { return size_t{3} * (degree + 1) * (degree + 1); }

template <typename T>
void advance(T*& array, size_t width, uint64_t rows) {
  if (array != nullptr) array += width * static_cast<size_t>(rows);
}

bool wants_arrays(const l4d_splat_buffers& b) {
  return b.position != nullptr || b.covariance != nullptr || b.opacity != nullptr ||
         b.sh != nullptr || b.sh_rows != nullptr || b.scale != nullptr || b.rotation != nullptr ||
         b.color != nullptr || b.id != nullptr;
}
bool wants_arrays(const l4d_splat_columns& c) { return c.capacity > 0; }

void skip(uint64_t rows, uint32_t degree, l4d_splat_buffers* b) {
  advance(b->position, 3, rows);
  advance(b->covariance, 6, rows);
  advance(b->opacity, 1, rows);
  advance(b->sh, sh_numbers(degree), rows);
  advance(b->sh_rows, 1, rows);
  advance(b->scale, 3, rows);
  advance(b->rotation, 4, rows);
  advance(b->color, 3, rows);
  advance(b->id, 1, rows);
}
void skip(uint64_t rows, uint32_t, l4d_splat_columns* c) {
  for (float*& axis : c->position) advance(axis, 1, rows);
  for (float*& entry : c->covariance) advance(entry, 1, rows);
  advance(c->opacity, 1, rows);
  advance(c->sh_rows, 1, rows);
  for (float*& axis : c->scale) advance(axis, 1, rows);
  for (float*& number : c->rotation) advance(number, 1, rows);
  for (float*& channel : c->color) advance(channel, 1, rows);
  advance(c->id, 1, rows);
}

// Without arrays: what remains is what a count depends on.
void drop_arrays(l4d_splat_buffers* b) {
  l4d_splat_buffers none{};
  none.struct_size = sizeof none;
  none.point = b->point;
  *b = none;
}
void drop_arrays(l4d_splat_columns* c) {
  l4d_splat_columns none{};
  none.struct_size = sizeof none;
  none.min_opacity = c->min_opacity;
  none.point = c->point;
  *c = none;
}

// Coefficients that a stream lacks are 0. Rows that were written one after the other move apart,
// the last one first.
void widen_array(size_t known, size_t width, size_t rows, float* sh) {
  for (size_t i = rows; i-- > 0;) {
    float* const row = sh + i * width;
    std::copy_backward(sh + i * known, sh + (i + 1) * known, row + known);
    std::fill(row + known, row + width, 0.0F);
  }
}

float* sh_array(const l4d_splat_buffers& b) { return b.sh; }
float* sh_array(const l4d_splat_columns&) { return nullptr; }

}  // namespace

template <typename Output>
Status ShownStreams<Output>::add(Decoder& decoder, double time) {
  Output part = *out_;
  part.still_key = 0;
  const bool writes = !is_full_ && wants_arrays(part);
  if (writes) {
    part.capacity -= out_->count;
    skip(out_->count, degree_, &part);
  } else {
    drop_arrays(&part);
  }
  const Status status = decoder.slicer().slice(time, &part);
  if (!status.ok() && status.code() != L4D_ERR_BUFFER_TOO_SMALL) return status;
  out_->count += part.count;
  is_full_ = out_->count > out_->capacity;
  const uint32_t known = decoder.file().header().sh_degree;
  if (!writes || is_full_ || known == degree_) return {};
  const size_t rows = static_cast<size_t>(part.count);
  const size_t narrow = sh_numbers(known), width = sh_numbers(degree_);
  if (float* sh = sh_array(part)) widen_array(narrow, width, rows, sh);
  if (part.sh_rows == nullptr) return {};
  return decoder.slicer().widen_rows(narrow, width, rows, part.sh_rows);
}

template <typename Output>
Status ShownStreams<Output>::finish() const {
  if (!is_full_ || !wants_arrays(*out_)) return {};
  return Status(L4D_ERR_BUFFER_TOO_SMALL, "capacity is " + std::to_string(out_->capacity) + ", " +
                                              std::to_string(out_->count) +
                                              " Gaussians are visible");
}

template class ShownStreams<l4d_splat_buffers>;
template class ShownStreams<l4d_splat_columns>;

}  // namespace l4d
