// SPDX-License-Identifier: Apache-2.0
// One parameter after the other, all else as one_stage() has it.
#include <array>
#include <cmath>

#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

constexpr std::array<const char*, L4D_COMPONENT_COUNT> kComponents = {
    "sh", "scale", "rotor-spatial", "rotor-temporal"};
// The paper's thresholds, "Small" (supplement, B.1).
constexpr std::array<double, L4D_COMPONENT_COUNT> kPaperThresholds = {6e-7, 2e-7, 1e-6, 8e-6};

std::vector<int> components(const Bench& bench) {
  // Scenes without motion or view dependence lack some; they do not occur here.
  return bench.take(std::vector<int>{L4D_COMPONENT_SH, L4D_COMPONENT_SCALE,
                                     L4D_COMPONENT_ROTOR_SPATIAL, L4D_COMPONENT_ROTOR_TEMPORAL});
}

}  // namespace

Json run_codebooks(Bench& bench) {
  Json rows = Json::array();
  for (const int c : components(bench)) {
    for (const double size : bench.take(std::vector<double>{1024, 4096, 16384})) {
      const std::string component = kComponents[static_cast<size_t>(c)];
      Json row = coded_row(bench, bench.real(),
                           one_stage().with(L4D_ENC_CODEBOOK_SIZE "." + component, size));
      row["name"] = component;
      row["size"] = size;
      bench.add(rows, row);
    }
  }
  return {{"sizes", rows}};
}

Json run_thresholds(Bench& bench) {
  Json rows = Json::array();
  // They are of sums of derivatives.
  Coding base = one_stage();
  base.metric = L4D_SENSITIVITY_SUM;
  Json none = coded_row(bench, bench.real(), base);
  none["name"] = "none";
  none["threshold"] = 0;
  bench.add(rows, none);
  for (const int c : components(bench)) {
    for (const int decade : bench.take(std::vector<int>{-2, -1, 0, 1})) {
      const double threshold = kPaperThresholds[static_cast<size_t>(c)] * std::pow(10.0, decade);
      const std::string component = kComponents[static_cast<size_t>(c)];
      const Encoded e = encode(bench, bench.real(),
                               base.with(L4D_ENC_ESCAPE_THRESHOLD "." + component, threshold));
      Json row = coding_row(bench, bench.real(), component, e);
      row["threshold"] = threshold;
      row["of_paper"] = std::pow(10.0, decade);
      bench.add(rows, row);
    }
  }
  return {{"thresholds", rows}};
}

Json run_rcq(Bench& bench) {
  Json rows = Json::array();
  const auto add = [&](const std::string& name, double mode, double size) {
    Coding c = one_stage();
    c.name = name;
    bench.add(rows, coded_row(bench, bench.real(),
                              c.with(L4D_ENC_RCQ, mode).with(L4D_ENC_RCQ_SIZE, size)));
  };
  add("off", 0, 512);
  add("where it pays, 512", 1, 512);
  for (const double size : bench.take(std::vector<double>{64, 256, 1024})) {
    add("forced, " + std::to_string(static_cast<int>(size)), 2, size);
  }
  return {{"sizes", rows}};
}

}  // namespace l4d::bench
