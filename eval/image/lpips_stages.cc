// SPDX-License-Identifier: Apache-2.0
// The threads are those of parallel_for: the library would divide work by their number.
#define EIGEN_DONT_PARALLELIZE

#include "eval/image/lpips_stages.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "libl4dcodec/base/threads.h"

namespace l4d::eval {
namespace {

// Channels of a result that one piece of work computes. A fixed number, so that sums do not depend
// on the number of threads.
constexpr size_t kPieceChannels = 32;
constexpr double kEpsilon = 1e-10;  // of lengths, as LPIPS defines it

using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Index index_of(size_t n) { return static_cast<Eigen::Index>(n); }

}  // namespace

size_t window_positions(size_t length, size_t side, size_t stride, size_t padding) {
  const size_t padded = length + 2 * padding;
  return length == 0 || padded < side ? 0 : (padded - side) / stride + 1;
}

FilterStage::FilterStage(const MapShape& in, size_t channels, const Window& window, RowSink sink)
    : in_(in),
      window_(window),
      out_{channels, window_positions(in.width, window.side, window.stride, window.padding),
           window_positions(in.height, window.side, window.stride, window.padding)},
      sink_(std::move(sink)),
      padded_width_(in.width + 2 * window.padding),
      ring_(window.side * 2 * in.channels * padded_width_),
      row_(2 * channels * out_.width) {}

size_t FilterStage::ring_index(size_t image, size_t channel, size_t y) const {
  return ((y % window_.side * 2 + image) * in_.channels + channel) * padded_width_;
}

const float* FilterStage::line(size_t image, size_t channel, size_t y, size_t line) const {
  const size_t padded_y = y * window_.stride + line;
  if (padded_y < window_.padding || padded_y >= in_.height + window_.padding) return nullptr;
  return &ring_[ring_index(image, channel, padded_y - window_.padding)];
}

void FilterStage::push(const float* row) {
  for (size_t image = 0; image < 2; ++image) {
    for (size_t channel = 0; channel < in_.channels; ++channel) {
      std::copy_n(row + (image * in_.channels + channel) * in_.width, in_.width,
                  &ring_[ring_index(image, channel, rows_in_) + window_.padding]);
    }
  }
  ++rows_in_;
  // The rows below the last one are padding, which nobody pushes.
  const size_t there = rows_in_ + window_.padding + (rows_in_ == in_.height ? window_.padding : 0);
  for (; rows_out_ < out_.height && rows_out_ * window_.stride + window_.side <= there;
       ++rows_out_) {
    make_row(rows_out_, row_.data());
    sink_(row_.data());
  }
}

ConvolutionStage::ConvolutionStage(const MapShape& in, size_t channels, const Window& window,
                                   const std::vector<float>& weights,
                                   const std::vector<float>& bias, uint32_t threads, RowSink sink)
    : FilterStage(in, channels, window, std::move(sink)),
      weights_(weights),
      bias_(bias),
      threads_(static_cast<int>(threads)),
      taps_(in.channels * window.side * window.side),
      columns_(2 * taps_ * out().width) {}

void ConvolutionStage::gather(size_t image, size_t channel, size_t y) {
  const size_t side = window_.side, stride = window_.stride, width = out().width;
  float* to = &columns_[(image * taps_ + channel * side * side) * width];
  for (size_t ky = 0; ky < side; ++ky) {
    const float* from = line(image, channel, y, ky);
    for (size_t kx = 0; kx < side; ++kx, to += width) {
      if (from == nullptr) {
        std::fill_n(to, width, 0.0f);
      } else if (stride == 1) {
        std::copy_n(from + kx, width, to);
      } else {
        for (size_t x = 0; x < width; ++x) to[x] = from[x * stride + kx];
      }
    }
  }
}

void ConvolutionStage::multiply(size_t image, size_t first, size_t end, float* row) const {
  const size_t width = out().width, count = end - first;
  const Eigen::Map<const Matrix> weights(&weights_[first * taps_], index_of(count),
                                         index_of(taps_));
  const Eigen::Map<const Matrix> columns(&columns_[image * taps_ * width], index_of(taps_),
                                         index_of(width));
  float* to = row + (image * out().channels + first) * width;
  Eigen::Map<Matrix>(to, index_of(count), index_of(width)).noalias() = weights * columns;
  for (size_t c = first; c < end; ++c) {
    for (size_t x = 0; x < width; ++x, ++to) *to = std::max(*to + bias_[c], 0.0f);
  }
}

void ConvolutionStage::make_row(size_t y, float* row) {
  parallel_for(threads_, 2 * in_.channels, 8, [&](size_t begin, size_t end) {
    for (size_t k = begin; k < end; ++k) gather(k / in_.channels, k % in_.channels, y);
  });
  const size_t channels = out().channels;
  const size_t pieces = (channels + kPieceChannels - 1) / kPieceChannels;
  parallel_for(threads_, 2 * pieces, 1, [&](size_t begin, size_t end) {
    for (size_t k = begin; k < end; ++k) {
      const size_t first = k % pieces * kPieceChannels;
      multiply(k / pieces, first, std::min(first + kPieceChannels, channels), row);
    }
  });
}

void MaxPoolStage::make_row(size_t y, float* row) {
  const size_t width = out().width;
  for (size_t k = 0; k < 2 * in_.channels; ++k, row += width) {
    for (size_t ky = 0; ky < window_.side; ++ky) {
      const float* from = line(k / in_.channels, k % in_.channels, y, ky);
      for (size_t x = 0; x < width; ++x) {
        const float* at = from + x * window_.stride;
        const float largest = *std::max_element(at, at + window_.side);
        row[x] = ky == 0 ? largest : std::max(row[x], largest);
      }
    }
  }
}

void FeatureDistance::add(const float* row) {
  const size_t width = shape_.width, image = shape_.channels * width;
  std::fill(lengths_.begin(), lengths_.end(), 0.0);
  for (size_t c = 0; c < shape_.channels; ++c) {
    for (size_t x = 0; x < width; ++x) {
      const double a = row[c * width + x], b = row[image + c * width + x];
      lengths_[x] += a * a;
      lengths_[width + x] += b * b;
    }
  }
  for (double& length : lengths_) length = std::sqrt(length) + kEpsilon;
  double sum = 0;
  for (size_t c = 0; c < shape_.channels; ++c) {
    double of_channel = 0;
    for (size_t x = 0; x < width; ++x) {
      const double d =
          row[c * width + x] / lengths_[x] - row[image + c * width + x] / lengths_[width + x];
      of_channel += d * d;
    }
    sum += of_channel * static_cast<double>(weights_[c]);
  }
  sum_ += sum;
}

}  // namespace l4d::eval
