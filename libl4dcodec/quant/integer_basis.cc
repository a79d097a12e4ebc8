// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/quant/integer_basis.h"

#include <algorithm>
#include <cmath>

namespace l4d {
namespace {

constexpr int kBits = 15;
constexpr float kLargest = 32767;
// Added and taken away again, it leaves numbers below 2^22 rounded to integers, ties to even.
constexpr float kRounds = 12582912;  // 1.5 * 2^23

}  // namespace

IntegerBasis integer_basis(const float* basis, size_t dim, const float* steps,
                           size_t num_coefficients) {
  IntegerBasis out;
  const size_t n = num_coefficients * dim;
  const float* const vectors = basis + dim;
  float largest = 0;
  for (size_t i = 0; i < n; ++i)
    largest = std::max(largest, std::fabs(vectors[i] * steps[i / dim]));
  out.vectors.assign(n, 0);
  if (largest == 0) return out;
  int exponent = 0;
  std::frexp(largest, &exponent);  // 2^(exponent - 1) <= largest < 2^exponent
  const float up = std::ldexp(1.0f, kBits - exponent);
  out.scale = std::ldexp(1.0f, exponent - kBits);
  for (size_t i = 0; i < n; ++i) {
    const float number = ((vectors[i] * steps[i / dim]) * up + kRounds) - kRounds;
    out.vectors[i] = static_cast<int16_t>(std::clamp(number, -kLargest, kLargest));
  }
  return out;
}

}  // namespace l4d
