// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/bench.h"

#include <cstdio>

#include "bench/accuracy/timing.h"

namespace l4d::bench {

BenchScene Bench::small_scene() const {
  io::SynthOptions o;
  o.gaussians = options_.gaussians;
  o.seconds = 2;
  return make_synth(o, 8, 160, 90);
}

const BenchScene& Bench::real() {
  if (!real_) {
    note("loading the scene");
    real_ = std::make_unique<BenchScene>(quick() ? small_scene() : load_basketball());
  }
  return *real_;
}

const BenchScene& Bench::synth() {
  if (quick()) return real();
  if (!synth_) {
    note("making the synthetic scene");
    io::SynthOptions o;
    o.gaussians = 300000;
    o.seconds = 5;
    synth_ = std::make_unique<BenchScene>(make_synth(o, 16, 640, 360));
  }
  return *synth_;
}

const Measured& Bench::measured(const BenchScene& scene, uint32_t metric) {
  const auto key = std::make_pair(&scene, metric);
  const auto found = measured_.find(key);
  if (found != measured_.end()) return found->second;
  std::string name = metric == L4D_SENSITIVITY_SUM ? "weights-sum" : "weights-gauss-newton";
  note("measuring " + name + " of " + scene.name);
  l4d_measure_options options = measure_options(metric, kAgreement);
  if (quick()) name += "-quick";
  if (&scene == synth_.get()) {
    // Only there for a second opinion, so few views do.
    options.max_share = 1.0 / 8;
    options.skip_visibility = 1;
    name += "-synth";
  }
  return measured_[key] = measure_cached(scene, options, options_.cache_dir + "/" + name + ".bin");
}

const Judge& Bench::judge(const BenchScene& scene) {
  std::unique_ptr<Judge>& judge = judges_[&scene];
  if (!judge) {
    note("rendering the original");
    const std::vector<uint32_t> frames = scene.name == "basketball"
                                             ? std::vector<uint32_t>{0, 45, 90, 135}
                                             : scene.frames(quick() ? 2 : 4);
    judge = std::make_unique<Judge>(scene, frames);
  }
  return *judge;
}

void Bench::begin(const std::string& section) {
  section_ = section;
  started_ = seconds_now();
}

void Bench::note(const std::string& text) const {
  std::fprintf(stderr, "[%6.1f s] %s: %s\n", seconds_now() - started_, section_.c_str(),
               text.c_str());
}

void Bench::add(Json& table, Json row) const {
  std::string text;
  for (const auto& [key, value] : row.items()) {
    text += (text.empty() ? "" : "  ");
    char number[64];
    if (value.is_number()) {
      std::snprintf(number, sizeof number, "%s=%.6g", key.c_str(), value.get<double>());
      text += number;
    } else if (value.is_string()) {
      text += value.get<std::string>();
    }
  }
  note(text);
  table.push_back(std::move(row));
}

Json coding_row(Bench& bench, const BenchScene& scene, const std::string& name,
                const Encoded& encoded) {
  const io::Fidelity f = bench.judge(scene).of_file(encoded.file);
  return {{"name", name},
          {"bytes", encoded.file.size()},
          {"ratio", encoded.ratio()},
          {"fidelity_db", f.psnr},
          {"encode_cpu_s", encoded.cpu_seconds}};
}

Encoded encode(Bench& bench, const BenchScene& scene, const Coding& coding) {
  return encode(scene.scene, bench.weights(scene, coding.metric), coding);
}

Json coded_row(Bench& bench, const BenchScene& scene, const Coding& coding) {
  return coding_row(bench, scene, coding.name, encode(bench, scene, coding));
}

}  // namespace l4d::bench
