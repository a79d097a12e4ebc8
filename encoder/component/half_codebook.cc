// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/half_codebook.h"

#include <algorithm>

#include "encoder/search/kmeans.h"
#include "libl4dcodec/base/half.h"

namespace l4d {

uint32_t useful_entries(uint32_t wanted, size_t n) {
  // A codeword costs about as much as the index bits of eight Gaussians.
  constexpr size_t kGaussiansPerEntry = 8;
  return static_cast<uint32_t>(
      std::clamp<size_t>(n / kGaussiansPerEntry, 1, std::max<size_t>(wanted, 1)));
}

std::vector<float> train_half_codebook(const float* rows, const float* weights, size_t n,
                                       size_t dim, uint32_t entries,
                                       const ComponentSettings& settings, uint64_t salt) {
  KMeansOptions options;
  options.num_codewords = entries;
  options.iterations = settings.iterations;
  options.sample_per_codeword = settings.sample_per_codeword;
  options.seed = settings.seed * 0x9e3779b97f4a7c15u + salt;
  options.threads = settings.threads;
  options.device = settings.device;
  options.cancelled = settings.cancelled;
  std::vector<float> codebook = train_codebook(rows, weights, n, dim, options).entries;
  // Assignments are made to the values a decoder has.
  for (float& v : codebook) v = half_to_float(float_to_half_saturate(v));
  return codebook;
}

}  // namespace l4d
