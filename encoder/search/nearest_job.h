// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace l4d {

// A search over points; labels and distances hold what is known so far.
struct NearestJob {
  const float* points;   // [n, dim]
  const uint32_t* hint;  // [n] or nullptr
  uint32_t first_label;  // of codeword 0
  uint32_t* labels;      // [n]
  float* sq_dist;        // [n]
  bool keep_known;       // codewords have to beat labels and sq_dist as given
};

}  // namespace l4d
