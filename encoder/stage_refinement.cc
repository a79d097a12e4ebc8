// SPDX-License-Identifier: Apache-2.0
#include "encoder/stage_refinement.h"

#include <algorithm>

#include "encoder/entropy_constrained.h"
#include "encoder/nearest.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr size_t kGrain = 4096;

class Refiner {
 public:
  Refiner(const float* rows, const float* weights, const ComponentSettings& settings,
          CodedComponent& component)
      : rows_(rows), weights_(weights), settings_(settings), c_(component) {}

  void run() {
    for (int round = 0; round < settings_.refine_rounds; ++round) {
      for (size_t s = 0; s < c_.books.size(); ++s) {
        if (settings_.cancelled != nullptr && (*settings_.cancelled)()) return;
        refine(s);
      }
    }
  }

 private:
  void refine(size_t s) {
    const size_t dim = c_.dim;
    std::vector<float>& book = c_.books[s];
    std::vector<uint32_t> members;
    for (uint32_t i = 0; i < c_.n; ++i) {
      if (c_.depth[i] != kLiteralDepth && c_.depth[i] > s) members.push_back(i);
    }
    const size_t n = members.size();
    if (n == 0) return;
    // What the other stages leave to this one.
    std::vector<float> target(n * dim), weight(n), distance(n);
    std::vector<uint32_t> label(n);
    parallel_for(settings_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        const size_t i = members[j];
        label[j] = c_.index[s][i];
        weight[j] = weights_[i];
        const float* codeword = book.data() + label[j] * dim;
        for (size_t k = 0; k < dim; ++k) {
          target[j * dim + k] = rows_[i * dim + k] - (c_.decoded[i * dim + k] - codeword[k]);
        }
      }
    });
    if (settings_.rate_price > 0) {
      EntropyConstraint constraint;
      constraint.price = settings_.rate_price;
      constraint.rounds = 1;
      constraint.threads = settings_.threads;
      constrain_entropy(target.data(), weight.data(), n, dim, constraint, &book, &label);
    } else {
      move(target, weight, label, book);
      const std::vector<uint32_t> hint = label;
      assign_nearest(target.data(), n, dim, book.data(), book.size() / dim, settings_.threads,
                     hint.data(), label.data(), distance.data());
    }
    parallel_for(settings_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        c_.index[s][members[j]] = static_cast<uint16_t>(label[j]);
        sum_stages(members[j]);
      }
    });
  }

  // Each codeword to the weighted mean of its rows.
  void move(const std::vector<float>& target, const std::vector<float>& weight,
            const std::vector<uint32_t>& label, std::vector<float>& book) const {
    const size_t dim = c_.dim;
    std::vector<double> sum(book.size(), 0.0), total(book.size() / dim, 0.0);
    for (size_t j = 0; j < label.size(); ++j) {
      const double w = static_cast<double>(weight[j]);
      total[label[j]] += w;
      double* of = sum.data() + label[j] * dim;
      for (size_t k = 0; k < dim; ++k) of[k] += w * static_cast<double>(target[j * dim + k]);
    }
    for (size_t e = 0; e < total.size(); ++e) {
      if (!(total[e] > 0)) continue;
      for (size_t k = 0; k < dim; ++k) {
        const float mean = static_cast<float>(sum[e * dim + k] / total[e]);
        book[e * dim + k] = half_to_float(float_to_half_saturate(mean));
      }
    }
  }

  // In the order in which a decoder adds.
  void sum_stages(size_t i) {
    const size_t dim = c_.dim;
    float* out = c_.decoded.data() + i * dim;
    std::copy_n(c_.books[0].data() + c_.index[0][i] * dim, dim, out);
    for (size_t s = 1; s < c_.depth[i]; ++s) {
      const float* codeword = c_.books[s].data() + c_.index[s][i] * dim;
      for (size_t k = 0; k < dim; ++k) out[k] = out[k] + codeword[k];
    }
  }

  const float* rows_;
  const float* weights_;
  const ComponentSettings& settings_;
  CodedComponent& c_;
};

}  // namespace

void refine_stages(const float* rows, const float* weights, const ComponentSettings& settings,
                   CodedComponent* component) {
  if (component->books.size() < 2 || !component->block_tables.empty()) return;
  Refiner(rows, weights, settings, *component).run();
}

}  // namespace l4d
