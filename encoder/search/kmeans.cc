// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/kmeans.h"

#include <algorithm>
#include <memory>
#include <numeric>

#include "encoder/search/cells.h"
#include "encoder/search/kmeans_seed.h"
#include "encoder/search/nearest.h"
#include "encoder/search/principal_axes.h"
#include "encoder/search/random.h"
#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

// Below this a rotation costs more than it helps the search.
constexpr size_t kMinRotatedDim = 9;
constexpr double kMinGain = 1e-3;
// The last iterations are on a sample this many times as large.
constexpr size_t kWiden = 4;
constexpr int kWidePasses = 3;

// Points with their weights, all finite and positive in sum.
struct Points {
  const float* rows;     // [n, dim]
  const float* weights;  // [n]
  size_t n;
  size_t dim;
  int threads;
  NearestDevice* device;
  std::shared_ptr<NearestDevice::HeldPoints> held = nullptr;  // these rows

  NearestBackend backend() const { return {threads, device, held.get()}; }
  // For searches to come, of k codewords.
  void hold(size_t k) {
    if (device != nullptr) held = device->hold(rows, n, dim, k);
  }
};

struct CellMeans {
  std::vector<float> mean;         // [k, dim]
  std::vector<double> weight;      // [k], 0: the mean is not set
  std::vector<double> distortion;  // [k] weighted, to the mean as stored
};

// One thread sums each cell in index order, so the sums do not depend on the number of threads.
CellMeans cell_means(const Points& p, const std::vector<uint32_t>& labels, size_t k) {
  // A piece of fewer numbers would be done before another thread has begun.
  constexpr size_t kMinCells = 32, kMinNumbers = size_t{1} << 16;
  const size_t grain = std::max(kMinCells, k * kMinNumbers / std::max<size_t>(1, p.n * p.dim));
  const Cells cells = sort_into_cells(labels, k);
  CellMeans out;
  out.mean.assign(k * p.dim, 0.0f);
  out.weight.assign(k, 0.0);
  out.distortion.assign(k, 0.0);
  parallel_for(p.threads, k, grain, [&](size_t begin, size_t end) {
    std::vector<double> sum(p.dim);
    for (size_t c = begin; c < end; ++c) {
      std::fill(sum.begin(), sum.end(), 0.0);
      double weight = 0;
      for (size_t m = cells.start[c]; m < cells.start[c + 1]; ++m) {
        const size_t i = cells.index[m];
        const double w = static_cast<double>(p.weights[i]);
        const float* row = p.rows + i * p.dim;
        for (size_t j = 0; j < p.dim; ++j) sum[j] += w * static_cast<double>(row[j]);
        weight += w;
      }
      if (!(weight > 0)) continue;
      float* mean = out.mean.data() + c * p.dim;
      for (size_t j = 0; j < p.dim; ++j) mean[j] = static_cast<float>(sum[j] / weight);
      double distortion = 0;
      for (size_t m = cells.start[c]; m < cells.start[c + 1]; ++m) {
        const size_t i = cells.index[m];
        double squares = 0;
        for (size_t j = 0; j < p.dim; ++j) {
          const double e =
              static_cast<double>(p.rows[i * p.dim + j]) - static_cast<double>(mean[j]);
          squares += e * e;
        }
        distortion += static_cast<double>(p.weights[i]) * squares;
      }
      out.weight[c] = weight;
      out.distortion[c] = distortion;
    }
  });
  return out;
}

// Gives empty cells the points that are served worst: largest weight x squared distance, then
// lowest index. Cells for which no badly served point is left keep weight 0.
void fill_empty_cells(const Points& p, const std::vector<float>& sq_dist, CellMeans* cells) {
  std::vector<size_t> empty;
  for (size_t c = 0; c < cells->weight.size(); ++c) {
    if (!(cells->weight[c] > 0)) empty.push_back(c);
  }
  if (empty.empty()) return;
  const auto need = [&](uint32_t i) {
    return static_cast<double>(p.weights[i]) * static_cast<double>(sq_dist[i]);
  };
  std::vector<uint32_t> worst(p.n);
  std::iota(worst.begin(), worst.end(), 0u);
  const size_t count = std::min(empty.size(), p.n);
  std::partial_sort(worst.begin(), worst.begin() + static_cast<std::ptrdiff_t>(count), worst.end(),
                    [&](uint32_t a, uint32_t b) {
                      const double na = need(a), nb = need(b);
                      return na != nb ? na > nb : a < b;
                    });
  for (size_t e = 0; e < count && need(worst[e]) > 0; ++e) {
    std::copy_n(p.rows + worst[e] * p.dim, p.dim, cells->mean.data() + empty[e] * p.dim);
    cells->weight[empty[e]] = static_cast<double>(p.weights[worst[e]]);
  }
}

// Removes cells of no weight. Labels of points in cells that stay are moved along.
void drop_empty_cells(size_t dim, CellMeans* cells, std::vector<uint32_t>* labels) {
  const size_t k = cells->weight.size();
  std::vector<uint32_t> moved(k, 0);
  size_t kept = 0;
  for (size_t c = 0; c < k; ++c) {
    if (!(cells->weight[c] > 0)) continue;
    std::copy_n(cells->mean.data() + c * dim, dim, cells->mean.data() + kept * dim);
    cells->weight[kept] = cells->weight[c];
    cells->distortion[kept] = cells->distortion[c];
    moved[c] = static_cast<uint32_t>(kept++);
  }
  cells->mean.resize(kept * dim);
  cells->weight.resize(kept);
  cells->distortion.resize(kept);
  for (uint32_t& label : *labels) label = moved[label];
}

double weighted_sum(const float* weights, const std::vector<float>& sq_dist) {
  double sum = 0;
  for (size_t i = 0; i < sq_dist.size(); ++i) {
    sum += static_cast<double>(weights[i]) * static_cast<double>(sq_dist[i]);
  }
  return sum;
}

bool is_cancelled(const KMeansOptions& options) {
  return options.cancelled != nullptr && (*options.cancelled)();
}

// Labels of the points after seeding and Lloyd iterations; *k becomes the number of cells.
std::vector<uint32_t> cluster(const Points& p, const KMeansOptions& options, Random& random,
                              size_t* k) {
  Seeding s = seed_centroids(p.rows, p.weights, p.n, p.dim, *k, p.backend(), random);
  // Points that defeat seeding (sums beyond the range of a double) are one cell.
  *k = std::max<size_t>(1, s.centroids.size() / p.dim);
  double distortion = weighted_sum(p.weights, s.sq_dist);
  for (int i = 0; i<options.iterations&& * k> 1 && !is_cancelled(options); ++i) {
    CellMeans cells = cell_means(p, s.labels, *k);
    fill_empty_cells(p, s.sq_dist, &cells);
    drop_empty_cells(p.dim, &cells, &s.labels);
    *k = cells.weight.size();
    assign_nearest(p.rows, p.n, p.dim, cells.mean.data(), *k, p.backend(), s.labels.data(),
                   s.labels.data(), s.sq_dist.data(), Axes::kPrincipal);
    const double before = distortion;
    distortion = weighted_sum(p.weights, s.sq_dist);
    if (!(before - distortion >= kMinGain * before)) break;
  }
  return s.labels;
}

// Lloyd iterations on a wider sample. The narrow one fits its own points better than others:
// without these, codebooks are 3 % worse on all points.
void refine(Points p, const KMeansOptions& options, CellMeans* cells) {
  p.hold(cells->weight.size());
  std::vector<uint32_t> labels(p.n);
  std::vector<float> sq_dist(p.n);
  for (int pass = 0; pass < kWidePasses && !is_cancelled(options); ++pass) {
    assign_nearest(p.rows, p.n, p.dim, cells->mean.data(), cells->weight.size(), p.backend(),
                   pass == 0 ? nullptr : labels.data(), labels.data(), sq_dist.data());
    *cells = cell_means(p, labels, cells->weight.size());
    fill_empty_cells(p, sq_dist, cells);
    drop_empty_cells(p.dim, cells, &labels);
  }
}

// `per` points for each of k, n at most.
size_t sample_size(size_t k, size_t per, size_t n) {
  per = std::max<size_t>(per, 1);
  return k > n / per ? n : k * per;
}

// A sample of points that owns its rows, or stands for the points themselves where it is all of
// them.
struct SampledPoints {
  static constexpr size_t kGatherNumbers = size_t{1} << 16;  // of a piece

  std::unique_ptr<float[]> rows;  // not set to anything before the threads that fill it do
  std::vector<float> weights;
  Points points;

  void draw(const Points& from, size_t size, Random& random) {
    PointSample sample =
        draw_sample(from.rows, from.weights, from.n, from.dim, size, from.threads, random);
    points = from;
    if (sample.index.size() == from.n) return;
    const size_t dim = from.dim;
    rows.reset(new float[sample.index.size() * dim]);
    parallel_for(from.threads, sample.index.size(), std::max<size_t>(1, kGatherNumbers / dim),
                 [&](size_t begin, size_t end) {
                   for (size_t i = begin; i < end; ++i) {
                     std::copy_n(from.rows + size_t{sample.index[i]} * dim, dim,
                                 rows.get() + i * dim);
                   }
                 });
    weights = std::move(sample.weight);
    points.rows = rows.get();
    points.weights = weights.data();
    points.n = weights.size();
    points.held = nullptr;
  }
};

}  // namespace

Codebook train_codebook(const float* points, const float* weights, size_t n, size_t dim,
                        const KMeansOptions& options) {
  Codebook out;
  out.dim = dim;
  if (n == 0 || dim == 0) return out;
  std::vector<float> ones;
  if (weights == nullptr || std::none_of(weights, weights + n, [](float w) { return w > 0; })) {
    ones.assign(n, 1.0f);
    weights = ones.data();
  }
  Random random(options.seed);
  size_t k = std::clamp<size_t>(options.num_codewords, 1, n);
  const size_t size = sample_size(k, options.sample_per_codeword, n);

  SampledPoints wide, narrow;
  wide.draw({points, weights, n, dim, options.threads, options.device},
            sample_size(size, kWiden, n), random);
  narrow.draw(wide.points, size, random);

  // Clusters are found along principal axes, where the search is fastest; means are then taken of
  // the points as they came, so that nothing is rounded twice.
  std::vector<float> rotated;
  Points training = narrow.points;
  if (dim >= kMinRotatedDim && k > 1) {
    const PrincipalAxes axes = find_principal_axes(training.rows, training.n, dim);
    if (!axes.basis.empty()) {
      rotated.resize(training.n * dim);
      rotate_to_axes(axes, training.rows, training.n, dim, options.threads, rotated.data());
      training.rows = rotated.data();
    }
  }
  training.hold(k);
  std::vector<uint32_t> labels = cluster(training, options, random, &k);
  training.held = nullptr;
  CellMeans cells = cell_means(narrow.points, labels, k);
  drop_empty_cells(dim, &cells, &labels);
  if (wide.points.n > narrow.points.n) refine(wide.points, options, &cells);
  out.entries = std::move(cells.mean);
  out.weighted_distortion = std::accumulate(cells.distortion.begin(), cells.distortion.end(), 0.0);
  return out;
}

}  // namespace l4d
