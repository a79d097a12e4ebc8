// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/kmeans_seed.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "encoder/search/nearest.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr size_t kPointGrain = 8192;

double squared_distance(const float* p, const std::vector<double>& centre) {
  double sum = 0;
  for (size_t j = 0; j < centre.size(); ++j) {
    const double e = static_cast<double>(p[j]) - centre[j];
    sum += e * e;
  }
  return sum;
}

std::vector<double> weighted_mean(const float* points, const float* weights, size_t n, size_t dim,
                                  int threads) {
  const size_t width = dim + 1;  // the total weight comes last
  std::vector<double> partial((n + kPointGrain - 1) / kPointGrain * width, 0.0);
  parallel_for(threads, n, kPointGrain, [&](size_t begin, size_t end) {
    double* sum = partial.data() + begin / kPointGrain * width;
    for (size_t i = begin; i < end; ++i) {
      const double w = static_cast<double>(weights[i]);
      for (size_t j = 0; j < dim; ++j) sum[j] += w * static_cast<double>(points[i * dim + j]);
      sum[dim] += w;
    }
  });
  std::vector<double> mean(width, 0.0);
  for (size_t p = 0; p < partial.size(); ++p) mean[p % width] += partial[p];
  const double total = mean[dim];
  mean.resize(dim);
  for (double& m : mean) m /= total;
  return mean;
}

// The factor a with sum min(1, a * share) = size: shares that reach 1 are certain and leave their
// excess to the others.
double chance_factor(const std::vector<double>& share, size_t size) {
  double factor = static_cast<double>(size);
  for (int pass = 0; pass < 16; ++pass) {
    double certain = 0, rest = 0;
    for (const double s : share) {
      if (factor * s >= 1) {
        ++certain;
      } else {
        rest += s;
      }
    }
    if (certain >= static_cast<double>(size) || rest <= 0) break;
    const double next = (static_cast<double>(size) - certain) / rest;
    if (!(next > factor)) break;
    factor = next;
  }
  return factor;
}

// `count` indices by the running sum of their mass, one from each of as many equal parts of it:
// neighbours in the order, which are mostly neighbours in the scene, seldom come together. Few may
// come twice. None where rounding at the very end of the sum has it so.
std::vector<uint32_t> draw_by_mass(const std::vector<double>& running, size_t count,
                                   Random& random) {
  const double part = running.back() / static_cast<double>(count);
  std::vector<uint32_t> out;
  double next = random.uniform() * part;
  auto at = running.begin();
  while (out.size() < count) {
    at = std::upper_bound(at, running.end(), next);
    if (at == running.end()) break;
    out.push_back(static_cast<uint32_t>(at - running.begin()));
    next = (static_cast<double>(out.size()) + random.uniform()) * part;
  }
  return out;
}

// Candidates come in index order; the first ones of a round are the surest to stay.
void shuffle(std::vector<uint32_t>& v, Random& random) {
  for (size_t i = v.size(); i > 1; --i) {
    std::swap(v[i - 1], v[static_cast<size_t>(random.uniform() * static_cast<double>(i))]);
  }
}

// Points to keep a distance from, a few side by side for vector instructions.
class Crowd {
 public:
  explicit Crowd(size_t dim) : dim_(dim) {}

  void add(const float* p) {
    if (count_ % kLanes == 0) groups_.resize(groups_.size() + dim_ * kLanes, 0.0f);
    float* group = groups_.data() + count_ / kLanes * dim_ * kLanes;
    for (size_t j = 0; j < dim_; ++j) group[j * kLanes + count_ % kLanes] = p[j];
    ++count_;
  }

  // Whether the squared distances to p are all above `limit`.
  bool is_clear_of(const float* p, float limit) const {
    for (size_t first = 0; first < count_; first += kLanes) {
      if (!group_is_clear(p, limit, groups_.data() + first * dim_,
                          std::min(kLanes, count_ - first))) {
        return false;
      }
    }
    return true;
  }

 private:
  static constexpr size_t kLanes = 8;
  static constexpr size_t kStep = 8;

  bool group_is_clear(const float* p, float limit, const float* group, size_t lanes) const {
    float total[kLanes] = {};
    for (size_t begin = 0; begin < dim_; begin += kStep) {
      const size_t end = std::min(dim_, begin + kStep);
      for (size_t j = begin; j < end; ++j) {
        for (size_t l = 0; l < kLanes; ++l) {
          const float e = p[j] - group[j * kLanes + l];
          total[l] += e * e;
        }
      }
      // Sums only grow: what is above the limit stays there.
      size_t above = 0;
      for (size_t l = 0; l < lanes; ++l) above += total[l] > limit;
      if (above == lanes) return true;
    }
    return false;
  }

  size_t dim_;
  size_t count_ = 0;
  std::vector<float> groups_;  // [groups, dim, kLanes]
};

// Turns draws by the distances before this round into draws one after the other: a candidate stays
// with the probability by which those that stayed before it have left its distance. What remains is
// distributed as k-means++ has it, and no two are equal.
std::vector<float> thin_out(const float* points, const std::vector<float>& sq_dist, size_t dim,
                            const std::vector<uint32_t>& candidates, Random& random) {
  std::vector<float> seeds;
  Crowd crowd(dim);
  for (const uint32_t i : candidates) {
    const float* p = points + size_t{i} * dim;
    const float known = sq_dist[i];
    // The draw comes first: distances beyond the one that decides need not be known.
    const float limit = static_cast<float>(random.uniform() * static_cast<double>(known));
    if (!crowd.is_clear_of(p, limit)) continue;
    crowd.add(p);
    seeds.insert(seeds.end(), p, p + dim);
  }
  return seeds;
}

}  // namespace

PointSample draw_sample(const float* points, const float* weights, size_t n, size_t dim,
                        size_t size, int threads, Random& random) {
  PointSample out;
  size_t positive = 0;
  for (size_t i = 0; i < n; ++i) positive += weights[i] > 0;
  if (positive <= size) {
    for (size_t i = 0; i < n; ++i) {
      if (!(weights[i] > 0)) continue;
      out.index.push_back(static_cast<uint32_t>(i));
      out.weight.push_back(weights[i]);
    }
    return out;
  }

  const std::vector<double> mean = weighted_mean(points, weights, n, dim, threads);
  std::vector<double> share(n);  // weighted squared distance from the mean, then the chance
  parallel_for(threads, n, kPointGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      share[i] = static_cast<double>(weights[i]) * squared_distance(points + i * dim, mean);
    }
  });
  double total_weight = 0, total_spread = 0;
  for (size_t i = 0; i < n; ++i) {
    total_weight += static_cast<double>(weights[i]);
    total_spread += share[i];
  }
  const bool spread_known = total_spread > 0 && std::isfinite(total_spread);
  parallel_for(threads, n, kPointGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const double by_weight = static_cast<double>(weights[i]) / total_weight;
      share[i] = spread_known ? 0.5 * (by_weight + share[i] / total_spread) : by_weight;
    }
  });
  const double factor = chance_factor(share, size);
  const auto chance = [&](size_t i) { return std::min(1.0, share[i] * factor); };
  const auto take = [&](size_t i) {
    out.index.push_back(static_cast<uint32_t>(i));
    out.weight.push_back(static_cast<float>(static_cast<double>(weights[i]) / chance(i)));
  };
  // Every point for itself: drawing at regular steps meets the period of periodic data.
  for (size_t i = 0; i < n; ++i) {
    if (random.uniform() < chance(i)) take(i);
  }
  if (out.index.empty()) {  // chance, in a sample of a few
    take(static_cast<size_t>(std::max_element(share.begin(), share.end()) - share.begin()));
  }
  return out;
}

Seeding seed_centroids(const float* points, const float* weights, size_t n, size_t dim, size_t k,
                       const NearestBackend& backend, Random& random) {
  // Candidates of a round, as a part of the seeds there are: the fewer, the fewer are in each
  // other's way; the more, the fewer passes over all points.
  constexpr size_t kGrowth = 2;
  Seeding out;
  out.labels.assign(n, 0);
  out.sq_dist.assign(n, std::numeric_limits<float>::infinity());
  if (n == 0) return out;

  std::vector<double> running(n);  // sum of the mass up to each point
  size_t wanted = 1;
  for (size_t have = 0; have < k;) {
    const auto mass = [&](size_t i) {
      const double weight = static_cast<double>(weights[i]);
      return have == 0 ? weight : weight * static_cast<double>(out.sq_dist[i]);
    };
    double total = 0;
    for (size_t i = 0; i < n; ++i) running[i] = total += mass(i);
    if (!(total > 0) || !std::isfinite(total)) break;  // mostly: every point is a seed
    std::vector<uint32_t> candidates = draw_by_mass(running, wanted, random);
    if (candidates.empty()) {
      size_t largest = 0;
      for (size_t i = 1; i < n; ++i) largest = mass(i) > mass(largest) ? i : largest;
      candidates.push_back(static_cast<uint32_t>(largest));
    }
    shuffle(candidates, random);
    const std::vector<float> seeds = thin_out(points, out.sq_dist, dim, candidates, random);
    const size_t count = seeds.size() / dim;
    update_nearest(points, n, dim, seeds.data(), count, static_cast<uint32_t>(have), backend,
                   out.labels.data(), out.sq_dist.data());
    out.centroids.insert(out.centroids.end(), seeds.begin(), seeds.end());
    have += count;
    wanted = std::min(k - have, std::max<size_t>(1, have / kGrowth));
  }
  return out;
}

}  // namespace l4d
