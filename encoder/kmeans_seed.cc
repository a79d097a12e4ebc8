// SPDX-License-Identifier: Apache-2.0
#include "encoder/kmeans_seed.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "encoder/nearest.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

constexpr size_t kGrain = 8192;

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
  std::vector<double> partial((n + kGrain - 1) / kGrain * width, 0.0);
  parallel_for(threads, n, kGrain, [&](size_t begin, size_t end) {
    double* sum = partial.data() + begin / kGrain * width;
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

// `count` indices by `mass`, one from each of as many equal parts of the running sum: neighbours in
// the order, which are mostly neighbours in the scene, seldom come together. Few may come twice.
std::vector<uint32_t> draw_by_mass(const std::vector<double>& mass, double total, size_t count,
                                   Random& random) {
  const double part = total / static_cast<double>(count);
  std::vector<uint32_t> out;
  double sum = 0;
  double next = random.uniform() * part;
  for (size_t i = 0; i < mass.size() && out.size() < count; ++i) {
    sum += mass[i];
    while (sum > next && out.size() < count) {
      out.push_back(static_cast<uint32_t>(i));
      next = (static_cast<double>(out.size()) + random.uniform()) * part;
    }
  }
  if (out.empty()) {  // rounding at the very end of the sum
    out.push_back(static_cast<uint32_t>(std::max_element(mass.begin(), mass.end()) - mass.begin()));
  }
  return out;
}

// Candidates come in index order; the first ones of a round are the surest to stay.
void shuffle(std::vector<uint32_t>& v, Random& random) {
  for (size_t i = v.size(); i > 1; --i) {
    std::swap(v[i - 1], v[static_cast<size_t>(random.uniform() * static_cast<double>(i))]);
  }
}

// Squared distance, or any value above `enough` once it is known to exceed that.
float bounded_distance(const float* a, const float* b, size_t dim, float enough) {
  constexpr size_t kStep = 8;
  float total = 0;
  for (size_t begin = 0; begin < dim && total <= enough; begin += kStep) {
    const size_t end = std::min(dim, begin + kStep);
    for (size_t j = begin; j < end; ++j) total += (a[j] - b[j]) * (a[j] - b[j]);
  }
  return total;
}

// Turns draws by the distances before this round into draws one after the other: a candidate stays
// with the probability by which those that stayed before it have left its distance. What remains is
// distributed as k-means++ has it, and no two are equal.
std::vector<float> thin_out(const float* points, const std::vector<float>& sq_dist, size_t dim,
                            const std::vector<uint32_t>& candidates, Random& random) {
  std::vector<float> seeds;
  for (const uint32_t i : candidates) {
    const float* p = points + size_t{i} * dim;
    const float known = sq_dist[i];
    // The draw comes first: distances beyond the one that decides need not be known.
    const float limit = static_cast<float>(random.uniform() * static_cast<double>(known));
    bool stays = true;
    for (size_t s = 0; s < seeds.size() && stays; s += dim) {
      stays = bounded_distance(p, seeds.data() + s, dim, limit) > limit;
    }
    if (stays) seeds.insert(seeds.end(), p, p + dim);
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
  parallel_for(threads, n, kGrain, [&](size_t begin, size_t end) {
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
  for (size_t i = 0; i < n; ++i) {
    const double by_weight = static_cast<double>(weights[i]) / total_weight;
    share[i] = spread_known ? 0.5 * (by_weight + share[i] / total_spread) : by_weight;
  }
  const double factor = chance_factor(share, size);
  for (double& s : share) s = std::min(1.0, s * factor);
  const auto take = [&](size_t i) {
    out.index.push_back(static_cast<uint32_t>(i));
    out.weight.push_back(static_cast<float>(static_cast<double>(weights[i]) / share[i]));
  };
  // Every point for itself: drawing at regular steps meets the period of periodic data.
  for (size_t i = 0; i < n; ++i) {
    if (random.uniform() < share[i]) take(i);
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

  std::vector<double> mass(weights, weights + n);
  size_t wanted = 1;
  for (size_t have = 0; have < k;) {
    double total = 0;
    for (const double m : mass) total += m;
    if (!(total > 0) || !std::isfinite(total)) break;  // mostly: every point is a seed
    std::vector<uint32_t> candidates = draw_by_mass(mass, total, wanted, random);
    shuffle(candidates, random);
    const std::vector<float> seeds = thin_out(points, out.sq_dist, dim, candidates, random);
    const size_t count = seeds.size() / dim;
    update_nearest(points, n, dim, seeds.data(), count, static_cast<uint32_t>(have), backend,
                   out.labels.data(), out.sq_dist.data());
    out.centroids.insert(out.centroids.end(), seeds.begin(), seeds.end());
    have += count;
    wanted = std::min(k - have, std::max<size_t>(1, have / kGrowth));
    for (size_t i = 0; i < n; ++i) {
      mass[i] = static_cast<double>(weights[i]) * static_cast<double>(out.sq_dist[i]);
    }
  }
  return out;
}

}  // namespace l4d
