// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "encoder/search/nearest.h"

namespace l4d {

struct KMeansOptions {
  size_t num_codewords = 0;
  // Lloyd iterations at most; they end once one gains less than 0.1 %.
  int iterations = 12;
  // Where there are more points than this per codeword, iterations are on a sample, and a few last
  // ones on one four times as large. So the time does not grow with the number of points.
  size_t sample_per_codeword = 24;
  uint64_t seed = 0;
  int threads = 0;  // 0: one per core
  NearestDevice* device = nullptr;
  // Asked between iterations; what there is by then is returned.
  const std::function<bool()>* cancelled = nullptr;
};

struct Codebook {
  size_t dim = 0;
  std::vector<float> entries;  // [size, dim]
  // Sum of weight x squared distance of the points to the mean of the cell they were trained in;
  // estimated from the sample where there was one.
  double weighted_distortion = 0;

  size_t size() const { return dim == 0 ? 0 : entries.size() / dim; }
};

// Weighted k-means with k-means++ seeding.
//   points   [n, dim]  row-major, finite
//   weights  [n] or nullptr for 1 each; >= 0. Where all are zero, all count as 1.
// Returns at least one codeword if n >= 1, at most num_codewords (and 1 where that is 0): fewer
// where there are fewer distinct points of positive weight. The same bits for any number of
// threads.
Codebook train_codebook(const float* points, const float* weights, size_t n, size_t dim,
                        const KMeansOptions& options);

}  // namespace l4d
