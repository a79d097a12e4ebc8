// SPDX-License-Identifier: Apache-2.0
#include "io/formats/clusters.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <queue>
#include <utility>

namespace l4d::io {
namespace {

constexpr size_t kCodes = 256;
constexpr int kCodebookRounds = 40, kPowerRounds = 4;

// Values in ascending order, of which codes stand for intervals.
class SortedValues {
 public:
  explicit SortedValues(std::vector<float> values) : values_(std::move(values)) {
    std::sort(values_.begin(), values_.end());
    sums_.reserve(values_.size() + 1);
    squares_.reserve(values_.size() + 1);
    for (const float x : values_) {
      const double value = static_cast<double>(x);
      sums_.push_back(sums_.back() + value);
      squares_.push_back(squares_.back() + value * value);
    }
  }

  // Means of intervals: the one with the largest error is divided at its mean, again and again.
  std::vector<double> first_codes(size_t count) const {
    std::priority_queue<Interval> intervals;
    intervals.push(interval(0, values_.size()));
    while (intervals.size() < count && intervals.top().error > 0) {
      const Interval whole = intervals.top();
      intervals.pop();
      const size_t middle = first_above(whole.begin, mean(whole.begin, whole.end));
      if (middle == whole.begin || middle >= whole.end) {
        intervals.push({whole.begin, whole.end, 0});  // its values differ by rounding alone
        continue;
      }
      intervals.push(interval(whole.begin, middle));
      intervals.push(interval(middle, whole.end));
    }
    std::vector<double> codes;
    for (; !intervals.empty(); intervals.pop()) {
      codes.push_back(mean(intervals.top().begin, intervals.top().end));
    }
    codes.resize(count, codes.back());
    std::sort(codes.begin(), codes.end());
    return codes;
  }

  // Each code becomes the mean of the values that are nearest to it.
  void move_to_means(std::vector<double>* codes) const {
    size_t begin = 0;
    for (size_t k = 0; k < codes->size(); ++k) {
      size_t end = values_.size();
      if (k + 1 < codes->size()) end = first_above(begin, ((*codes)[k] + (*codes)[k + 1]) / 2);
      if (end > begin) (*codes)[k] = mean(begin, end);
      begin = end;
    }
    std::sort(codes->begin(), codes->end());
  }

 private:
  struct Interval {
    size_t begin, end;
    double error;  // sum of squared distances from the mean
    bool operator<(const Interval& other) const { return error < other.error; }
  };
  double mean(size_t begin, size_t end) const {
    return (sums_[end] - sums_[begin]) / static_cast<double>(end - begin);
  }
  Interval interval(size_t begin, size_t end) const {
    const double sum = sums_[end] - sums_[begin];
    const double error =
        squares_[end] - squares_[begin] - sum * sum / static_cast<double>(end - begin);
    return {begin, end, values_[begin] < values_[end - 1] ? error : 0};
  }
  size_t first_above(size_t begin, double border) const {
    return static_cast<size_t>(
        std::upper_bound(values_.begin() + static_cast<std::ptrdiff_t>(begin), values_.end(),
                         border, [](double b, float x) { return b < static_cast<double>(x); }) -
        values_.begin());
  }

  std::vector<float> values_;
  std::vector<double> sums_ = {0}, squares_ = {0};  // of those before
};

// Some of the rows.
struct RowCluster {
  size_t begin = 0, end = 0;  // in the order of rows
  double error = 0;           // sum of squared distances from the mean
  std::vector<double> mean;
  bool operator<(const RowCluster& other) const { return error < other.error; }
};

class RowDivider {
 public:
  RowDivider(const std::vector<float>& rows, size_t width)
      : rows_(rows), width_(width), order_(rows.size() / width), along_(order_.size()) {
    std::iota(order_.begin(), order_.end(), 0U);
  }

  RowPalette divide(size_t count, const Check& check) {
    std::priority_queue<RowCluster> clusters;
    clusters.push(cluster_of(0, order_.size()));
    while (clusters.size() < count && clusters.top().error > 0) {
      call(check);
      RowCluster cluster = clusters.top();
      clusters.pop();
      const size_t middle = partition(cluster);
      if (middle == cluster.begin || middle == cluster.end) {
        // Rounding can leave a direction in which no two rows differ.
        cluster.error = 0;
        clusters.push(cluster);
        continue;
      }
      clusters.push(cluster_of(cluster.begin, middle));
      clusters.push(cluster_of(middle, cluster.end));
    }
    RowPalette palette;
    palette.labels.resize(order_.size());
    for (uint32_t label = 0; !clusters.empty(); ++label, clusters.pop()) {
      const RowCluster& cluster = clusters.top();
      for (size_t k = cluster.begin; k < cluster.end; ++k) palette.labels[order_[k]] = label;
      for (const double x : cluster.mean) palette.centroids.push_back(static_cast<float>(x));
    }
    return palette;
  }

 private:
  const float* row(size_t k) const { return &rows_[width_ * order_[k]]; }

  RowCluster cluster_of(size_t begin, size_t end) const {
    RowCluster cluster;
    cluster.begin = begin;
    cluster.end = end;
    cluster.mean.assign(width_, 0);
    double squares = 0;
    for (size_t k = begin; k < end; ++k) {
      for (size_t j = 0; j < width_; ++j) {
        const double x = static_cast<double>(row(k)[j]);
        cluster.mean[j] += x;
        squares += x * x;
      }
    }
    const double n = static_cast<double>(end - begin);
    double of_mean = 0;
    for (double& x : cluster.mean) {
      x /= n;
      of_mean += x * x;
    }
    // Where all rows are equal the difference is rounding.
    const double error = squares - n * of_mean;
    cluster.error = end - begin > 1 && error > 1e-12 * squares ? error : 0;
    return cluster;
  }

  // The direction of the largest variance, next to it at least.
  std::vector<double> main_direction(const RowCluster& cluster) const {
    std::vector<double> direction(width_, 0);
    for (size_t k = cluster.begin; k < cluster.end; ++k) {
      for (size_t j = 0; j < width_; ++j) {
        const double x = static_cast<double>(row(k)[j]) - cluster.mean[j];
        direction[j] += x * x;
      }
    }
    for (int round = 0; round < kPowerRounds; ++round) {
      const double length =
          std::sqrt(std::inner_product(direction.begin(), direction.end(), direction.begin(), 0.0));
      std::vector<double> next(width_, 0);
      for (size_t k = cluster.begin; k < cluster.end; ++k) {
        const double along = position_along(direction, cluster, k) / length;
        for (size_t j = 0; j < width_; ++j) {
          next[j] += along * (static_cast<double>(row(k)[j]) - cluster.mean[j]);
        }
      }
      // Nothing is left where the first guess was at a right angle to every row.
      if (std::all_of(next.begin(), next.end(), [](double x) { return x == 0; })) break;
      direction = std::move(next);
    }
    return direction;
  }

  double position_along(const std::vector<double>& direction, const RowCluster& cluster,
                        size_t k) const {
    double sum = 0;
    for (size_t j = 0; j < width_; ++j) {
      sum += direction[j] * (static_cast<double>(row(k)[j]) - cluster.mean[j]);
    }
    return sum;
  }

  // Rows on one side of the mean come first. Returns where the others begin.
  size_t partition(const RowCluster& cluster) {
    const std::vector<double> direction = main_direction(cluster);
    for (size_t k = cluster.begin; k < cluster.end; ++k) {
      along_[order_[k]] = position_along(direction, cluster, k);
    }
    const auto begin = order_.begin();
    const auto middle = std::stable_partition(begin + static_cast<std::ptrdiff_t>(cluster.begin),
                                              begin + static_cast<std::ptrdiff_t>(cluster.end),
                                              [&](uint32_t i) { return along_[i] < 0; });
    return static_cast<size_t>(middle - begin);
  }

  const std::vector<float>& rows_;
  size_t width_;
  std::vector<uint32_t> order_;
  std::vector<double> along_;  // [rows] of the cluster that is divided
};

}  // namespace

std::vector<float> codebook_of(const std::vector<float>& values) {
  if (values.empty()) return std::vector<float>(kCodes, 0.0F);
  const SortedValues sorted(values);
  std::vector<double> codes = sorted.first_codes(kCodes);
  for (int round = 0; round < kCodebookRounds; ++round) sorted.move_to_means(&codes);
  return {codes.begin(), codes.end()};
}

uint8_t nearest_code(const std::vector<float>& codebook, float value) {
  const auto above = std::lower_bound(codebook.begin(), codebook.end(), value);
  if (above == codebook.begin()) return 0;
  const bool is_below = above == codebook.end() || value - above[-1] <= *above - value;
  return static_cast<uint8_t>(above - codebook.begin() - (is_below ? 1 : 0));
}

RowPalette palette_of(const std::vector<float>& rows, size_t width, size_t count,
                      const Check& check) {
  if (rows.empty()) return {};
  return RowDivider(rows, width).divide(count, check);
}

}  // namespace l4d::io
