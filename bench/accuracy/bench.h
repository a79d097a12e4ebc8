// SPDX-License-Identifier: Apache-2.0
// What sections share: scenes, their weights and judges (made on first use), and rows of results.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/accuracy/coding.h"
#include "bench/accuracy/judge.h"
#include "bench/accuracy/weights.h"
#include "io/ply/weights.h"

namespace l4d::bench {

using Json = nlohmann::ordered_json;

struct BenchOptions {
  bool quick = false;          // a small synthetic scene instead of the real one, short sweeps
  uint64_t gaussians = 20000;  // of the scenes of a quick run
  size_t max_rows = SIZE_MAX;  // of a sweep
  std::string cache_dir = "build/accuracy";
};

// Where weights of half the views agree to this, measuring stops.
constexpr double kAgreement = 0.95;
constexpr double kDeviceAgreement = 0.99;  // the tool's default on a CUDA device

class Bench {
 public:
  explicit Bench(BenchOptions options) : options_(std::move(options)) {}

  bool quick() const { return options_.quick; }
  const BenchOptions& options() const { return options_; }

  const BenchScene& real();   // basketball; in a quick run the small synthetic scene
  const BenchScene& synth();  // the same in a quick run
  // Gaussians of scenes made for one table, fewer in a quick run.
  uint64_t synth_size(uint64_t full) const { return quick() ? options_.gaussians : full; }

  // measure: L4D_SENSITIVITY_*.
  const Measured& measured(const BenchScene& scene, uint32_t metric);
  const io::Weights& weights(const BenchScene& scene,
                             uint32_t metric = L4D_SENSITIVITY_GAUSS_NEWTON) {
    return measured(scene, metric).weights;
  }
  // All cameras at four instants.
  const Judge& judge(const BenchScene& scene);

  // At most max_rows values of a sweep, both ends among them.
  template <typename T>
  std::vector<T> take(const std::vector<T>& all) const {
    if (all.size() <= options_.max_rows) return all;
    std::vector<T> some;
    const size_t n = options_.max_rows;
    for (size_t i = 0; i < n; ++i) some.push_back(all[n > 1 ? i * (all.size() - 1) / (n - 1) : 0]);
    return some;
  }

  void begin(const std::string& section);
  void note(const std::string& text) const;  // progress, on stderr
  // Appends the row, with the command that makes it.
  void add(Json& table, Json row) const;

 private:
  BenchScene small_scene() const;

  BenchOptions options_;
  std::string section_;
  double started_ = 0;
  std::unique_ptr<BenchScene> real_, synth_;
  std::map<std::pair<const BenchScene*, uint32_t>, Measured> measured_;
  std::map<const BenchScene*, std::unique_ptr<Judge>> judges_;
};

// Bytes, ratio, fidelity and seconds of an encoding, as the columns of a row begin.
Json coding_row(Bench& bench, const BenchScene& scene, const std::string& name,
                const Encoded& encoded);
// Encodes with the scene's weights in the coding's measure.
Encoded encode(Bench& bench, const BenchScene& scene, const Coding& coding);
// ... and makes that row.
Json coded_row(Bench& bench, const BenchScene& scene, const Coding& coding);

}  // namespace l4d::bench
