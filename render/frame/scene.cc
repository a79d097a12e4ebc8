// SPDX-License-Identifier: Apache-2.0
#include "render/frame/scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "l4d/experimental/columns.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/prepare.h"

namespace l4d::render {
Status Scene::set(const l4d_gaussians& gaussians, const l4d_timeline& timeline) {
  if (gaussians.sh_degree > 3) return invalid_argument("sh_degree is above 3");
  if (gaussians.count > std::numeric_limits<uint32_t>::max()) {
    return Status(L4D_ERR_LIMIT_EXCEEDED, "more than 2^32 - 1 Gaussians");
  }
  const size_t n = static_cast<size_t>(gaussians.count);
  if (n > 0 && !has_all_arrays(gaussians)) return invalid_argument("an attribute array is NULL");
  if (!is_valid(timeline)) return invalid_argument(kTimelineRule);
  for (size_t i = 0; i < n; ++i) {
    if (const char* attribute = invalid_attribute(gaussians, i)) {
      return Status(L4D_ERR_INVALID_SCENE, "Gaussian " + std::to_string(i) + ": " + attribute +
                                               " is not a number or out of range");
    }
    if (!has_valid_window(gaussians, i, timeline.num_frames)) {
      return Status(L4D_ERR_INVALID_SCENE,
                    "Gaussian " + std::to_string(i) + ": window is empty or outside the sequence");
    }
  }
  gaussians_ = gaussians;
  timeline_ = timeline;
  sequence_ = sequence_of(timeline);
  center_ = sequence_.center();
  still_frame_ = nullptr;
  return {};
}

Status Scene::prepare(const l4d_gaussians& gaussians, const l4d_timeline& timeline, int threads,
                      MemoryBudget& memory) {
  L4D_RETURN_IF_ERROR(set(gaussians, timeline));
  const size_t n = count();
  constexpr const char* kWhat = "preparing the scene";
  MemoryCharge scratch(memory);
  L4D_RETURN_IF_ERROR(scratch.take(uint64_t{n} * sizeof(MotionGroup), kWhat));
  std::vector<MotionGroup> group(n);
  const auto prepared = [&](size_t i) { return prepare_gaussian(gaussians_, sequence_, i); };
  parallel_for(threads, n, kGrain, [&](size_t first, size_t last) {
    for (size_t i = first; i < last; ++i) {
      group[i] = group_of(prepared(i), sequence_);
    }
  });
  L4D_RETURN_IF_ERROR(renew(memory, &id_, n, kWhat));
  size_t placed = 0;
  for (const MotionGroup wanted : {kStill, kFading, kMoving}) {
    for (size_t i = 0; i < n; ++i) {
      if (group[i] == wanted) id_[placed++] = static_cast<uint32_t>(i);
    }
    if (wanted == kStill) num_still_ = placed;
    if (wanted == kFading) num_unmoving_ = placed;
  }
  const size_t moving = n - num_unmoving_;
  for (auto& axis : position_) L4D_RETURN_IF_ERROR(renew(memory, &axis, n, kWhat));
  for (auto& axis : velocity_) L4D_RETURN_IF_ERROR(renew(memory, &axis, moving, kWhat));
  for (auto& entry : covariance_) L4D_RETURN_IF_ERROR(renew(memory, &entry, n, kWhat));
  for (auto* column : {&opacity_, &mean_, &lambda_}) {
    L4D_RETURN_IF_ERROR(renew(memory, column, n, kWhat));
  }
  L4D_RETURN_IF_ERROR(renew(memory, &shown_, n, kWhat));
  L4D_RETURN_IF_ERROR(renew(memory, &window_, gaussians.window == nullptr ? 0 : n, kWhat));
  L4D_RETURN_IF_ERROR(renew(memory, &reference_, moving, kWhat));
  parallel_for(threads, n, kGrain, [&](size_t first, size_t last) {
    for (size_t row = first; row < last; ++row) {
      const Prepared p = prepared(id_[row]);
      const double mean = p.mean - center_;
      for (size_t k = 0; k < 3; ++k) position_[k][row] = static_cast<float>(p.position[k]);
      for (size_t k = 0; k < 6; ++k)
        covariance_[k][row] = static_cast<float>(p.slice.covariance[k]);
      if (row >= num_unmoving_) {
        const size_t at = row - num_unmoving_;
        for (size_t k = 0; k < 3; ++k) velocity_[k][at] = static_cast<float>(p.slice.velocity[k]);
        reference_[at] = static_cast<float>(p.reference - center_);
      }
      opacity_[row] = static_cast<float>(p.opacity);
      mean_[row] = static_cast<float>(mean);
      lambda_[row] = static_cast<float>(p.slice.lambda);
      shown_[row] = interval_of(mean, p.half_life);
      if (!window_.empty()) window_[row] = p.window;
    }
  });
  return {};
}

void Scene::forget(MemoryBudget& memory) {
  l4d::forget(memory, &id_);
  for (auto& axis : position_) l4d::forget(memory, &axis);
  for (auto& axis : velocity_) l4d::forget(memory, &axis);
  for (auto& entry : covariance_) l4d::forget(memory, &entry);
  for (auto* column : {&reference_, &opacity_, &mean_, &lambda_}) l4d::forget(memory, column);
  l4d::forget(memory, &shown_);
  l4d::forget(memory, &window_);
}

Status Scene::slice(double time, int threads, MemoryBudget& memory, Frame<float>* out) {
  const float t = static_cast<float>(time - center_);
  const uint32_t frame = frame_of_time(timeline_, time);
  const size_t n = count();
  const size_t stride = size_t{3} * (gaussians_.sh_degree + 1) * (gaussians_.sh_degree + 1);
  out->sh_degree = gaussians_.sh_degree;
  // Still rows fill the beginning of the frame once.
  const bool still_done = still_frame_ == out;
  still_frame_ = nullptr;

  const size_t first_row = still_done ? num_still_ : 0;
  std::vector<size_t> offset((n - first_row + kGrain - 1) / kGrain + 1, 0);
  parallel_for(threads, n - first_row, kGrain, [&](size_t begin, size_t end) {
    size_t visible_rows = 0;
    for (size_t r = first_row + begin; r < first_row + end; ++r)
      visible_rows += visible(r, t, frame);
    offset[begin / kGrain + 1] = visible_rows;
  });
  offset[0] = first_row;  // all still rows are visible at all times
  for (size_t p = 1; p < offset.size(); ++p) offset[p] += offset[p - 1];
  L4D_RETURN_IF_ERROR(out->resize(offset.back(), memory));
  parallel_for(threads, n - first_row, kGrain, [&](size_t begin, size_t end) {
    size_t at = offset[begin / kGrain];
    for (size_t r = first_row + begin; r < first_row + end; ++r) {
      if (!visible(r, t, frame)) continue;
      out->id[at] = id_[r];
      out->sh[at] = gaussians_.sh + stride * id_[r];
      for (size_t k = 0; k < 6; ++k) out->covariance[k][at] = covariance_[k][r];
      if (r < num_unmoving_) {
        for (size_t k = 0; k < 3; ++k) out->position[k][at] = position_[k][r];
      } else {
        const size_t m = r - num_unmoving_;
        const float dt = t - reference_[m];
        for (size_t k = 0; k < 3; ++k) {
          out->position[k][at] = position_[k][r] + velocity_[k][m] * dt;
        }
      }
      float opacity = opacity_[r];
      if (r >= num_still_) opacity *= falloff(lambda_[r], t - mean_[r]);
      out->opacity[at] = opacity;
      ++at;
    }
  });
  still_frame_ = out;
  return {};
}

Status Scene::slice(double time, MemoryBudget& memory, Frame<double>* out) const {
  const float t = static_cast<float>(time - center_);
  const uint32_t frame = frame_of_time(timeline_, time);
  const size_t stride = size_t{3} * (gaussians_.sh_degree + 1) * (gaussians_.sh_degree + 1);
  out->sh_degree = gaussians_.sh_degree;
  size_t visible_rows = 0;
  for (size_t r = 0; r < count(); ++r) visible_rows += visible(r, t, frame);
  L4D_RETURN_IF_ERROR(out->resize(visible_rows, memory));
  size_t at = 0;
  for (size_t r = 0; r < count(); ++r) {
    if (!visible(r, t, frame)) continue;
    const size_t i = id_[r];
    const Prepared p = prepare_gaussian(gaussians_, sequence_, i);
    out->id[at] = id_[r];
    out->sh[at] = gaussians_.sh + stride * i;
    for (size_t k = 0; k < 3; ++k) {
      out->position[k][at] = p.position[k] + p.slice.velocity[k] * (time - p.reference);
    }
    for (size_t k = 0; k < 6; ++k) out->covariance[k][at] = p.slice.covariance[k];
    out->opacity[at] = p.opacity * falloff(p.slice.lambda, time - p.mean);
    ++at;
  }
  return {};
}

Status slice_streams(const std::vector<l4d_shown_stream>& streams, const l4d_operating_point& point,
                     MemoryBudget& memory, uint64_t* still_key, Frame<float>* out) {
  l4d_splat_columns columns = L4D_INIT(l4d_splat_columns);
  columns.still_key = *still_key;
  columns.min_opacity = static_cast<float>(kMinAlpha);
  columns.point = point;
  l4d_status status = L4D_OK;
  uint32_t sh_degree = 0;
  for (const l4d_shown_stream& stream : streams) {
    l4d_info info = L4D_INIT(l4d_info);
    if (status == L4D_OK) status = l4d_decoder_get_info(stream.decoder, &info);
    sh_degree = std::max(sh_degree, info.sh_degree);
  }
  size_t named = *still_key != 0 ? out->capacity() : 0;  // rows that have their ids
  *still_key = 0;
  const uint64_t key = columns.still_key;
  const auto slice = [&] {
    columns.still_key = key;
    columns.capacity = out->capacity();
    for (size_t k = 0; k < 3; ++k) columns.position[k] = out->position[k].data();
    for (size_t k = 0; k < 6; ++k) columns.covariance[k] = out->covariance[k].data();
    columns.opacity = out->opacity.data();
    columns.sh_rows = out->sh.data();
    status = l4d_slice_streams_columns(streams.data(), streams.size(), &columns);
    return status == L4D_ERR_BUFFER_TOO_SMALL ||
           (status == L4D_OK && columns.count > out->capacity());
  };
  // Once for most instants: as many fitted before. Still rows stay while arrays grow.
  while (status == L4D_OK && slice()) {
    status = L4D_OK;
    L4D_RETURN_IF_ERROR(out->reserve(static_cast<size_t>(columns.count), memory));
  }
  if (status != L4D_OK) return Status(status, l4d_last_error_message());
  L4D_RETURN_IF_ERROR(out->resize(static_cast<size_t>(columns.count), memory));
  for (; named < out->capacity(); ++named) out->id[named] = static_cast<uint32_t>(named);
  out->sh_degree = sh_degree;
  *still_key = columns.still_key;
  return {};
}

Status widen(const Frame<float>& from, MemoryBudget& memory, Frame<double>* out) {
  L4D_RETURN_IF_ERROR(out->resize(from.count(), memory));
  out->sh_degree = from.sh_degree;
  const auto copy = [&](const auto& column, auto* to) {
    std::copy_n(column.begin(), from.count(), to->begin());
  };
  copy(from.id, &out->id);
  copy(from.sh, &out->sh);
  for (size_t k = 0; k < 3; ++k) copy(from.position[k], &out->position[k]);
  for (size_t k = 0; k < 6; ++k) copy(from.covariance[k], &out->covariance[k]);
  copy(from.opacity, &out->opacity);
  return {};
}

}  // namespace l4d::render
