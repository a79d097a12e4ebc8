// SPDX-License-Identifier: Apache-2.0
#include "tests/render/judge.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

// An 8-bit step.
constexpr double kStep = 1.0 / 255;

}  // namespace

Judge::Judge(const Frame<float>& frame, const Frame<double>& reference, const l4d_camera& camera,
             bool fast_exponential)
    : reference_(reference), view_(make_view<double>(camera)), fast_exponential_(fast_exponential) {
  const View<float> view = make_view<float>(camera);
  const size_t n = frame.count();
  std::vector<FastSplat> projected(n + DepthSort::kPart);
  std::vector<size_t> counts;
  for (size_t i = 0; i < n; i += DepthSort::kPart) {
    counts.push_back(render_kernels().project(frame, view, i, std::min(n, i + DepthSort::kPart),
                                              projected.data() + i));
  }
  EXPECT_TRUE(DepthSort().sort(projected.data(), counts, 1, unlimited(), &splats_).ok());
  EXPECT_TRUE(bins_.start(splats_, view.width, view.height, 1, unlimited()).ok());
  EXPECT_TRUE(bins_.build(splats_, bins_.whole(), false, 1, unlimited()).ok());
  expected_.resize(n);
  in_view_.resize(n);
  for (size_t i = 0; i < n; ++i) {
    in_view_[i] = project(view_, reference, i, &expected_[i]);
    if (in_view_[i]) shade(view_, reference, i, &expected_[i]);
  }
}

double Judge::alpha_of(size_t row, int x, int y) const {
  if (!in_view_[row]) return 0;
  const Splat<double>& s = expected_[row];
  const double dx = x + 0.5 - s.mean[0], dy = y + 0.5 - s.mean[1];
  const double q = s.conic[0] * dx * dx + 2 * s.conic[1] * dx * dy + s.conic[2] * dy * dy;
  return std::min(s.opacity * std::exp(-q / 2), kMaxAlpha);
}

// What rounding to float may do to a depth.
double Judge::depth_error(size_t row) const {
  const double* r = view_.rotation + 6;
  double size = std::fabs(view_.translation[2]);
  for (size_t k = 0; k < 3; ++k) size += std::fabs(r[k] * reference_.position[k][row]);
  return size * 0x1p-23;
}

// Rows of the splats that the fast path blends into a pixel, in its order. The kernel tells by the
// colours: three splats at a time shine, each in a channel of its own.
std::vector<size_t> Judge::blended(int x, int y) const {
  const size_t columns = static_cast<size_t>(bins_.columns());
  const size_t number = static_cast<size_t>(y / kTile) * columns + static_cast<size_t>(x / kTile);
  const size_t count = bins_.count(number);
  std::vector<FastSplat> own(count);
  std::vector<uint32_t> list(count);
  for (size_t n = 0; n < count; ++n) {
    own[n] = splats_[bins_.list(number)[n]];
    std::fill_n(own[n].color, 3, 0.0f);
    list[n] = static_cast<uint32_t>(n);
  }
  TileInput tile;
  tile.splats = own.data();
  tile.list = list.data();
  tile.count = count;
  tile.x = x / kTile * kTile;
  tile.y = y / kTile * kTile;
  tile.width = std::min(kTile, view_.width - tile.x);
  tile.height = std::min(kTile, view_.height - tile.y);
  tile.max_alpha = static_cast<float>(view_.rules.max_alpha);
  const auto blend = fast_exponential_ ? render_kernels().blend_fast_exp : render_kernels().blend;
  const size_t pixel = static_cast<size_t>((y - tile.y) * kTile + x - tile.x);
  std::vector<size_t> rows;
  for (size_t n = 0; n < count; n += 3) {
    const size_t end = std::min(count, n + 3);
    for (size_t k = n; k < end; ++k) own[k].color[k - n] = 1;
    TileImage image;
    blend(tile, &image);
    for (size_t k = n; k < end; ++k) {
      if (image.rgb[k - n][pixel] > 0) rows.push_back(own[k].row);
      own[k].color[k - n] = 0;
    }
  }
  return rows;
}

Verdict Judge::judge(int x, int y, const float* rgb, double alpha_error) const {
  Verdict v;
  bool close = true;
  const std::vector<size_t> rows = blended(x, y);
  const auto decide = [&](double distance, double allowed, int* count, double* worst) {
    ++*count;
    *worst = std::max(*worst, distance);
    close = close && distance <= allowed;
  };

  // The reference's numbers by the fast path's decisions.
  double color[3] = {0, 0, 0}, transmittance = 1, stop_error = 1e-4;
  std::vector<bool> taken(expected_.size(), false);
  for (const size_t row : rows) {
    taken[row] = true;
    const double alpha = alpha_of(row, x, y);
    if (alpha < kMinAlpha) {
      decide(1 - alpha / kMinAlpha, 1e-4 + alpha_error, &v.skips, &v.skip_distance);
    }
    const double left = transmittance * (1 - alpha);
    stop_error += alpha_error * alpha / (1 - alpha);
    if (left < kMinTransmittance) {
      decide(1 - left / kMinTransmittance, stop_error, &v.stops, &v.stop_distance);
    }
    for (size_t c = 0; c < 3; ++c) {
      color[c] += transmittance * alpha * expected_[row].color[c];
    }
    transmittance = left;
  }
  for (size_t c = 0; c < 3; ++c) {
    v.left = std::max(v.left, std::fabs(color[c] - static_cast<double>(rgb[c])));
  }

  // Splats that the reference would have blended between these, or after the last.
  const auto nearer = [&](size_t a, size_t b) {
    const double da = expected_[a].depth, db = expected_[b].depth;
    return da != db ? da < db : a < b;
  };
  for (size_t n = 0; n + 1 < rows.size(); ++n) {
    for (size_t m = n + 1; m < rows.size(); ++m) {
      if (!nearer(rows[m], rows[n])) continue;
      const double apart = expected_[rows[n]].depth - expected_[rows[m]].depth;
      decide(apart / (depth_error(rows[n]) + depth_error(rows[m])), 1, &v.swaps, &v.swap_distance);
    }
  }
  const size_t none = expected_.size();
  size_t next = none;  // the first one behind
  for (size_t row = 0; row < expected_.size(); ++row) {
    if (taken[row] || !in_view_[row]) continue;
    const double alpha = alpha_of(row, x, y);
    if (alpha < kMinAlpha) continue;
    if (rows.empty() || nearer(rows.back(), row)) {
      if (alpha > kMinAlpha * (1 + 1e-4) && (next == none || nearer(row, next))) next = row;
    } else {
      decide(alpha / kMinAlpha - 1, 1e-4 + alpha_error, &v.skips, &v.skip_distance);
    }
  }
  if (next != none) {
    const double alpha = alpha_of(next, x, y), left = transmittance * (1 - alpha);
    stop_error += alpha_error * alpha / (1 - alpha);
    if (left >= kMinTransmittance) {
      decide(left / kMinTransmittance - 1, stop_error, &v.stops, &v.stop_distance);
    }
  }
  v.explained = close && v.left <= kStep && v.stops + v.swaps + v.skips > 0;
  return v;
}

}  // namespace l4d::render
