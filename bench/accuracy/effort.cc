// SPDX-License-Identifier: Apache-2.0
// What more time to encode buys: the nine settings of --effort, and a grid around them from which
// better ones are proposed.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <tuple>

#include "bench/accuracy/sections.h"

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

constexpr int kEfforts = 9;
// The grid's centre, and what figures are relative to: effort 5 at the time of writing.
constexpr Try kReference = {10, 24, 12};

Try of_effort(int effort) {
  EncoderHandle e;
  e.check(l4d_encoder_set(e.get(), L4D_ENC_EFFORT, L4D_ALL_COMPONENTS, effort));
  Try t{};
  e.check(l4d_encoder_get(e.get(), L4D_ENC_KMEANS_ITERATIONS, L4D_ALL_COMPONENTS, &t.iterations));
  e.check(l4d_encoder_get(e.get(), L4D_ENC_KMEANS_SAMPLE, L4D_ALL_COMPONENTS, &t.sample));
  e.check(l4d_encoder_get(e.get(), L4D_ENC_ZSTD_LEVEL, L4D_ALL_COMPONENTS, &t.zstd));
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
  Outcome raw(const Try& t, const std::vector<float>& stages) {
    Coding c;
    c.settings = {{L4D_ENC_CODEBOOK_SIZE, L4D_ALL_COMPONENTS, 4096},
                  {L4D_ENC_KMEANS_ITERATIONS, L4D_ALL_COMPONENTS, t.iterations},
                  {L4D_ENC_KMEANS_SAMPLE, L4D_ALL_COMPONENTS, t.sample},
                  {L4D_ENC_ZSTD_LEVEL, L4D_ALL_COMPONENTS, t.zstd}};
    c.sh_stages = c.geometry_stages = stages;
    const Encoded e = encode(scene_.scene, bench_.weights(scene_), c);
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

std::vector<Try> grid(const Bench& bench) {
  std::vector<Try> tries;
  for (const double i : bench.take(std::vector<double>{0, 1, 2, 4, 10, 24})) {
    for (const double s : bench.take(std::vector<double>{4, 8, 16, 32}))
      tries.push_back({i, s, 15});
  }
  // zstd works on what k-means has left; the two are taken as independent but at the ends.
  for (const double z : bench.take(std::vector<double>{1, 3, 6, 15, 19, 22})) {
    tries.push_back({kReference.iterations, kReference.sample, z});
  }
  for (const Try& t : bench.take(std::vector<Try>{
           {0, 2, 1}, {0, 4, 1}, {1, 4, 1}, {1, 4, 6}, {24, 48, 19}, {40, 1000, 22}})) {
    tries.push_back(t);
  }
  return tries;
}

// Those that no other beats in both time and merit, fastest first.
std::vector<Score> pareto_front(std::vector<Score> all) {
  std::sort(all.begin(), all.end(), [](const Score& a, const Score& b) {
    return a.time != b.time ? a.time < b.time : a.merit > b.merit;
  });
  std::vector<Score> front;
  for (const Score& s : all) {
    if (front.empty() || s.merit > front.back().merit) front.push_back(s);
  }
  return front;
}

// Nine of the front, from its fastest to its best: the best that each of nine times allows, which
// grow by one factor.
std::vector<Score> propose(const std::vector<Score>& front) {
  std::vector<Score> chosen;
  for (int effort = 0; effort < kEfforts; ++effort) {
    const double share = static_cast<double>(effort) / (kEfforts - 1);
    // A touch more than that time, or rounding loses the last.
    const double allowed =
        1.001 * front.front().time * std::pow(front.back().time / front.front().time, share);
    size_t best = 0;
    while (best + 1 < front.size() && front[best + 1].time <= allowed) ++best;
    chosen.push_back(front[best]);
  }
  return chosen;
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
  for (const char* table : {"slopes", "efforts", "grid", "front", "proposal"}) {
    tables[table] = Json::array();
  }
  std::vector<const BenchScene*> scenes = {&bench.real()};
  if (!bench.quick()) scenes.push_back(&bench.synth());
  for (const BenchScene* scene : scenes) {
    names.push_back(scene->name);
    trials.emplace_back(bench, *scene);
    bench.add(tables["slopes"],
              {{"name", scene->name}, {"db_per_doubling", trials.back().slope()}});
  }
  std::vector<Score> all;
  const auto add = [&](Json& table, Json row, const Try& t) {
    all.push_back(score(trials, t));
    row.update(score_row(all.back()));
    add_outcomes(row, trials, names, t);
    bench.add(table, row);
  };
  for (const int effort : bench.take(std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8, 9})) {
    add(tables["efforts"], {{"effort", effort}}, of_effort(effort));
  }
  for (const Try& t : grid(bench)) add(tables["grid"], Json::object(), t);
  const std::vector<Score> front = pareto_front(all);
  for (const Score& s : front) bench.add(tables["front"], score_row(s));
  int effort = 0;
  for (const Score& s : propose(front)) {
    Json row = {{"effort", ++effort}};
    row.update(score_row(s));
    bench.add(tables["proposal"], row);
  }
  return tables;
}

}  // namespace l4d::bench
