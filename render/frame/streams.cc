// SPDX-License-Identifier: Apache-2.0
#include "render/frame/streams.h"

#include <algorithm>

namespace l4d::render {
namespace {

size_t sh_numbers(uint32_t degree) { return size_t{3} * (degree + 1) * (degree + 1); }

}  // namespace

void Streams::set(l4d_decoder* const* decoders, const double* shifts, size_t count,
                  MemoryBudget& memory) {
  forget(memory);
  parts_.clear();
  for (size_t k = 0; k < count; ++k) {
    Part part;
    part.decoder = decoders[k];
    part.shift = shifts == nullptr ? 0 : shifts[k];
    parts_.push_back(std::move(part));
  }
}

void Streams::restart() {
  for (Part& part : parts_) part.still_key = 0;
}

void Streams::forget(MemoryBudget& memory) {
  restart();
  for (Part& part : parts_) part.frame.forget(memory);
  l4d::forget(memory, &wide_sh_);
}

Status Streams::slice(double time, MemoryBudget& memory, Frame<float>* out) {
  if (parts_.size() == 1) {
    Part& only = parts_.front();
    return slice_stream(only.decoder, time - only.shift, memory, &only.still_key, out);
  }
  size_t count = 0;
  uint32_t degree = 0;
  for (Part& part : parts_) {
    L4D_RETURN_IF_ERROR(
        slice_stream(part.decoder, time - part.shift, memory, &part.still_key, &part.frame));
    count += part.frame.count();
    degree = std::max(degree, part.frame.sh_degree);
  }
  L4D_RETURN_IF_ERROR(out->resize(count, memory));
  out->sh_degree = degree;
  size_t at = 0;
  for (const Part& part : parts_) {
    const Frame<float>& from = part.frame;
    const auto append = [&](const auto& column, auto* to) {
      std::copy_n(column.begin(), from.count(), to->begin() + static_cast<std::ptrdiff_t>(at));
    };
    for (size_t k = 0; k < 3; ++k) append(from.position[k], &out->position[k]);
    for (size_t k = 0; k < 6; ++k) append(from.covariance[k], &out->covariance[k]);
    append(from.opacity, &out->opacity);
    append(from.sh, &out->sh);
    at += from.count();
  }
  for (size_t i = 0; i < count; ++i) out->id[i] = static_cast<uint32_t>(i);
  return widen_sh(degree, memory, out);
}

Status Streams::widen_sh(uint32_t degree, MemoryBudget& memory, Frame<float>* out) {
  size_t narrow = 0;
  for (const Part& part : parts_) {
    if (part.frame.sh_degree < degree) narrow += part.frame.count();
  }
  if (narrow == 0) return {};
  const size_t width = sh_numbers(degree);
  l4d::forget(memory, &wide_sh_);
  L4D_RETURN_IF_ERROR(renew(memory, &wide_sh_, narrow * width, "SH of streams of several degrees"));
  float* row = wide_sh_.data();
  size_t at = 0;
  for (const Part& part : parts_) {
    if (part.frame.sh_degree == degree) {
      at += part.frame.count();
      continue;
    }
    const size_t known = sh_numbers(part.frame.sh_degree);
    for (size_t i = 0; i < part.frame.count(); ++i, ++at, row += width) {
      std::fill(std::copy_n(out->sh[at], known, row), row + width, 0.0F);
      out->sh[at] = row;
    }
  }
  return {};
}

}  // namespace l4d::render
