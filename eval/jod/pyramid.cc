// SPDX-License-Identifier: Apache-2.0
#include "eval/jod/pyramid.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/base/threads.h"

namespace l4d::eval {
namespace {

constexpr float kKernel[5] = {0.05F, 0.25F, 0.4F, 0.25F, 0.05F};
constexpr uint32_t kRows = 16;  // of a piece of work

// One value of a row or column of n values that is halved. is_odd: which border the end has.
template <typename At>
float halved(const At& at, uint32_t n, uint32_t i, bool is_odd) {
  float sum = 0;
  for (uint32_t j = 0; j < 5; ++j) {
    const int64_t k = int64_t{2} * i - 2 + j;
    if (k >= 0 && k < int64_t{n}) sum += kKernel[j] * at(static_cast<uint32_t>(k));
  }
  if (i == 0) sum += kKernel[1] * at(0) + kKernel[0] * at(1);
  if (i == (n + 1) / 2 - 1) {
    sum += is_odd ? kKernel[3] * at(n - 1) + kKernel[4] * at(n - 2) : kKernel[4] * at(n - 1);
  }
  return sum;
}

// Value i of n that lie between those of half as many.
template <typename At>
float between(const At& at, uint32_t half, uint32_t i) {
  const uint32_t k = i / 2, next = std::min(k + 1, half - 1);
  if (i % 2 == 1) return 0.5F * at(k) + 0.5F * at(next);
  return 0.1F * at(k == 0 ? 0 : k - 1) + 0.8F * at(k) + 0.1F * at(next);
}

template <typename Body>
void for_rows(uint32_t rows, uint32_t threads, const Body& body) {
  parallel_for(static_cast<int>(threads), rows, kRows, [&](size_t begin, size_t end) {
    for (size_t y = begin; y < end; ++y) body(static_cast<uint32_t>(y));
  });
}

}  // namespace

Plane reduce(const Plane& in, uint32_t threads) {
  const bool is_odd = in.height % 2 == 1;
  Plane tall(in.width, (in.height + 1) / 2);
  for_rows(tall.height, threads, [&](uint32_t y) {
    float* out = tall.row(y);
    for (uint32_t x = 0; x < in.width; ++x) {
      out[x] = halved([&](uint32_t k) { return in.row(k)[x]; }, in.height, y, is_odd);
    }
  });
  Plane small((in.width + 1) / 2, tall.height);
  for_rows(small.height, threads, [&](uint32_t y) {
    const float* row = tall.row(y);
    float* out = small.row(y);
    for (uint32_t x = 0; x < small.width; ++x) {
      // The border of columns follows the height, as in the program whose figures are compared.
      out[x] = halved([&](uint32_t k) { return row[k]; }, in.width, x, is_odd);
    }
  });
  return small;
}

Plane expand(const Plane& in, uint32_t width, uint32_t height, uint32_t threads) {
  Plane out(width, height);
  parallel_for(static_cast<int>(threads), height, kRows, [&](size_t begin, size_t end) {
    std::vector<float> row(in.width);
    for (size_t k = begin; k < end; ++k) {
      const auto y = static_cast<uint32_t>(k);
      for (uint32_t x = 0; x < in.width; ++x) {
        row[x] = between([&](uint32_t from) { return in.row(from)[x]; }, in.height, y);
      }
      float* to = out.row(y);
      for (uint32_t x = 0; x < width; ++x) {
        to[x] = between([&](uint32_t from) { return row[from]; }, in.width, x);
      }
    }
  });
  return out;
}

void blur(Plane* plane, uint32_t threads) {
  constexpr uint32_t kRadius = 6;
  if (plane->width <= kRadius || plane->height <= kRadius) return;
  float taps[kRadius + 1];
  double sum = 0, values[kRadius + 1];
  for (uint32_t k = 0; k <= kRadius; ++k) {
    values[k] = std::exp(-static_cast<double>(k * k) / 18);
    sum += k == 0 ? values[k] : 2 * values[k];
  }
  for (uint32_t k = 0; k <= kRadius; ++k) taps[k] = static_cast<float>(values[k] / sum);
  const auto mirrored = [](int64_t k, uint32_t n) {
    if (k < 0) k = -k;
    if (k >= int64_t{n}) k = 2 * int64_t{n} - 2 - k;
    return static_cast<uint32_t>(k);
  };
  Plane along(plane->width, plane->height);
  for_rows(plane->height, threads, [&](uint32_t y) {
    const float* row = plane->row(y);
    float* out = along.row(y);
    for (uint32_t x = 0; x < plane->width; ++x) {
      float total = taps[0] * row[x];
      for (uint32_t k = 1; k <= kRadius; ++k) {
        total += taps[k] * (row[mirrored(int64_t{x} - k, plane->width)] +
                            row[mirrored(int64_t{x} + k, plane->width)]);
      }
      out[x] = total;
    }
  });
  for_rows(plane->height, threads, [&](uint32_t y) {
    float* out = plane->row(y);
    const float* middle = along.row(y);
    for (uint32_t x = 0; x < plane->width; ++x) out[x] = taps[0] * middle[x];
    for (uint32_t k = 1; k <= kRadius; ++k) {
      const float* above = along.row(mirrored(int64_t{y} - k, plane->height));
      const float* below = along.row(mirrored(int64_t{y} + k, plane->height));
      for (uint32_t x = 0; x < plane->width; ++x) out[x] += taps[k] * (above[x] + below[x]);
    }
  });
}

std::vector<double> band_frequencies(uint32_t width, uint32_t height, double pixels_per_degree) {
  constexpr double kLeast = 0.2, kBase = 0.1;
  std::vector<double> bands = {pixels_per_degree / 2};
  for (size_t i = 1; bands.back() > kLeast; ++i) {
    bands.push_back(0.3228 * std::exp2(1 - static_cast<double>(i)) * pixels_per_degree / 2);
  }
  size_t levels = 0;
  for (uint32_t side = std::min(width, height); side > 1; side /= 2) ++levels;
  bands.resize(std::min(bands.size(), levels - 1));
  bands.push_back(kBase);
  return bands;
}

}  // namespace l4d::eval
