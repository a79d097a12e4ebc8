// SPDX-License-Identifier: Apache-2.0
// Where weighted k-means starts: a sample of the points and the first codewords.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "encoder/search/nearest.h"
#include "encoder/search/random.h"

namespace l4d {

// Points that stand for all: index and the weight each has then, weights [n] >= 0 over the chance
// to be drawn.
struct PointSample {
  std::vector<uint32_t> index;  // ascending
  std::vector<float> weight;
};

// Draws about `size` of n points without replacement; all of positive weight where they are no
// more. The chance is half by weight and half by weighted squared distance from the mean: points
// far out are few but decide the distortion of heavy-tailed data ("lightweight coresets", Bachem et
// al. 2018).
PointSample draw_sample(const float* points, const float* weights, size_t n, size_t dim,
                        size_t size, int threads, Random& random);

// The first codewords by k-means++, in rounds that grow with the codebook: a round draws candidates
// by weight x squared distance from the seeds so far and keeps those that drawing one at a time
// would.
struct Seeding {
  std::vector<float> centroids;  // [<= k, dim], distinct points
  std::vector<uint32_t> labels;  // [n] nearest centroid
  std::vector<float> sq_dist;    // [n]
};
Seeding seed_centroids(const float* points, const float* weights, size_t n, size_t dim, size_t k,
                       const NearestBackend& backend, Random& random);

}  // namespace l4d
