// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstring>
#include <unordered_map>

#include "io/sequence/frame.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

// Rows that are looked at to decide whether the order is kept, and the share that must agree.
constexpr size_t kSample = 1000;
constexpr double kAgreeing = 0.9;
// Candidates that are looked at for a row: more of one place or of one content are not told apart.
constexpr size_t kMostCandidates = 16;
// What counts as one unit of distance.
constexpr double kSizes = 2, kColor = 0.1, kLogScale = 0.5;

double size_of(const Frame& frame, size_t i) {
  const float* l = &frame.log_scale[3 * i];
  return std::exp(static_cast<double>(std::max({l[0], l[1], l[2]})));
}

// Squared, in units; above 1 two rows are different Gaussians.
double distance2(const Frame& a, size_t i, const float* velocity, const Frame& b, size_t j) {
  const double size = kSizes * size_of(a, i);
  double place = 0, color = 0, scale = 0;
  for (size_t k = 0; k < 3; ++k) {
    const double v = velocity != nullptr ? static_cast<double>(velocity[k]) : 0;
    const double d =
        static_cast<double>(b.position[3 * j + k]) - static_cast<double>(a.position[3 * i + k]) - v;
    place += d * d;
    const double c = static_cast<double>(b.sh[b.sh_numbers() * j + k]) -
                     static_cast<double>(a.sh[a.sh_numbers() * i + k]);
    color += c * c;
    const double s =
        static_cast<double>(b.log_scale[3 * j + k]) - static_cast<double>(a.log_scale[3 * i + k]);
    scale += s * s;
  }
  constexpr double kBase = static_cast<double>(sh_constant::k0) / kColor;
  return place / (size * size) + color * kBase * kBase + scale / (kLogScale * kLogScale);
}

bool keeps_order(const Frame& before, const std::vector<float>& velocity, const Frame& now) {
  const size_t n = now.count();
  if (n == 0 || before.count() != n) return false;
  const size_t step = std::max<size_t>(1, n / kSample);
  size_t agreeing = 0, looked_at = 0;
  for (size_t i = 0; i < n; i += step) {
    ++looked_at;
    agreeing += distance2(before, i, &velocity[3 * i], now, i) <= 1 ? 1U : 0U;
  }
  return static_cast<double>(agreeing) >= kAgreeing * static_cast<double>(looked_at);
}

uint64_t mixed(uint64_t h, uint64_t v) {
  h = (h ^ v) * 0x9e3779b97f4a7c15U;
  return h ^ (h >> 32);
}

// Of what does not change as a Gaussian moves and fades.
uint64_t content_of(const Frame& frame, size_t i) {
  uint64_t h = 1;
  const auto add = [&](const float* values, size_t count) {
    for (size_t k = 0; k < count; ++k) {
      uint32_t bits = 0;
      std::memcpy(&bits, &values[k], sizeof(bits));
      h = mixed(h, bits);
    }
  };
  add(&frame.log_scale[3 * i], 3);
  add(&frame.rotation[4 * i], 4);
  add(&frame.sh[frame.sh_numbers() * i], frame.sh_numbers());
  return h;
}

// The rows of a frame by a key, in the order of the rows.
class Buckets {
 public:
  template <typename Key>
  Buckets(size_t count, const Key& key) : next_(count, kNoRow) {
    first_.reserve(count);
    for (size_t i = count; i-- > 0;) {
      const auto [place, is_new] = first_.try_emplace(key(i), static_cast<uint32_t>(i));
      if (is_new) continue;
      next_[i] = place->second;
      place->second = static_cast<uint32_t>(i);
    }
  }
  // Calls f(row) for the first rows of a key.
  template <typename F>
  void each(uint64_t key, const F& f) const {
    const auto found = first_.find(key);
    if (found == first_.end()) return;
    size_t looked_at = 0;
    for (uint32_t i = found->second; i != kNoRow && looked_at < kMostCandidates; i = next_[i]) {
      looked_at += f(i) ? 1U : 0U;
    }
  }

 private:
  std::unordered_map<uint64_t, uint32_t> first_;
  std::vector<uint32_t> next_;
};

const float* velocity_of(const std::vector<float>& velocity, size_t i) {
  return velocity.data() + 3 * i;
}

// Rows of equal content: of several the nearest.
void match_equal(const Frame& before, const std::vector<float>& velocity, const Frame& now,
                 std::vector<uint32_t>* from, std::vector<char>* taken) {
  const Buckets rows(before.count(), [&](size_t i) { return content_of(before, i); });
  for (size_t j = 0; j < now.count(); ++j) {
    double least = HUGE_VAL;
    uint32_t best = kNoRow;
    rows.each(content_of(now, j), [&](uint32_t i) {
      if ((*taken)[i] != 0) return false;
      const double d = distance2(before, i, velocity_of(velocity, i), now, j);
      if (d < least) {
        least = d;
        best = i;
      }
      return true;
    });
    if (best == kNoRow) continue;
    (*from)[j] = best;
    (*taken)[best] = 1;
  }
}

// A grid whose cells are about as wide as Gaussians of the frame reach.
struct Grid {
  double cell = 1;
  uint64_t key(const double* place, const int* shift) const {
    uint64_t h = 7;
    for (size_t k = 0; k < 3; ++k) {
      const double c = std::clamp(std::floor(place[k] / cell) + shift[k], -0x1p52, 0x1p52);
      h = mixed(h, static_cast<uint64_t>(static_cast<int64_t>(c)));
    }
    return h;
  }
};

void place_of(const Frame& frame, size_t i, const float* velocity, double* place) {
  for (size_t k = 0; k < 3; ++k) {
    place[k] = static_cast<double>(frame.position[3 * i + k]) +
               (velocity != nullptr ? static_cast<double>(velocity[k]) : 0);
  }
}

// Of the rows that are left, those that are each other's nearest.
void match_nearest(const Frame& before, const std::vector<float>& velocity, const Frame& now,
                   std::vector<uint32_t>* from, const std::vector<char>& taken) {
  std::vector<uint32_t> old_rows, new_rows;
  for (uint32_t i = 0; i < before.count(); ++i) {
    if (taken[i] == 0 && before.opacity[i] >= kLeastOpacity) old_rows.push_back(i);
  }
  for (uint32_t j = 0; j < now.count(); ++j) {
    if ((*from)[j] == kNoRow && now.opacity[j] >= kLeastOpacity) new_rows.push_back(j);
  }
  if (old_rows.empty() || new_rows.empty()) return;
  std::vector<double> sizes;
  for (const uint32_t i : old_rows) sizes.push_back(size_of(before, i));
  std::nth_element(sizes.begin(), sizes.begin() + static_cast<ptrdiff_t>(sizes.size() / 2),
                   sizes.end());
  Grid grid;
  grid.cell = std::max(kSizes * sizes[sizes.size() / 2], 1e-30);
  constexpr int kHere[3] = {};
  const Buckets places(new_rows.size(), [&](size_t k) {
    double place[3];
    place_of(now, new_rows[k], nullptr, place);
    return grid.key(place, kHere);
  });
  // The nearest new row of each old one, and the old row that is nearest to each new one.
  std::vector<double> least(new_rows.size(), HUGE_VAL);
  std::vector<uint32_t> nearest_old(new_rows.size(), kNoRow), nearest_new(old_rows.size(), kNoRow);
  for (size_t o = 0; o < old_rows.size(); ++o) {
    const float* v = velocity_of(velocity, old_rows[o]);
    double place[3], best = 1;
    place_of(before, old_rows[o], v, place);
    for (int cell = 0; cell < 27; ++cell) {
      const int shift[3] = {cell % 3 - 1, cell / 3 % 3 - 1, cell / 9 - 1};
      places.each(grid.key(place, shift), [&](uint32_t k) {
        const double d = distance2(before, old_rows[o], v, now, new_rows[k]);
        if (d < best) {
          best = d;
          nearest_new[o] = k;
        }
        if (d < least[k]) {
          least[k] = d;
          nearest_old[k] = static_cast<uint32_t>(o);
        }
        return true;
      });
    }
  }
  for (size_t o = 0; o < old_rows.size(); ++o) {
    const uint32_t k = nearest_new[o];
    if (k != kNoRow && nearest_old[k] == o) (*from)[new_rows[k]] = old_rows[o];
  }
}

}  // namespace

std::vector<uint32_t> match_rows(const Frame& before, const std::vector<float>& velocity,
                                 const Frame& now, SequenceMatch match, bool* in_order) {
  std::vector<uint32_t> from(now.count(), kNoRow);
  *in_order = match == SequenceMatch::kOrder ||
              (match == SequenceMatch::kAuto && keeps_order(before, velocity, now));
  if (*in_order) {
    for (uint32_t i = 0; i < from.size() && i < before.count(); ++i) from[i] = i;
  } else if (match != SequenceMatch::kNone) {
    std::vector<char> taken(before.count(), 0);
    match_equal(before, velocity, now, &from, &taken);
    match_nearest(before, velocity, now, &from, taken);
  }
  return from;
}

}  // namespace l4d::io
