// SPDX-License-Identifier: Apache-2.0
// Nearest codeword, K = 4096: points per second, and the GFLOP/s a scan of all codewords would need
// to keep up (3 operations per coordinate and pair). Training on as many points.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "encoder/search/kmeans.h"
#include "encoder/search/nearest.h"
#include "encoder/search/random.h"
#include "io/ply/scene_ply.h"
#include "io/ply/weights.h"

namespace l4d {
namespace {

constexpr size_t kEntries = 4096;

struct Vectors {
  std::vector<float> points;   // [n, dim]
  std::vector<float> weights;  // [n]
  std::vector<float> codebook;
  std::vector<uint32_t> labels;
  std::vector<float> sq_dist;
};

// The real scene ($L4D_DATA_DIR, else ../shared/data) where there is one, as how much can be
// skipped depends on the data; else points around random centres.
Vectors make_vectors(size_t dim) {
  Vectors v;
  const char* set = std::getenv("L4D_DATA_DIR");
  const std::string folder = std::string(set != nullptr ? set : "../shared/data") + "/basketball/";
  if (std::filesystem::exists(folder + "basketball.ply")) {
    io::Scene scene = io::read_scene_ply(folder + "basketball.ply");
    v.weights = io::read_weights_ply(folder + "basketball-weights.ply").alpha_t;
    if (dim == 48) {
      v.points = std::move(scene.sh);
      return v;
    }
    for (size_t i = 0; i < scene.count(); ++i) {  // the temporal half of the rotor
      v.points.insert(v.points.end(), scene.rotor.data() + i * 8 + 4,
                      scene.rotor.data() + i * 8 + 8);
    }
    return v;
  }
  constexpr size_t kPoints = 200000, kCentres = 20000;
  Random random(1);
  std::vector<float> centre(kCentres * dim);
  for (size_t j = 0; j < centre.size(); ++j) {
    centre[j] = static_cast<float>((random.uniform() - 0.5) / static_cast<double>(1 + j % dim));
  }
  for (size_t i = 0; i < kPoints; ++i) {
    const float* c = centre.data() + random.next() % kCentres * dim;
    for (size_t j = 0; j < dim; ++j) {
      v.points.push_back(c[j] + static_cast<float>(0.02 * (random.uniform() - 0.5)));
    }
  }
  v.weights.assign(kPoints, 1.0f);
  return v;
}

const Vectors& vectors_with_codebook(size_t dim) {
  static const auto make = [](size_t d) {
    Vectors v = make_vectors(d);
    KMeansOptions options;
    options.num_codewords = kEntries;
    v.codebook =
        train_codebook(v.points.data(), v.weights.data(), v.weights.size(), d, options).entries;
    v.labels.resize(v.weights.size());
    v.sq_dist.resize(v.weights.size());
    assign_nearest(v.points.data(), v.weights.size(), d, v.codebook.data(), v.codebook.size() / d,
                   0, nullptr, v.labels.data(), v.sq_dist.data());
    return v;
  };
  static const Vectors sh = make(48);
  static const Vectors rotor = make(4);
  return dim == 48 ? sh : rotor;
}

using Assign = void (*)(const Vectors& v, size_t n, size_t dim, int threads, bool hint,
                        uint32_t* labels, float* sq_dist);

void reference(const Vectors& v, size_t n, size_t dim, int threads, bool, uint32_t* labels,
               float* sq_dist) {
  assign_nearest_reference(v.points.data(), n, dim, v.codebook.data(), v.codebook.size() / dim,
                           threads, nullptr, labels, sq_dist);
}

void simd(const Vectors& v, size_t n, size_t dim, int threads, bool hint, uint32_t* labels,
          float* sq_dist) {
  assign_nearest(v.points.data(), n, dim, v.codebook.data(), v.codebook.size() / dim, threads,
                 hint ? v.labels.data() : nullptr, labels, sq_dist);
}

// Arguments: dim, threads, hint, most points.
void assign_bench(benchmark::State& state, Assign assign) {
  const size_t dim = static_cast<size_t>(state.range(0));
  const Vectors& v = vectors_with_codebook(dim);
  const size_t n = std::min(v.weights.size(), static_cast<size_t>(state.range(3)));
  std::vector<uint32_t> labels(n);
  std::vector<float> sq_dist(n);
  for (auto _ : state) {
    assign(v, n, dim, static_cast<int>(state.range(1)), state.range(2) != 0, labels.data(),
           sq_dist.data());
    benchmark::DoNotOptimize(labels.data());
  }
  const double points = static_cast<double>(state.iterations()) * static_cast<double>(n);
  const double flop =
      3e-9 * static_cast<double>(dim) * static_cast<double>(v.codebook.size() / dim);
  state.counters["points/s"] = benchmark::Counter(points, benchmark::Counter::kIsRate);
  state.counters["GFLOP/s"] = benchmark::Counter(points * flop, benchmark::Counter::kIsRate);
}

void train_bench(benchmark::State& state) {
  const size_t dim = static_cast<size_t>(state.range(0));
  const Vectors& v = vectors_with_codebook(dim);
  KMeansOptions options;
  options.num_codewords = kEntries;
  options.threads = static_cast<int>(state.range(1));
  double distortion = 0;
  for (auto _ : state) {
    distortion = train_codebook(v.points.data(), v.weights.data(), v.weights.size(), dim, options)
                     .weighted_distortion;
  }
  state.counters["points"] = static_cast<double>(v.weights.size());
  state.counters["distortion"] = distortion;
}

constexpr int64_t kFew = 2000;
constexpr int64_t kAll = int64_t{1} << 40;

BENCHMARK_CAPTURE(assign_bench, reference, reference)
    ->ArgNames({"dim", "threads", "hint", "points"})
    ->Args({48, 1, 0, kFew})
    ->Args({4, 1, 0, kFew})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(assign_bench, simd, simd)
    ->ArgNames({"dim", "threads", "hint", "points"})
    ->Args({48, 1, 0, kAll})
    ->Args({48, 1, 1, kAll})
    ->Args({48, 0, 0, kAll})
    ->Args({4, 1, 0, kAll})
    ->Args({4, 1, 1, kAll})
    ->Args({4, 0, 0, kAll})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(train_bench)
    ->ArgNames({"dim", "threads"})
    ->Args({48, 1})
    ->Args({48, 0})
    ->Args({4, 1})
    ->Args({4, 0})
    ->UseRealTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace l4d
