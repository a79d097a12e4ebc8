// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

// The stages of a network whose features LPIPS compares. Two images go through them at the same
// time, row by row, so that a stage keeps as many rows as its window is high, whatever the height
// of the images. A row of both images is float [2, channels, width].
namespace l4d::eval {

struct MapShape {
  size_t channels = 0, width = 0, height = 0;
};

// Positions of a window of `side` in `length` pixels, with `padding` at both ends.
size_t window_positions(size_t length, size_t side, size_t stride, size_t padding);

using RowSink = std::function<void(const float* row)>;

// Gets the rows of a map from top to bottom, and passes each row of its own map on to `sink` once
// it has the rows for it.
class FilterStage {
 public:
  struct Window {
    size_t side = 1, stride = 1, padding = 0;
  };

  FilterStage(const MapShape& in, size_t channels, const Window& window, RowSink sink);
  virtual ~FilterStage() = default;
  FilterStage(const FilterStage&) = delete;
  FilterStage& operator=(const FilterStage&) = delete;

  const MapShape& out() const { return out_; }
  void push(const float* row);

 protected:
  // Makes row `y` of the result: [2, out().channels, out().width].
  virtual void make_row(size_t y, float* row) = 0;
  // Returns the values of line `line` of the window for row `y` of the result, from the first
  // column of the padding on; nullptr if the line is in the padding.
  const float* line(size_t image, size_t channel, size_t y, size_t line) const;

  const MapShape in_;
  const Window window_;

 private:
  size_t ring_index(size_t image, size_t channel, size_t y) const;

  MapShape out_;
  RowSink sink_;
  size_t padded_width_;
  std::vector<float> ring_;  // [side, 2, channels, padded width]
  std::vector<float> row_;
  size_t rows_in_ = 0, rows_out_ = 0;
};

// A convolution with a bias, then ReLU. What it makes is the same for any number of threads.
class ConvolutionStage final : public FilterStage {
 public:
  // weights: [channels, in.channels, side, side]; bias: [channels]. The stage keeps references.
  ConvolutionStage(const MapShape& in, size_t channels, const Window& window,
                   const std::vector<float>& weights, const std::vector<float>& bias,
                   uint32_t threads, RowSink sink);

 private:
  void make_row(size_t y, float* row) override;
  void gather(size_t image, size_t channel, size_t y);
  void multiply(size_t image, size_t first, size_t end, float* row) const;

  const std::vector<float>& weights_;
  const std::vector<float>& bias_;
  int threads_;
  size_t taps_;                 // products of a value
  std::vector<float> columns_;  // [2, taps, width of the result]: what the weights multiply
};

// The largest value of each window, channel by channel.
class MaxPoolStage final : public FilterStage {
 public:
  MaxPoolStage(const MapShape& in, const Window& window, RowSink sink)
      : FilterStage(in, in.channels, window, std::move(sink)) {}

 private:
  void make_row(size_t y, float* row) override;
};

// The distance of two maps of features: at each place, features are divided by their length, and
// the squares of their differences are summed with a weight for each channel; the mean over places.
class FeatureDistance {
 public:
  FeatureDistance(const MapShape& shape, const std::vector<float>& weights)
      : shape_(shape), weights_(weights), lengths_(2 * shape.width) {}

  void add(const float* row);
  double mean() const { return sum_ / static_cast<double>(shape_.width * shape_.height); }

 private:
  MapShape shape_;
  const std::vector<float>& weights_;  // [channels]
  std::vector<double> lengths_;        // [2, width]
  double sum_ = 0;
};

}  // namespace l4d::eval
