// SPDX-License-Identifier: Apache-2.0
#include <limits>

#include "encoder/search/nearest.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {

void assign_nearest_reference(const float* points, size_t n, size_t dim, const float* codebook,
                              size_t k, int threads, const uint32_t* /*hint*/, uint32_t* labels,
                              float* sq_dist) {
  constexpr size_t kPointGrain = 256;
  parallel_for(threads, n, kPointGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      double best = std::numeric_limits<double>::infinity();
      uint32_t label = 0;
      for (size_t c = 0; c < k; ++c) {
        double distance = 0;
        for (size_t j = 0; j < dim; ++j) {
          const double e =
              static_cast<double>(points[i * dim + j]) - static_cast<double>(codebook[c * dim + j]);
          distance += e * e;
        }
        if (distance < best) {
          best = distance;
          label = static_cast<uint32_t>(c);
        }
      }
      labels[i] = label;
      sq_dist[i] = static_cast<float>(best);
    }
  });
}

}  // namespace l4d
