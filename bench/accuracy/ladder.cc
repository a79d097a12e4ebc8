// SPDX-License-Identifier: Apache-2.0
// From the paper's scheme to the preset `default`, one tool at a time.
#include <algorithm>
#include <cmath>
#include <utility>

#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

struct Step {
  std::string name;
  Coding coding;
  bool has_quality;  // what it codes follows the quality, which is then set for equal fidelity
};

std::vector<Step> steps() {
  std::vector<Step> all = {{"paper-small", preset("paper-small"), false}};
  // Each step adds to this.
  Coding c = one_stage().with(L4D_ENC_RANS, 0);
  c.metric = L4D_SENSITIVITY_SUM;
  const auto add = [&](const char* name, l4d_encoder_parameter id, double value,
                       int component = L4D_ALL_COMPONENTS) {
    c = c.with(id, value, component);
    all.push_back({name, c, id != L4D_ENC_RANS});
  };
  all.push_back({"one stage, no escapes", c, false});
  c = staged("", 1024, {1, .6f, .4f, .2f, .1f}, {1, .5f}).with(L4D_ENC_RANS, 0);
  c.metric = L4D_SENSITIVITY_SUM;
  all.push_back({"+ residual stages", c, false});
  c = c.with(L4D_ENC_REFINE, 2);
  all.push_back({"+ stages refined for each other", c, false});
  add("+ rANS", L4D_ENC_RANS, 1);
  add("+ fixed positions", L4D_ENC_FIXED_POSITIONS, 1);
  c = c.with(L4D_ENC_OPACITY_BITS, 0);
  add("+ mean times and opacities as coarse as they may be", L4D_ENC_MEAN_T_SHIFT, -1);
  add("+ transform of SH", L4D_ENC_CODING, 1, L4D_COMPONENT_SH);
  add("+ transform of scales", L4D_ENC_CODING, 1, L4D_COMPONENT_SCALE);
  c = c.with(L4D_ENC_CODING, 1, L4D_COMPONENT_ROTOR_SPATIAL);
  add("+ transform of rotors", L4D_ENC_CODING, 1, L4D_COMPONENT_ROTOR_TEMPORAL);
  c.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  all.push_back({"+ Gauss-Newton weights", c, true});
  add("+ pruning by rate and distortion", L4D_ENC_PRUNE_COST, 0.2);
  return all;
}

struct Tried {
  double quality = 0;
  Encoded encoded;
  double fidelity = 0;
};

// The encoding whose fidelity is nearest to the target, of few. They are nearly parallel to the
// quality.
Tried at_fidelity(Bench& bench, const Step& step, double target, double first) {
  constexpr int kTries = 4;
  constexpr double kClose = 0.05;
  const BenchScene& scene = bench.real();
  Tried best;
  double quality = first, below = 20, above = 70;
  for (int i = 0; i < kTries; ++i) {
    Tried t;
    t.quality = quality;
    t.encoded = encode(bench, scene, step.coding.with(L4D_ENC_QUALITY, quality));
    t.fidelity = bench.judge(scene).of_file(t.encoded.file).psnr;
    const double off = t.fidelity - target;
    (off > 0 ? above : below) = quality;
    if (i == 0 || std::fabs(off) < std::fabs(best.fidelity - target)) best = std::move(t);
    if (std::fabs(off) < kClose) break;
    const double next = quality - off;
    quality = next > below && next < above ? next : 0.5 * (below + above);
  }
  return best;
}

}  // namespace

Json run_ladder(Bench& bench) {
  const BenchScene& scene = bench.real();
  Json rows = Json::array();
  double target = 0, quality = 44;
  for (const Step& step : bench.take(steps())) {
    Tried t;
    if (step.has_quality && target > 0) {
      t = at_fidelity(bench, step, target, quality);
      quality = t.quality;
    } else {
      t.encoded = encode(bench, scene, step.coding);
      t.fidelity = bench.judge(scene).of_file(t.encoded.file).psnr;
      target = t.fidelity;
    }
    const auto& s = t.encoded.sections;
    Json row = {
        {"name", step.name},
        {"bytes", t.encoded.file.size()},
        {"ratio", t.encoded.ratio()},
        {"fidelity_db", t.fidelity},
        {"gaussians", t.encoded.order.size()},
        {"bits_per_gaussian", 8 * t.encoded.bytes() / static_cast<double>(scene.scene.count())},
        {"position_bytes", s[L4D_SECTION_POSITION]},
        {"sh_bytes", s[L4D_SECTION_SH]},
        {"encode_cpu_s", t.encoded.cpu_seconds}};
    if (t.quality > 0) row["quality"] = t.quality;
    bench.add(rows, row);
  }
  return {{"steps", rows}};
}

}  // namespace l4d::bench
