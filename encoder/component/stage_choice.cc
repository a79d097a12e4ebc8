// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/stage_choice.h"

#include <algorithm>
#include <cmath>

namespace l4d {
namespace {

constexpr uint32_t kMinCodewords = 16;
// Of a codeword, after entropy coding.
constexpr double kBitsPerNumber = 8;
// Sets of members and numbers of codewords follow from each other; they settle within a few rounds.
constexpr int kRounds = 3;

}  // namespace

double effective_dimension(double error_before, double error_after, double codewords) {
  if (!(error_before > 0) || !(error_after > 0) || error_after >= error_before) return 1;
  return std::max(1.0, 2 * std::log2(codewords) / std::log2(error_before / error_after));
}

double error_after_stage(double codewords, double effective_dim) {
  return std::pow(codewords, -2 / effective_dim);
}

double codebook_bits(double codewords, size_t dim) {
  return kBitsPerNumber * codewords * static_cast<double>(dim);
}

uint32_t codewords_by_cost(double error, size_t n, size_t dim, double effective_dim,
                           double rd_lambda, uint32_t most) {
  uint32_t best = std::min(kMinCodewords, most);
  double least = 0;
  for (uint32_t k = best; k <= most; k *= 2) {
    const double codewords = static_cast<double>(k);
    const double bits =
        static_cast<double>(n) * std::log2(codewords) + codebook_bits(codewords, dim);
    const double cost = error * error_after_stage(codewords, effective_dim) + rd_lambda * bits;
    if (k > best && cost >= least) break;
    best = k;
    least = cost;
  }
  return best;
}

StageChoice choose_stage(const std::vector<uint32_t>& members, const std::vector<float>& error,
                         size_t dim, double effective_dim, double rd_lambda, uint32_t most) {
  StageChoice out;
  out.codewords = std::min<uint32_t>(1024, most);
  double sum = 0;
  for (int round = 0; round < kRounds; ++round) {
    const double codewords = static_cast<double>(out.codewords);
    const double gain = 1 - error_after_stage(codewords, effective_dim);
    const double index = rd_lambda * std::log2(codewords);
    out.members.clear();
    sum = 0;
    for (const uint32_t i : members) {
      if (static_cast<double>(error[i]) * gain <= index) continue;
      out.members.push_back(i);
      sum += static_cast<double>(error[i]);
    }
    if (out.members.empty()) return out;
    out.codewords = codewords_by_cost(sum, out.members.size(), dim, effective_dim, rd_lambda, most);
  }
  const double codewords = static_cast<double>(out.codewords);
  const double bits = static_cast<double>(out.members.size()) * std::log2(codewords) +
                      codebook_bits(codewords, dim);
  if (sum * (1 - error_after_stage(codewords, effective_dim)) <= rd_lambda * bits)
    out.members.clear();
  return out;
}

}  // namespace l4d
