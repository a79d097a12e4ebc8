// SPDX-License-Identifier: Apache-2.0
// What more time to encode codebooks buys: the nine settings of --effort.
#include <cmath>
#include <map>
#include <tuple>

#include "bench/accuracy/sections.h"
#include "l4d/experimental/parameters.h"

namespace l4d::bench {
namespace {

struct Try {
  double iterations, sample, zstd;
  bool operator<(const Try& o) const {
    return std::tie(iterations, sample, zstd) < std::tie(o.iterations, o.sample, o.zstd);
  }
};

// Of one scene: seconds of all threads and of the clock, bytes, dB, and dB at the bytes of the
// reference.
struct Outcome {
  double cpu_seconds = 0, seconds = 0, bytes = 0, fidelity = 0, merit = 0;
};

// What figures are relative to: effort 7.
constexpr Try kReference = {10, 24, 15};

Try of_effort(int effort) {
  EncoderHandle e;
  e.check(l4d_encoder_set(e.get(), L4D_ENC_EFFORT, effort));
  Try t{};
  e.check(l4d_encoder_get(e.get(), L4D_ENC_KMEANS_ITERATIONS, &t.iterations));
  e.check(l4d_encoder_get(e.get(), L4D_ENC_KMEANS_SAMPLE, &t.sample));
  e.check(l4d_encoder_get(e.get(), L4D_ENC_ZSTD_LEVEL, &t.zstd));
  return t;
}

// Outcomes on one scene, each setting encoded once. Fidelity at equal bytes: a file with more bytes
// than the reference's is charged what those bytes would bring if they went into a residual stage
// for half of the Gaussians instead; over that span dB are taken as linear in the logarithm of
// bytes.
class Trial {
 public:
  Trial(Bench& bench, const BenchScene& scene) : bench_(bench), scene_(scene) {
    reference_ = raw(kReference, {1});
    reference_.merit = reference_.fidelity;
    known_[kReference] = reference_;
    const Outcome finer = raw(kReference, {1, .5f});
    slope_ = (finer.fidelity - reference_.fidelity) / std::log2(finer.bytes / reference_.bytes);
  }
  double slope() const { return slope_; }  // dB per doubling of bytes
  const Outcome& reference() const { return reference_; }
  const Outcome& operator()(const Try& t) {
    const auto found = known_.find(t);
    if (found != known_.end()) return found->second;
    Outcome o = raw(t, {1});
    o.merit = o.fidelity - slope_ * std::log2(o.bytes / reference_.bytes);
    return known_[t] = o;
  }

 private:
  Outcome raw(const Try& t, const std::vector<double>& stages) {
    const Coding c = staged("", 4096, stages, stages)
                         .with(L4D_ENC_KMEANS_ITERATIONS, t.iterations)
                         .with(L4D_ENC_KMEANS_SAMPLE, t.sample)
                         .with(L4D_ENC_ZSTD_LEVEL, t.zstd);
    const Encoded e = encode(bench_, scene_, c);
    return {e.cpu_seconds, e.report.total_seconds, e.bytes(),
            bench_.judge(scene_).of_file(e.file).psnr, 0};
  }

  Bench& bench_;
  const BenchScene& scene_;
  Outcome reference_;
  double slope_ = 0;
  std::map<Try, Outcome> known_;
};

// Relative to the reference: geometric mean of time, mean of merit, over scenes.
struct Score {
  Try t;
  double time = 0, merit = 0;
};

Score score(std::vector<Trial>& trials, const Try& t) {
  Score s{t, 0, 0};
  for (Trial& trial : trials) {
    const Outcome& o = trial(t);
    s.time += std::log(o.cpu_seconds / trial.reference().cpu_seconds);
    s.merit += o.merit - trial.reference().fidelity;
  }
  s.time = std::exp(s.time / static_cast<double>(trials.size()));
  s.merit /= static_cast<double>(trials.size());
  return s;
}

Json score_row(const Score& s) {
  return {{"iterations", s.t.iterations},
          {"sample", s.t.sample},
          {"zstd_level", s.t.zstd},
          {"relative_time", s.time},
          {"merit_db", s.merit}};
}

void add_outcomes(Json& row, std::vector<Trial>& trials, const std::vector<std::string>& names,
                  const Try& t) {
  for (size_t i = 0; i < trials.size(); ++i) {
    const Outcome& o = trials[i](t);
    row[names[i] + "_cpu_s"] = o.cpu_seconds;
    row[names[i] + "_encode_s"] = o.seconds;
    row[names[i] + "_bytes"] = o.bytes;
    row[names[i] + "_fidelity_db"] = o.fidelity;
    row[names[i] + "_merit_db"] = o.merit;
  }
}

}  // namespace

Json run_effort(Bench& bench) {
  std::vector<Trial> trials;
  std::vector<std::string> names;
  Json tables;
  for (const char* table : {"slopes", "efforts"}) tables[table] = Json::array();
  std::vector<const BenchScene*> scenes = {&bench.real()};
  if (!bench.quick()) scenes.push_back(&bench.synth());
  for (const BenchScene* scene : scenes) {
    names.push_back(scene->name);
    trials.emplace_back(bench, *scene);
    bench.add(tables["slopes"],
              {{"name", scene->name}, {"db_per_doubling", trials.back().slope()}});
  }
  for (const int effort : bench.take(std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8, 9})) {
    const Try t = of_effort(effort);
    Json row = {{"effort", effort}};
    row.update(score_row(score(trials, t)));
    add_outcomes(row, trials, names, t);
    bench.add(tables["efforts"], row);
  }
  return tables;
}

}  // namespace l4d::bench
