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

// Systematic sampling: visits the indices where the running sum of `mass` passes start + a whole
// number of steps. Neighbours in the order, which are mostly neighbours in the scene, seldom come
// together.
template <typename Visit>
void systematic(const std::vector<double>& mass, double step, double start, const Visit& visit) {
  double sum = 0, next = start * step;
  for (size_t i = 0; i < mass.size(); ++i) {
    sum += mass[i];
    if (!(sum > next)) continue;
    visit(i);
    next += step * std::ceil((sum - next) / step);
  }
}

// Two equal points may be drawn in one round; the second one then attracts nothing. Removes such seeds
// and returns how many are left. Seed s has the label `first` + s.
size_t drop_repeated(size_t first, size_t dim, std::vector<float>& seeds,
                     std::vector<uint32_t>& labels) {
  const size_t count = seeds.size() / dim;
  std::vector<uint32_t> moved(count, 0);
  for (const uint32_t label : labels) {
    if (label >= first) moved[label - first] = 1;
  }
  size_t kept = 0;
  for (size_t s = 0; s < count; ++s) {
    if (moved[s] == 0) continue;
    std::copy_n(seeds.begin() + static_cast<std::ptrdiff_t>(s * dim), dim,
                seeds.begin() + static_cast<std::ptrdiff_t>(kept * dim));
    moved[s] = static_cast<uint32_t>(first + kept++);
  }
  seeds.resize(kept * dim);
  if (kept == count) return kept;
  for (uint32_t& label : labels) {
    if (label >= first) label = moved[label - first];
  }
  return kept;
}

}  // namespace

PointSample draw_sample(const float* points, const float* weights, size_t n, size_t dim, size_t size,
                        int threads, Random& random) {
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
  systematic(share, 1.0, random.uniform(), take);
  if (out.index.empty()) {  // rounding, in a sample of one
    take(static_cast<size_t>(std::max_element(share.begin(), share.end()) - share.begin()));
  }
  return out;
}

Seeding seed_centroids(const float* points, const float* weights, size_t n, size_t dim, size_t k,
                       int threads, Random& random) {
  // Seeds of one round do not know of each other. Half as many again a round
  // does, within 0.3 % after Lloyd, and takes some twenty rounds for 4096.
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
    std::vector<float> seeds;
    systematic(mass, total / static_cast<double>(wanted), random.uniform(), [&](size_t i) {
      if (seeds.size() < wanted * dim) {
        seeds.insert(seeds.end(), points + i * dim, points + (i + 1) * dim);
      }
    });
    if (seeds.empty()) {  // rounding at the very end of the sum
      const size_t i = static_cast<size_t>(std::max_element(mass.begin(), mass.end()) - mass.begin());
      seeds.assign(points + i * dim, points + (i + 1) * dim);
    }
    update_nearest(points, n, dim, seeds.data(), seeds.size() / dim, static_cast<uint32_t>(have),
                   threads, out.labels.data(), out.sq_dist.data());
    const size_t added = drop_repeated(have, dim, seeds, out.labels);
    if (added == 0) break;
    out.centroids.insert(out.centroids.end(), seeds.begin(), seeds.end());
    have += added;
    wanted = std::min(k - have, std::max<size_t>(1, have / kGrowth));
    for (size_t i = 0; i < n; ++i) {
      mass[i] = static_cast<double>(weights[i]) * static_cast<double>(out.sq_dist[i]);
    }
  }
  return out;
}

}  // namespace l4d
