// SPDX-License-Identifier: Apache-2.0
#include "encoder/session/known_gaussians.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "libl4dcodec/base/hash.h"

namespace l4d {
namespace {

// Of a coordinate that was rounded to binary32 twice, with some slack.
constexpr double kRounding = 1e-6;
// Of a path in binary64, however its velocity was worked out.
constexpr double kPathRounding = 1e-9;
// A direction along which no grid of Gaussians lines up.
constexpr double kAcross[3] = {1, 0.6180339887, 0.3771236166};

// All that a position at another time leaves as it is.
uint64_t key_of(const AttributeArrays& arrays, const PooledGaussian& row, size_t i) {
  std::array<uint64_t, kNumAttributes> parts{};
  size_t n = 0;
  const auto bytes_of = [](const float* values, size_t count) {
    return ByteSpan(reinterpret_cast<const unsigned char*>(values), count * sizeof *values);
  };
  for_each_attribute(
      [&](const AttributeInfo& a, const std::vector<float>& values) {
        if (a.flag == info_of(Attribute::kPosition).flag) return;
        if (a.flag == info_of(Attribute::kMeanTime).flag) {
          // A piece holds times as binary64 only if one of them needs it.
          const float mean = static_cast<float>(row.mean);
          parts[n++] = hash64(bytes_of(&mean, 1));
          return;
        }
        const size_t dim = a.numbers(arrays.sh_degree);
        parts[n++] = hash64(bytes_of(values.data() + dim * i, dim));
      },
      arrays);
  return hash64(
      ByteSpan(reinterpret_cast<const unsigned char*>(parts.data()), n * sizeof(uint64_t)));
}

struct Candidate {
  uint64_t key;
  double place;        // along kAcross
  double position[3];  // at the mean time, so that those of two pieces compare
  double rounding;     // of each coordinate
  size_t row;

  bool operator<(const Candidate& other) const {
    return key != other.key ? key < other.key : place < other.place;
  }
};

Candidate candidate(const AttributeArrays& arrays, const std::vector<PooledGaussian>& rows,
                    size_t i) {
  const PooledGaussian& row = rows[i];
  Candidate c{};
  c.key = key_of(arrays, row, i);
  c.row = i;
  for (size_t k = 0; k < 3; ++k) {
    const double given = static_cast<double>(arrays.position[3 * i + k]);
    const double moved = row.velocity[k] * (row.mean - row.reference);
    c.position[k] = given + moved;
    c.place += kAcross[k] * c.position[k];
    c.rounding =
        std::max(c.rounding, kRounding * std::fabs(given) + kPathRounding * std::fabs(moved));
  }
  return c;
}

bool is_same(const Candidate& a, const Candidate& b) {
  const double rounding = a.rounding + b.rounding;
  for (size_t k = 0; k < 3; ++k) {
    if (!(std::fabs(a.position[k] - b.position[k]) <= rounding)) return false;
  }
  return true;
}

// The places of a list that are not taken yet. Without it, equal Gaussians in great number would be
// gone over again for each of them.
class FreePlaces {
 public:
  explicit FreePlaces(size_t n) : next_(n + 1) { std::iota(next_.begin(), next_.end(), size_t{0}); }

  // The first one from i on; n where there is none.
  size_t from(size_t i) {
    while (next_[i] != i) {
      next_[i] = next_[next_[i]];
      i = next_[i];
    }
    return i;
  }
  void take(size_t i) { next_[i] = i + 1; }

 private:
  std::vector<size_t> next_;  // i where i is free, else a place behind it
};

}  // namespace

std::vector<char> without_known(const AttributeArrays& arrays,
                                const std::vector<PooledGaussian>& rows, size_t first) {
  std::vector<char> keep(rows.size(), 1);
  if (first == 0) return keep;
  // Flat windows end with their piece: none lives on.
  const auto lives_on = [&](size_t i) { return rows[i].lambda != 0; };
  std::vector<Candidate> added;
  double rounding = 0;
  for (size_t i = first; i < rows.size(); ++i) {
    if (!lives_on(i)) continue;
    const Candidate c = candidate(arrays, rows, i);
    if (!std::isfinite(c.place)) continue;
    added.push_back(c);
    rounding = std::max(rounding, c.rounding);
  }
  std::sort(added.begin(), added.end());
  FreePlaces places(added.size());
  for (size_t i = 0; i < first; ++i) {
    if (!lives_on(i)) continue;
    const Candidate known = candidate(arrays, rows, i);
    const double reach = 2 * (known.rounding + rounding);
    Candidate lowest = known;
    lowest.place -= reach;
    const auto begin = std::lower_bound(added.begin(), added.end(), lowest);
    for (size_t k = places.from(static_cast<size_t>(begin - added.begin())); k < added.size();
         k = places.from(k + 1)) {
      const Candidate& c = added[k];
      if (c.key != known.key || c.place > known.place + reach) break;
      if (!is_same(known, c)) continue;
      keep[c.row] = 0;
      places.take(k);
      break;
    }
  }
  return keep;
}

}  // namespace l4d
