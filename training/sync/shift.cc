// SPDX-License-Identifier: Apache-2.0
#include "training/sync/shift.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace l4d::train {
namespace {

constexpr uint32_t kWidth = 320;  // pixels that are enough
constexpr uint32_t kBlur = 6;     // pixels on either side: what is larger goes
constexpr uint32_t kLeastWidth = 40;
constexpr double kLeastOverlap = 0.25;

struct Grey {
  uint32_t width = 0, height = 0;
  std::vector<float> value, weight;  // 0: it does not count
};

// Averages of `step` x `step` pixels.
Grey reduced(const io::Image& image, const std::vector<uint8_t>& mask, uint32_t step) {
  Grey out;
  out.width = image.width / step;
  out.height = image.height / step;
  out.value.resize(size_t{out.width} * out.height);
  out.weight.assign(out.value.size(), 1);
  for (uint32_t y = 0; y < out.height; ++y) {
    for (uint32_t x = 0; x < out.width; ++x) {
      float sum = 0;
      const size_t to = size_t{y} * out.width + x;
      for (uint32_t k = 0; k < step * step; ++k) {
        const size_t from = size_t{y * step + k / step} * image.width + x * step + k % step;
        const float* rgb = &image.rgb[3 * from];
        sum += 0.299f * rgb[0] + 0.587f * rgb[1] + 0.114f * rgb[2];
        if (!mask.empty() && mask[from] == 0) out.weight[to] = 0;
      }
      out.value[to] = sum / static_cast<float>(step * step);
    }
  }
  return out;
}

// Sums along rows, or columns, of what is `kBlur` or less away.
std::vector<float> summed(const std::vector<float>& in, uint32_t n, uint32_t lines, size_t along,
                          size_t across) {
  std::vector<float> out(in.size());
  for (uint32_t line = 0; line < lines; ++line) {
    double sum = 0;
    const auto at = [&](uint32_t k) { return in[line * across + k * along]; };
    for (uint32_t k = 0; k < std::min(kBlur, n); ++k) sum += at(k);
    for (uint32_t k = 0; k < n; ++k) {
      if (k + kBlur < n) sum += at(k + kBlur);
      if (k > kBlur) sum -= at(k - kBlur - 1);
      out[line * across + k * along] = static_cast<float>(sum);
    }
  }
  return out;
}

// Less what is around each pixel.
void sharpen(Grey* image) {
  const auto blurred = [&](const std::vector<float>& in) {
    return summed(summed(in, image->width, image->height, 1, image->width), image->height,
                  image->width, image->width, 1);
  };
  std::vector<float> weighted(image->value);
  for (size_t i = 0; i < weighted.size(); ++i) weighted[i] *= image->weight[i];
  const std::vector<float> sums = blurred(weighted), weights = blurred(image->weight);
  for (size_t i = 0; i < weighted.size(); ++i) {
    if (weights[i] > 0.5f) image->value[i] -= sums[i] / weights[i];
  }
}

// Of the pixels that both have.
double correlation(const Grey& a, const Grey& b, int32_t dx, int32_t dy) {
  const auto width = static_cast<int32_t>(a.width), height = static_cast<int32_t>(a.height);
  double n = 0, sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0;
  for (int32_t y = std::max(0, dy); y < height + std::min(0, dy); ++y) {
    const size_t row = static_cast<size_t>(y) * a.width;
    const size_t other = static_cast<size_t>(y - dy) * a.width;
    for (int32_t x = std::max(0, dx); x < width + std::min(0, dx); ++x) {
      const size_t i = row + static_cast<size_t>(x), j = other + static_cast<size_t>(x - dx);
      const double w = a.weight[i], u = a.value[i], v = b.value[j];
      n += w;
      sa += w * u;
      sb += w * v;
      saa += w * u * u;
      sbb += w * v * v;
      sab += w * u * v;
    }
  }
  if (n < kLeastOverlap * width * height) return 0;
  const double va = saa - sa * sa / n, vb = sbb - sb * sb / n;
  const double product = va * vb;
  return product > 0 ? (sab - sa * sb / n) / std::sqrt(product) : 0;
}

// The top of the parabola through three points, from the middle one.
double top(double before, double here, double after) {
  const double bend = before - 2 * here + after;
  return bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
}

}  // namespace

Shift shift_between(const io::Image& first, const io::Image& second,
                    const std::vector<uint8_t>& mask, double reach) {
  Shift out;
  const uint32_t step = std::max(1U, first.width / kWidth);
  Grey a = reduced(first, mask, step), b = reduced(second, {}, step);
  const auto most = std::max(2, static_cast<int32_t>(std::ceil(reach / step)));
  if (a.width < kLeastWidth || a.height < 2) return out;
  sharpen(&a);
  sharpen(&b);
  int32_t x = 0, y = 0;
  out.correlation = out.unmoved = correlation(a, b, 0, 0);
  for (int32_t dy = -most; dy <= most; ++dy) {
    for (int32_t dx = -most; dx <= most; ++dx) {
      const double c = correlation(a, b, dx, dy);
      if (c <= out.correlation) continue;
      out.correlation = c;
      x = dx;
      y = dy;
    }
  }
  // What is best at the border of what was tried may be better beyond it, or is chance.
  if (std::max(std::abs(x), std::abs(y)) == most) {
    out.correlation = out.unmoved;
    return out;
  }
  const double dx = top(correlation(a, b, x - 1, y), out.correlation, correlation(a, b, x + 1, y));
  const double dy = top(correlation(a, b, x, y - 1), out.correlation, correlation(a, b, x, y + 1));
  out.x = step * (x + dx);
  out.y = step * (y + dy);
  return out;
}

}  // namespace l4d::train
