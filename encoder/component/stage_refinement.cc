// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/stage_refinement.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "encoder/search/cells.h"
#include "encoder/search/nearest.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr size_t kCellGrain = 32;

class Refiner {
 public:
  Refiner(const float* rows, const float* weights, const ComponentSettings& settings,
          CodedVq& component)
      : rows_(rows),
        weights_(weights),
        settings_(settings),
        c_(component),
        room_(new float[c_.n * c_.dim]) {}

  void run() {
    c_.steps.assign(c_.codebooks.size(), 0.0f);
    const int rounds = std::max(settings_.refine_rounds, settings_.rd_lambda > 0 ? 1 : 0);
    for (int round = 0; round < rounds; ++round) {
      for (size_t s = 0; s < c_.codebooks.size(); ++s) {
        if (settings_.cancelled != nullptr && (*settings_.cancelled)()) return;
        refine(s);
      }
    }
  }

 private:
  void refine(size_t s) {
    const size_t dim = c_.dim;
    std::vector<float>& codebook = c_.codebooks[s];
    std::vector<uint32_t> members;
    for (uint32_t i = 0; i < c_.n; ++i) {
      if (c_.depth[i] != kEscapeDepth && c_.depth[i] > s) members.push_back(i);
    }
    const size_t n = members.size();
    if (n == 0) return;
    // What the other stages leave to this one.
    float* target = room_.get();
    std::vector<float> weight(n), distance(n);
    std::vector<uint32_t> label(n);
    parallel_for(settings_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        const size_t i = members[j];
        label[j] = c_.index[s][i];
        weight[j] = weights_[i];
        const float* codeword = codebook.data() + label[j] * dim;
        for (size_t k = 0; k < dim; ++k) {
          target[j * dim + k] = rows_[i * dim + k] - (c_.decoded[i * dim + k] - codeword[k]);
        }
      }
    });
    if (settings_.rd_lambda > 0 && c_.steps[s] == 0) c_.steps[s] = step_for(codebook, weight);
    move(target, weight, label, c_.steps[s], codebook);
    assign_nearest(target, n, dim, codebook.data(), codebook.size() / dim,
                   {settings_.threads, settings_.device}, label.data(), label.data(),
                   distance.data());
    parallel_for(settings_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        c_.index[s][members[j]] = static_cast<uint16_t>(label[j]);
        sum_stages(members[j]);
      }
    });
  }

  // Each codeword to the weighted mean of its rows.
  void move(const float* target, const std::vector<float>& weight,
            const std::vector<uint32_t>& label, float step, std::vector<float>& codebook) const {
    const size_t dim = c_.dim;
    const Cells cells = sort_into_cells(label, codebook.size() / dim);
    // Each cell is summed by one thread in the order of its rows.
    parallel_for(
        settings_.threads, codebook.size() / dim, kCellGrain, [&](size_t begin, size_t end) {
          std::vector<double> sum(dim);
          for (size_t e = begin; e < end; ++e) {
            std::fill(sum.begin(), sum.end(), 0.0);
            double total = 0;
            for (size_t m = cells.start[e]; m < cells.start[e + 1]; ++m) {
              const size_t j = cells.index[m];
              const double w = static_cast<double>(weight[j]);
              total += w;
              for (size_t k = 0; k < dim; ++k)
                sum[k] += w * static_cast<double>(target[j * dim + k]);
            }
            for (size_t k = 0; k < dim; ++k) {
              float& v = codebook[e * dim + k];
              if (total > 0) v = static_cast<float>(sum[k] / total);
              v = step > 0 ? step * std::clamp(std::nearbyint(v / step), -32767.0f, 32767.0f)
                           : half_to_float(float_to_half_saturate(v));
            }
          }
        });
  }

  // A codeword counts as much as all Gaussians that use it: steps as those of a transform.
  float step_for(const std::vector<float>& codebook, const std::vector<float>& weight) const {
    double users = 0;
    for (const float w : weight) users += static_cast<double>(w);
    float largest = 0;
    for (const float v : codebook) largest = std::max(largest, std::fabs(v));
    const double distortion = settings_.rd_lambda / (2 * std::log(2.0));
    const double codewords = static_cast<double>(codebook.size() / c_.dim);
    const double step = std::sqrt(12 * distortion * codewords / std::max(users, 1e-30));
    return std::clamp(static_cast<float>(step), std::max(0x1p-20f, largest * 0x1p-14f), 0x1p10f);
  }

  // In the order in which a decoder adds.
  void sum_stages(size_t i) {
    const size_t dim = c_.dim;
    float* out = c_.decoded.data() + i * dim;
    std::copy_n(c_.codebooks[0].data() + c_.index[0][i] * dim, dim, out);
    for (size_t s = 1; s < c_.depth[i]; ++s) {
      const float* codeword = c_.codebooks[s].data() + c_.index[s][i] * dim;
      for (size_t k = 0; k < dim; ++k) out[k] = out[k] + codeword[k];
    }
  }

  const float* rows_;
  const float* weights_;
  const ComponentSettings& settings_;
  CodedVq& c_;
  std::unique_ptr<float[]> room_;  // for what other stages leave, one stage after the other
};

}  // namespace

void refine_stages(const float* rows, const float* weights, const ComponentSettings& settings,
                   CodedVq* component) {
  if (!component->block_tables.empty()) return;
  if (component->codebooks.size() < 2 && !(settings.rd_lambda > 0)) return;
  Refiner(rows, weights, settings, *component).run();
}

}  // namespace l4d
