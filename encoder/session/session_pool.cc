// SPDX-License-Identifier: Apache-2.0
#include "encoder/session/session_pool.h"

#include <algorithm>
#include <cmath>

#include "encoder/prepare/estimates.h"
#include "encoder/session/known_gaussians.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d {
namespace {

// Below this opacity nothing of a Gaussian is drawn (l4d_rendering.min_alpha).
constexpr double kLeastOpacity = 1.0 / 255;
// Importances of what is seen for an instant only are guesses.
constexpr double kMaxExposure = 1e3;

template <typename T>
void append_rows(const std::vector<uint32_t>& from, size_t dim, const T* values,
                 std::vector<T>* out) {
  out->reserve(out->size() + dim * from.size());  // and no more, which nobody would count
  for (const uint32_t i : from) {
    out->insert(out->end(), values + dim * i, values + dim * (size_t{i} + 1));
  }
}

// When an opacity that falls off from `peak` is at least that.
Sequence shown_times(double mean, double lambda, double peak) {
  if (peak < kLeastOpacity) return {mean, mean};
  const double sigmas = std::min(kVisibleSigmas, std::sqrt(2 * std::log(peak / kLeastOpacity)));
  const double reach = sigmas / std::sqrt(lambda);
  return {mean - reach, mean + reach};
}

}  // namespace

uint64_t SessionPool::bytes_of(const EncoderInput& input, size_t count) const {
  uint64_t numbers = numbers_per_gaussian(input.gaussians.sh_degree);
  for (const float* weights : input.importance.weights) numbers += weights != nullptr ? 1 : 0;
  numbers += input.importance.min_sizes != nullptr ? 1 : 0;
  if (input.stated_opacity != nullptr || !stated_opacity_.empty()) ++numbers;
  return uint64_t{count} * (numbers * sizeof(float) + sizeof(PooledGaussian));
}

Status SessionPool::add(const EncoderInput& input, const EncoderScene& prepared, bool lossless) {
  const l4d_gaussians& g = input.gaussians;
  const size_t before = rows_.size();
  const bool first = before == 0 && arrays_.count() == 0;
  if (first) {
    arrays_ = AttributeArrays();
    arrays_.sh_degree = g.sh_degree;
    arrays_.flags = g.flags;
  } else if (arrays_.sh_degree != g.sh_degree || arrays_.flags != g.flags) {
    return invalid_argument("a piece has another SH degree or other flags than those before");
  }
  for (size_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
    if (!first && weights_[k].empty() != (input.importance.weights[k] == nullptr)) {
      return invalid_argument("a piece has other weights than those before");
    }
  }
  if (!first && metric_ != input.importance.metric) {
    return invalid_argument("a piece has weights of another metric than those before");
  }
  metric_ = input.importance.metric;
  if (!first && min_sizes_.empty() != (input.importance.min_sizes == nullptr)) {
    return invalid_argument("only some pieces have minimum sizes");
  }
  const std::vector<uint32_t>& from = prepared.source;
  for_each_attribute(
      [&](const AttributeInfo& a, std::vector<float>& to, const float* values) {
        if (values != nullptr) append_rows(from, a.numbers(g.sh_degree), values, &to);
      },
      arrays_, g);
  has_double_times_ = has_double_times_ || g.mean_t_double != nullptr;
  arrays_.mean_t.resize(arrays_.opacity.size());
  has_windows_ = has_windows_ || !prepared.window.empty();
  for (size_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
    if (input.importance.weights[k] != nullptr)
      append_rows(from, 1, input.importance.weights[k], &weights_[k]);
  }
  if (input.importance.min_sizes != nullptr)
    append_rows(from, 1, input.importance.min_sizes, &min_sizes_);
  if (input.stated_opacity != nullptr || !stated_opacity_.empty()) {
    // Those of pieces that were not fitted are their own.
    if (stated_opacity_.empty()) {
      stated_opacity_.assign(arrays_.opacity.begin(), arrays_.opacity.begin() + ptrdiff_t(before));
    }
    append_rows(from, 1, input.stated_opacity != nullptr ? input.stated_opacity : g.opacity,
                &stated_opacity_);
  }

  const std::vector<double> share = lossless ? std::vector<double>(prepared.count, 0)
                                             : estimated_shares(prepared, &sum_of_estimates_);
  const Sequence piece = sequence_of(input.timeline);
  const bool at_mean = (g.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
  rows_.reserve(before + prepared.count);
  for (size_t i = 0; i < prepared.count; ++i) {
    PooledGaussian row{};
    row.mean = mean_time(g, from[i]);
    row.reference = at_mean ? row.mean : reference_time(input.timeline, row.mean);
    std::copy_n(prepared.velocity.data() + 3 * i, 3, row.velocity);
    const double peak =
        linear_opacity(static_cast<double>(g.opacity[from[i]]), (g.flags & L4D_OPACITY_LOGIT) != 0);
    if (prepared.is_flat(i)) {
      const FrameWindow w = prepared.window[i];
      row.shown = {time_of_frame(input.timeline, w.begin), time_of_frame(input.timeline, w.end)};
      if (peak < kLeastOpacity) row.shown.end = row.shown.begin;
    } else {
      row.lambda = prepared.lambda[i];
      row.shown = shown_times(row.mean, row.lambda, peak);
    }
    row.exposure = row.shown_between(piece.begin, piece.end) / (piece.end - piece.begin);
    row.share = share[i];
    row.standing = PooledGaussian::kNoStanding;
    rows_.push_back(row);
  }
  drop_known(before);
  return {};
}

void SessionPool::drop_known(size_t before) {
  const std::vector<char> mask = without_known(arrays_, rows_, before);
  if (std::find(mask.begin(), mask.end(), 0) != mask.end()) keep(mask);
}

void SessionPool::keep(const std::vector<char>& mask) {
  arrays_.keep(mask);
  keep_rows(mask, 1, &rows_);
  for (std::vector<float>& w : weights_) keep_rows(mask, 1, &w);
  keep_rows(mask, 1, &min_sizes_);
  keep_rows(mask, 1, &stated_opacity_);
}

SessionScene::SessionScene(const SessionPool& pool, const std::vector<uint32_t>& rows,
                           const l4d_timeline& timeline, double price_seconds)
    : timeline_(timeline), metric_(pool.metric_) {
  const AttributeArrays& all = pool.arrays_;
  arrays_.sh_degree = all.sh_degree;
  arrays_.flags = all.flags;
  for_each_attribute(
      [&](const AttributeInfo& a, std::vector<float>& to, const std::vector<float>& values) {
        append_rows(rows, a.numbers(all.sh_degree), values.data(), &to);
      },
      arrays_, all);
  for (size_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
    if (!pool.weights_[k].empty()) append_rows(rows, 1, pool.weights_[k].data(), &weights_[k]);
  }
  if (!pool.min_sizes_.empty()) append_rows(rows, 1, pool.min_sizes_.data(), &min_sizes_);
  if (!pool.stated_opacity_.empty()) {
    append_rows(rows, 1, pool.stated_opacity_.data(), &stated_opacity_);
  }
  const Sequence span = sequence_of(timeline);
  const double fps = static_cast<double>(timeline.fps_num) / timeline.fps_den;
  const bool at_mean = (arrays_.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
  const auto frame_at = [&](double seconds) {
    const double frame = std::round((seconds - span.begin) * fps);
    return static_cast<uint32_t>(std::clamp(frame, 0.0, static_cast<double>(timeline.num_frames)));
  };
  for (size_t n = 0; n < rows.size(); ++n) {
    const PooledGaussian& row = pool.rows_[rows[n]];
    arrays_.mean_t[n] = static_cast<float>(row.mean);
    if (pool.has_double_times_) arrays_.mean_t_double.push_back(row.mean);
    if (pool.has_windows_) {
      const bool flat = row.lambda == 0;
      arrays_.window.push_back(flat ? frame_at(row.shown.begin) : 0);
      arrays_.window.push_back(flat ? frame_at(row.shown.end) : 0);
    }
    const double moved = at_mean ? 0 : reference_time(timeline, row.mean) - row.reference;
    for (size_t k = 0; moved != 0 && k < 3; ++k) {
      float& x = arrays_.position[3 * n + k];
      x = static_cast<float>(static_cast<double>(x) + row.velocity[k] * moved);
    }
    const double shown = std::min(row.shown_between(span.begin, span.end), price_seconds);
    const double exposure = row.exposure > 0 ? shown / price_seconds / row.exposure : 1.0;
    exposure_.push_back(static_cast<float>(std::clamp(exposure, 1 / kMaxExposure, kMaxExposure)));
    share_.push_back(row.share);
  }
}

EncoderInput SessionScene::input(const EncoderInput& like) const {
  EncoderInput in;
  in.gaussians = arrays_.view();
  in.timeline = timeline_;
  in.placement = like.placement;
  in.rendering = like.rendering;
  in.presentation = like.presentation;
  in.importance.count = in.gaussians.count;
  in.importance.metric = metric_;
  for (size_t k = 0; k < L4D_WEIGHT_COUNT; ++k) {
    if (!weights_[k].empty()) in.importance.weights[k] = weights_[k].data();
  }
  if (!min_sizes_.empty()) in.importance.min_sizes = min_sizes_.data();
  if (!stated_opacity_.empty()) in.stated_opacity = stated_opacity_.data();
  in.exposure = exposure_.data();
  in.share = share_.data();
  return in;
}

}  // namespace l4d
