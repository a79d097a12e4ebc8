// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/entropy_constrained.h"

#include <algorithm>
#include <cmath>

#include "encoder/search/nearest.h"
#include "libl4dcodec/base/half.h"

namespace l4d {
namespace {

// Weights are grouped by half octaves: the price of bits in a point's own error depends on them.
constexpr double kWeightStep = 0.5;
constexpr double kMinWeight = 1e-12;  // of the mean one
// What a codeword that nobody uses would cost, in uses.
constexpr double kUnused = 0.25;

class Constrainer {
 public:
  Constrainer(const float* rows, const float* weights, size_t n, size_t dim,
              const EntropyConstraint& constraint, std::vector<float>& codebook,
              std::vector<uint32_t>& labels)
      : rows_(rows),
        n_(n),
        dim_(dim),
        k_(codebook.size() / dim),
        constraint_(constraint),
        codebook_(codebook),
        labels_(labels) {
    double mean = 0;
    for (size_t i = 0; i < n; ++i) mean += static_cast<double>(weights[i]);
    mean = mean > 0 ? mean / static_cast<double>(n) : 1;
    weight_.resize(n);
    for (size_t i = 0; i < n; ++i) {
      weight_[i] = std::max(static_cast<double>(weights[i]) / mean, kMinWeight);
    }
    group_by_weight();
  }

  void run() {
    // Error falls with rate as 2^(-2 R / dim), so its slope is this much of it.
    const double price =
        constraint_.price * 2 * std::log(2.0) / static_cast<double>(dim_) * error();
    if (!(price > 0)) return;
    for (int round = 0; round < constraint_.rounds; ++round) {
      assign(price);
      move();
    }
    assign(price);
  }

 private:
  struct Group {
    double weight;
    std::vector<uint32_t> members;
  };

  void group_by_weight() {
    std::vector<std::pair<int, uint32_t>> order(n_);
    for (uint32_t i = 0; i < n_; ++i) {
      order[i] = {static_cast<int>(std::floor(std::log2(weight_[i]) / kWeightStep)), i};
    }
    std::sort(order.begin(), order.end());
    for (size_t i = 0; i < n_; ++i) {
      if (i == 0 || order[i].first != order[i - 1].first) {
        groups_.push_back({std::exp2((order[i].first + 0.5) * kWeightStep), {}});
      }
      groups_.back().members.push_back(order[i].second);
    }
  }

  // Mean weighted squared error.
  double error() const {
    double sum = 0;
    for (size_t i = 0; i < n_; ++i) {
      double e2 = 0;
      for (size_t d = 0; d < dim_; ++d) {
        const double e = static_cast<double>(rows_[i * dim_ + d]) -
                         static_cast<double>(codebook_[labels_[i] * dim_ + d]);
        e2 += e * e;
      }
      sum += weight_[i] * e2;
    }
    return sum / static_cast<double>(n_);
  }

  // error + price bits / weight is a squared distance with one more coordinate, 0 for points and
  // the root of the penalty for codewords: so the search for the nearest serves.
  void assign(double price) {
    std::vector<double> use(k_, 0.0);
    for (const uint32_t l : labels_) use[l] += 1;
    std::vector<double> bits(k_);
    for (size_t c = 0; c < k_; ++c) {
      bits[c] = -std::log2(std::max(use[c], kUnused) / static_cast<double>(n_));
    }
    std::vector<float> codebook(k_ * (dim_ + 1)), points;
    std::vector<uint32_t> hint, label;
    std::vector<float> distance;
    for (const Group& g : groups_) {
      const size_t m = g.members.size();
      for (size_t c = 0; c < k_; ++c) {
        std::copy_n(codebook_.data() + c * dim_, dim_, codebook.data() + c * (dim_ + 1));
        codebook[c * (dim_ + 1) + dim_] = static_cast<float>(std::sqrt(price * bits[c] / g.weight));
      }
      points.assign(m * (dim_ + 1), 0.0f);
      hint.resize(m);
      label.resize(m);
      distance.resize(m);
      for (size_t j = 0; j < m; ++j) {
        std::copy_n(rows_ + g.members[j] * dim_, dim_, points.data() + j * (dim_ + 1));
        hint[j] = labels_[g.members[j]];
      }
      assign_nearest(points.data(), m, dim_ + 1, codebook.data(), k_,
                     {constraint_.threads, constraint_.device}, hint.data(), label.data(),
                     distance.data());
      for (size_t j = 0; j < m; ++j) labels_[g.members[j]] = label[j];
    }
  }

  // Each codeword to the weighted mean of its points.
  void move() {
    std::vector<double> sum(k_ * dim_, 0.0), total(k_, 0.0);
    for (size_t i = 0; i < n_; ++i) {
      const size_t c = labels_[i];
      total[c] += weight_[i];
      for (size_t d = 0; d < dim_; ++d) {
        sum[c * dim_ + d] += weight_[i] * static_cast<double>(rows_[i * dim_ + d]);
      }
    }
    for (size_t c = 0; c < k_; ++c) {
      if (total[c] == 0) continue;
      for (size_t d = 0; d < dim_; ++d) {
        const float mean = static_cast<float>(sum[c * dim_ + d] / total[c]);
        codebook_[c * dim_ + d] = half_to_float(float_to_half_saturate(mean));
      }
    }
  }

  const float* rows_;
  size_t n_, dim_, k_;
  const EntropyConstraint& constraint_;
  std::vector<float>& codebook_;
  std::vector<uint32_t>& labels_;
  std::vector<double> weight_;  // relative to the mean
  std::vector<Group> groups_;
};

}  // namespace

void constrain_entropy(const float* rows, const float* weights, size_t n, size_t dim,
                       const EntropyConstraint& constraint, std::vector<float>* codebook,
                       std::vector<uint32_t>* labels) {
  if (n == 0 || constraint.price <= 0 || codebook->size() <= dim) return;
  Constrainer(rows, weights, n, dim, constraint, *codebook, *labels).run();
}

}  // namespace l4d
