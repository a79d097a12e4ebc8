// SPDX-License-Identifier: Apache-2.0
#include "training/step/loss.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace l4d::train {
namespace {

constexpr size_t kRadius = 5;
constexpr size_t kTaps = 2 * kRadius + 1;

template <typename T>
std::array<T, kTaps> window() {
  std::array<double, kTaps> taps{};
  double sum = 0;
  for (size_t k = 0; k < kTaps; ++k) {
    const double x = static_cast<double>(k) - static_cast<double>(kRadius);
    sum += taps[k] = std::exp(-x * x / (2 * 1.5 * 1.5));
  }
  std::array<T, kTaps> out{};
  for (size_t k = 0; k < kTaps; ++k) out[k] = static_cast<T>(taps[k] / sum);
  return out;
}

// Planes of one size with room for the zeros around them.
template <typename T>
class Blur {
 public:
  Blur(size_t width, size_t height)
      : width_(width), height_(height), row_(width + 2 * kRadius), rows_(width * height) {}

  // plane: [height, width], replaced by its convolution with the window.
  void operator()(T* plane) {
    for (size_t y = 0; y < height_; ++y) {
      std::copy_n(plane + y * width_, width_, row_.begin() + kRadius);
      T* out = &rows_[y * width_];
      std::fill_n(out, width_, T{0});
      for (size_t k = 0; k < kTaps; ++k) {
        const T tap = taps_[k];
        const T* in = &row_[k];
        for (size_t x = 0; x < width_; ++x) out[x] += tap * in[x];
      }
    }
    for (size_t y = 0; y < height_; ++y) {
      T* out = plane + y * width_;
      std::fill_n(out, width_, T{0});
      for (size_t k = 0; k < kTaps; ++k) {
        if (y + k < kRadius || y + k >= height_ + kRadius) continue;
        const T tap = taps_[k];
        const T* in = &rows_[(y + k - kRadius) * width_];
        for (size_t x = 0; x < width_; ++x) out[x] += tap * in[x];
      }
    }
  }

 private:
  size_t width_, height_;
  std::vector<T> row_, rows_;
  const std::array<T, kTaps> taps_ = window<T>();
};

template <typename T>
bool counts(const LossView<T>& view, size_t pixel) {
  return view.mask == nullptr || view.mask[pixel] != 0;
}

template <typename T>
T exposed(const LossView<T>& view, size_t pixel, size_t c) {
  const T* rgb = view.rendered + 3 * pixel;
  if (view.exposure == nullptr) return rgb[c];
  const T* e = view.exposure + 4 * c;
  return e[0] * rgb[0] + e[1] * rgb[1] + e[2] * rgb[2] + e[3];
}

template <typename T>
T captured(const LossView<T>& view, size_t pixel, size_t c) {
  const T value = static_cast<T>(view.target[3 * pixel + c]) / 255;
  if (view.alpha == nullptr) return value;
  const T alpha = static_cast<T>(view.alpha[pixel]) / 255;
  return alpha * value + (1 - alpha) * view.background[c];
}

template <typename T>
void read_planes(const LossView<T>& view, size_t c, T* x, T* y) {
  const size_t n = size_t{view.width} * view.height;
  for (size_t i = 0; i < n; ++i) {
    const bool counted = counts(view, i);
    x[i] = counted ? exposed(view, i, c) : 0;
    y[i] = counted ? captured(view, i, c) : 0;
  }
}

// From blurred x, y, xx, yy and xy to S, and to the factors of its derivative.
template <typename T>
struct Similarity {
  T s, a, b, c;
  Similarity(T mx, T my, T xx, T yy, T xy) {
    constexpr T c1 = static_cast<T>(0.01 * 0.01), c2 = static_cast<T>(0.03 * 0.03);
    const T A = mx * mx + my * my + c1;
    const T B = (xx - mx * mx) + (yy - my * my) + c2;
    const T C = 2 * mx * my + c1;
    const T D = 2 * (xy - mx * my) + c2;
    s = C * D / (A * B);
    a = 2 * my * (D - C) / (A * B) + 2 * mx * s * (1 / B - 1 / A);
    b = -s / B;
    c = 2 * C / (A * B);
  }
};

}  // namespace

template <typename T>
LossSums loss_forward(const LossView<T>& view, T* factors) {
  const size_t n = size_t{view.width} * view.height;
  Blur<T> blur(view.width, view.height);
  std::vector<T> planes(5 * n);
  T *x = planes.data(), *y = x + n, *xx = y + n, *yy = xx + n, *xy = yy + n;
  LossSums sums;
  for (size_t c = 0; c < 3; ++c) {
    read_planes(view, c, x, y);
    for (size_t row = 0; row < n; row += view.width) {
      T absolute = 0, squared = 0;
      for (size_t i = row; i < row + view.width; ++i) {
        const T d = x[i] - y[i];
        absolute += std::abs(d);
        squared += d * d;
        xx[i] = x[i] * x[i];
        yy[i] = y[i] * y[i];
        xy[i] = x[i] * y[i];
      }
      sums.absolute += static_cast<double>(absolute);
      sums.squared += static_cast<double>(squared);
    }
    for (T* plane : {x, y, xx, yy, xy}) blur(plane);
    T* out = factors + 3 * n * c;
    for (size_t row = 0; row < n; row += view.width) {
      T similarity = 0;
      for (size_t i = row; i < row + view.width; ++i) {
        const bool counted = counts(view, i);
        const Similarity<T> s(x[i], y[i], xx[i], yy[i], xy[i]);
        out[i] = counted ? s.a : 0;
        out[n + i] = counted ? s.b : 0;
        out[2 * n + i] = counted ? s.c : 0;
        similarity += counted ? s.s : 0;
        sums.values += counted ? 1 : 0;
      }
      sums.similarity += static_cast<double>(similarity);
    }
  }
  return sums;
}

template <typename T>
void loss_backward(const LossView<T>& view, const T* factors, const LossSums& sums, double weight,
                   T* rgb_gradient, double* exposure_gradient) {
  const size_t n = size_t{view.width} * view.height;
  std::fill_n(rgb_gradient, 3 * n, T{0});
  if (sums.values == 0) return;
  const double each = weight / static_cast<double>(sums.values);
  const T of_l1 = static_cast<T>(each) * (1 - view.ssim_weight);
  const T of_s = -static_cast<T>(each) * view.ssim_weight;
  Blur<T> blur(view.width, view.height);
  std::vector<T> planes(5 * n);
  T *x = planes.data(), *y = x + n, *a = y + n, *b = a + n, *g = b + n;
  for (size_t c = 0; c < 3; ++c) {
    read_planes(view, c, x, y);
    std::copy_n(factors + 3 * n * c, 3 * n, a);
    blur(a);
    blur(b);
    blur(g);
    const T* e = view.exposure == nullptr ? nullptr : view.exposure + 4 * c;
    std::array<double, 4> by_exposure{};
    for (size_t i = 0; i < n; ++i) {
      if (!counts(view, i)) continue;
      const T d = x[i] - y[i];
      const T sign = static_cast<T>((d > 0) - (d < 0));
      const T by_x = of_l1 * sign + of_s * (a[i] + 2 * x[i] * b[i] + y[i] * g[i]);
      T* out = rgb_gradient + 3 * i;
      if (e == nullptr) {
        out[c] += by_x;
        continue;
      }
      for (size_t k = 0; k < 3; ++k) {
        out[k] += e[k] * by_x;
        by_exposure[k] += static_cast<double>(by_x * view.rendered[3 * i + k]);
      }
      by_exposure[3] += static_cast<double>(by_x);
    }
    if (e == nullptr || exposure_gradient == nullptr) continue;
    for (size_t k = 0; k < 4; ++k) exposure_gradient[4 * c + k] += by_exposure[k];
  }
}

template LossSums loss_forward(const LossView<float>&, float*);
template LossSums loss_forward(const LossView<double>&, double*);
template void loss_backward(const LossView<float>&, const float*, const LossSums&, double, float*,
                            double*);
template void loss_backward(const LossView<double>&, const double*, const LossSums&, double,
                            double*, double*);

}  // namespace l4d::train
