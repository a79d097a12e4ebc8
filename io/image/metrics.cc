// SPDX-License-Identifier: Apache-2.0
#include "io/image/metrics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "libl4dcodec/base/threads.h"

namespace l4d::io {
namespace {

constexpr size_t kRadius = 5;
constexpr size_t kTaps = 2 * kRadius + 1;
constexpr float kC1 = 0.01F * 0.01F;
constexpr float kC2 = 0.03F * 0.03F;
// SSIM needs of the second moments only their sum, so there are four maps to filter, not five.
constexpr size_t kMaps = 4;  // a, b, a^2 + b^2, ab
// Taken off all values: the nearer to 0 they are, the less do variances lose as differences of
// floats.
constexpr float kShift = 0.5F;
// Rows of the result that are computed together. A fixed number, so that sums do not depend on the
// number of threads.
constexpr size_t kStripRows = 64;

void check_sizes(const Image& a, const Image& b, const std::vector<uint8_t>& mask) {
  if (!a.same_size(b)) throw Error(L4D_ERR_INVALID_ARGUMENT, "the images differ in size");
  if (!mask.empty() && 3 * mask.size() != a.rgb.size()) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "the mask has another size than the images");
  }
  if (a.rgb.empty()) throw Error(L4D_ERR_INVALID_ARGUMENT, "the images are empty");
}

float clamped(float value) {
  const float low = value > 0 ? value : 0;  // false for NaN
  return low < 1 ? low : 1;
}

// Half of the symmetric window, from its middle outwards.
std::array<float, kRadius + 1> window() {
  std::array<double, kRadius + 1> values{};
  double sum = 0;
  for (size_t k = 0; k <= kRadius; ++k) {
    const double distance = static_cast<double>(k) / 1.5;
    values[k] = std::exp(-0.5 * distance * distance);
    sum += (k == 0 ? 1 : 2) * values[k];
  }
  std::array<float, kRadius + 1> weights{};
  for (size_t k = 0; k <= kRadius; ++k) weights[k] = static_cast<float>(values[k] / sum);
  return weights;
}

// The filtered maps of a strip of rows, kept for as many rows as the window is high.
class SsimStrip {
 public:
  SsimStrip(const Image& a, const Image& b, const std::vector<uint8_t>& mask)
      : a_(a),
        b_(b),
        mask_(mask),
        in_values_(size_t{3} * a.width),
        out_values_(in_values_ - 3 * 2 * kRadius) {
    moments_.resize(kMaps * in_values_);
    ring_.resize(kMaps * kTaps * out_values_);
    filtered_.resize(kMaps * out_values_);
    similarity_.resize(out_values_);
  }

  // Sum over rows [first, end) of the result, and how many values count.
  std::pair<double, size_t> sum(size_t first, size_t end) {
    std::pair<double, size_t> total{};
    for (size_t y = first; y < first + 2 * kRadius; ++y) filter_along_row(y);
    for (size_t y = first; y < end; ++y) {
      filter_along_row(y + 2 * kRadius);
      for (size_t map = 0; map < kMaps; ++map) filter_across_rows(map, y);
      add_row(y, &total);
    }
    return total;
  }

 private:
  float* ring_row(size_t map, size_t y) { return &ring_[(map * kTaps + y % kTaps) * out_values_]; }

  void filter_along_row(size_t y) {
    const float* a = &a_.rgb[y * in_values_];
    const float* b = &b_.rgb[y * in_values_];
    float* m0 = moments_.data();
    float* m1 = m0 + in_values_;
    float* m2 = m1 + in_values_;
    float* m3 = m2 + in_values_;
    for (size_t i = 0; i < in_values_; ++i) {
      const float va = clamped(a[i]) - kShift;
      const float vb = clamped(b[i]) - kShift;
      m0[i] = va;
      m1[i] = vb;
      m2[i] = va * va + vb * vb;
      m3[i] = va * vb;
    }
    const std::array<float, kRadius + 1> w = weights_;
    for (size_t map = 0; map < kMaps; ++map) {
      const float* in = moments_.data() + map * in_values_ + 3 * kRadius;
      float* out = ring_row(map, y);
      for (size_t i = 0; i < out_values_; ++i) {
        const float* at = in + i;
        out[i] = w[0] * at[0] + w[1] * (at[3] + at[-3]) + w[2] * (at[6] + at[-6]) +
                 w[3] * (at[9] + at[-9]) + w[4] * (at[12] + at[-12]) + w[5] * (at[15] + at[-15]);
      }
    }
  }

  void filter_across_rows(size_t map, size_t first) {
    const float* rows[kTaps];
    for (size_t k = 0; k < kTaps; ++k) rows[k] = ring_row(map, first + k);
    const std::array<float, kRadius + 1> w = weights_;
    float* out = &filtered_[map * out_values_];
    for (size_t i = 0; i < out_values_; ++i) {
      out[i] = w[0] * rows[5][i] + w[1] * (rows[4][i] + rows[6][i]) +
               w[2] * (rows[3][i] + rows[7][i]) + w[3] * (rows[2][i] + rows[8][i]) +
               w[4] * (rows[1][i] + rows[9][i]) + w[5] * (rows[0][i] + rows[10][i]);
    }
  }

  void add_row(size_t y, std::pair<double, size_t>* total) {
    const float* mean_a = filtered_.data();
    const float* mean_b = mean_a + out_values_;
    const float* squares = mean_b + out_values_;
    const float* product = squares + out_values_;
    for (size_t i = 0; i < out_values_; ++i) {
      const float a = mean_a[i], b = mean_b[i];
      const float covariance = product[i] - a * b;
      const float variances = squares[i] - (a * a + b * b);
      const float full_a = a + kShift, full_b = b + kShift;
      similarity_[i] = (2 * full_a * full_b + kC1) * (2 * covariance + kC2) /
                       ((full_a * full_a + full_b * full_b + kC1) * (variances + kC2));
    }
    double sum = 0;
    const uint8_t* counts = mask_.empty() ? nullptr : &mask_[(y + kRadius) * a_.width + kRadius];
    for (size_t i = 0; i < out_values_; ++i) {
      if (counts != nullptr && counts[i / 3] == 0) continue;
      sum += static_cast<double>(similarity_[i]);
      ++total->second;
    }
    total->first += sum;
  }

  const Image& a_;
  const Image& b_;
  const std::vector<uint8_t>& mask_;
  const std::array<float, kRadius + 1> weights_ = window();
  size_t in_values_, out_values_;  // of a row, all channels
  std::vector<float> moments_, ring_, filtered_, similarity_;
};

}  // namespace

std::vector<uint8_t> mask_of(const Image& image) {
  std::vector<uint8_t> mask(image.rgb.size() / 3);
  for (size_t i = 0; i < mask.size(); ++i) {
    const float* at = &image.rgb[3 * i];
    mask[i] = at[0] + at[1] + at[2] < 1.5F ? 0 : 255;
  }
  return mask;
}

Image masked(Image image, const std::vector<uint8_t>& mask) {
  for (size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] == 0) std::fill_n(&image.rgb[3 * i], 3, 0.0F);
  }
  return image;
}

double mse(const Image& a, const Image& b, const std::vector<uint8_t>& mask) {
  check_sizes(a, b, mask);
  double sum = 0;
  size_t values = 0;
  const size_t row_values = size_t{3} * a.width;
  for (size_t first = 0; first < a.rgb.size(); first += row_values) {
    double row = 0;
    for (size_t i = first; i < first + row_values; ++i) {
      if (!mask.empty() && mask[i / 3] == 0) continue;
      const double d = static_cast<double>(clamped(a.rgb[i]) - clamped(b.rgb[i]));
      row += d * d;
      ++values;
    }
    sum += row;
  }
  return sum / static_cast<double>(values);
}

double psnr_of_mse(double mse) { return -10 * std::log10(mse); }

double ssim(const Image& a, const Image& b, uint32_t threads, const std::vector<uint8_t>& mask) {
  check_sizes(a, b, mask);
  if (a.width < kTaps || a.height < kTaps) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "SSIM needs images of at least 11 x 11 pixels");
  }
  const size_t rows = a.height - 2 * kRadius;
  std::vector<std::pair<double, size_t>> sums((rows + kStripRows - 1) / kStripRows);
  // A grain of one strip each; a strip's sum does not depend on who works it out.
  parallel_for(static_cast<int>(threads), sums.size(), 1, [&](size_t begin, size_t end) {
    SsimStrip worker(a, b, mask);
    for (size_t strip = begin; strip < end; ++strip) {
      const size_t first = strip * kStripRows;
      sums[strip] = worker.sum(first, std::min(first + kStripRows, rows));
    }
  });
  double total = 0;
  size_t values = 0;
  for (const auto& [sum, count] : sums) {
    total += sum;
    values += count;
  }
  return total / static_cast<double>(values);
}

void FidelityAccumulator::add(double mse, double ssim) {
  ++views_;
  mse_sum_ += mse;
  mse_max_ = std::max(mse_max_, mse);
  psnr_sum_ += psnr_of_mse(mse);
  ssim_sum_ += ssim;
}

Fidelity FidelityAccumulator::result() const {
  Fidelity fidelity;
  fidelity.views = views_;
  if (views_ == 0) {
    fidelity.psnr = fidelity.min_psnr = fidelity.mean_psnr = fidelity.mean_ssim =
        std::numeric_limits<double>::quiet_NaN();
    return fidelity;
  }
  const double count = static_cast<double>(views_);
  fidelity.psnr = psnr_of_mse(mse_sum_ / count);
  fidelity.min_psnr = psnr_of_mse(mse_max_);
  fidelity.mean_psnr = psnr_sum_ / count;
  fidelity.mean_ssim = ssim_sum_ / count;
  return fidelity;
}

}  // namespace l4d::io
