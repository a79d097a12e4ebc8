// SPDX-License-Identifier: Apache-2.0
// Gaussians as comparable rows of bits, and the visibility predicate in double.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "l4d/l4d.hpp"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::test {

// Hash of all attributes of Gaussian i but mean_t_local, which depends on the bucket.
inline uint64_t row(const GaussianArrays& a, size_t i) {
  const size_t sh = 3 * (a.sh_degree + 1) * (a.sh_degree + 1);
  uint64_t h = 0;
  const auto add = [&](const std::vector<float>& v, size_t dim) {
    const auto* bytes = reinterpret_cast<const unsigned char*>(v.data() + dim * i);
    h = h * 0x9e3779b97f4a7c15u + hash64(ByteSpan(bytes, dim * sizeof(float)));
  };
  add(a.position, 3);
  add(a.mean_t, 1);
  add(a.log_scale, 4);
  add(a.rotor, 8);
  add(a.opacity, 1);
  add(a.sh, sh);
  return h;
}

// The binary16 numbers that are the nearest to these.
inline std::vector<uint16_t> halves_of(const std::vector<float>& values) {
  std::vector<uint16_t> halves;
  for (const float v : values) halves.push_back(float_to_half_saturate(v));
  return halves;
}

using Rows = std::vector<uint64_t>;  // ascending
inline Rows rows(const GaussianArrays& a) {
  Rows all(a.count());
  for (size_t i = 0; i < all.size(); ++i) all[i] = row(a, i);
  std::sort(all.begin(), all.end());
  return all;
}

// Is every row of `part` in `whole`, as often?
inline bool contains(const Rows& whole, const Rows& part) {
  return std::includes(whole.begin(), whole.end(), part.begin(), part.end());
}

// Temporal behaviour of the decoded Gaussians, in double.
struct Visibility {
  std::vector<double> mean, lambda;
  std::vector<bool> permanent;
  bool visible(size_t i, double t) const {
    const double dt = t - mean[i];
    return permanent[i] || lambda[i] * dt * dt <= 16.0;
  }
};

inline Visibility visibility(const DecoderHandle& d, const GaussianArrays& a) {
  Visibility v;
  const size_t n = a.count();
  v.mean.resize(n);
  v.lambda.resize(n);
  v.permanent.resize(n);
  for (const l4d_bucket_span& r : a.spans) {
    l4d_layer_info layer = L4D_INIT(l4d_layer_info);
    d.check(l4d_decoder_get_layer_info(d.get(), r.layer, &layer));
    for (size_t i = r.first; i < r.first + r.count; ++i) {
      double rotor[8], scale[4];
      for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(a.rotor[8 * i + k]);
      for (size_t k = 0; k < 4; ++k) {
        scale[k] = std::exp(static_cast<double>(a.log_scale[4 * i + k]));
      }
      v.lambda[i] = slice_gaussian(normalized_halves(rotor), scale).lambda;
      v.mean[i] = (layer.tools & L4D_TOOL_LOSSLESS) != 0
                      ? static_cast<double>(a.mean_t[i])
                      : r.center + static_cast<double>(a.mean_t_local[i]);
      v.permanent[i] = layer.permanent != 0;
    }
  }
  return v;
}

}  // namespace l4d::test
