// SPDX-License-Identifier: Apache-2.0
// How many views the weights need, which measure serves best, and what pruning by blending weight
// costs.
#include <cstdio>

#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

Coding high() {
  Coding c;
  c.preset = "high";
  return c;
}

struct Selection {
  std::string name;
  double agreement;  // above 1: never stops for it
  double max_share;
};

std::vector<Selection> shares() {
  return {
      {"1/108", 2, 1.0 / 108}, {"1/54", 2, 1.0 / 54}, {"1/27", 2, 1.0 / 27}, {"2/27", 2, 2.0 / 27},
      {"4/27", 2, 4.0 / 27},   {"8/27", 2, 8.0 / 27}, {"all", 2, 1}};
}

std::vector<Selection> agreements() {
  return {{"0.8", 0.8, 1}, {"0.9", 0.9, 1}, {"0.95", kAgreement, 1}, {"0.98", 0.98, 1}};
}

// The views left out are asked nothing: that is a row of its own.
Measured measure_only(const BenchScene& scene, const Selection& s) {
  l4d_measure_options options = measure_options(s.agreement, s.max_share);
  options.skip_unseen = 1;
  return measure(scene, options);
}

Json measured_row(Bench& bench, const std::string& name, const Measured& m) {
  const BenchScene& scene = bench.real();
  const io::Weights& all = bench.measured_all_views().weights;
  Json row = coding_row(bench, scene, name, encode(scene.scene, m.weights, high()));
  const Json measured = {
      {"views_measured", m.report.views_measured},
      {"views_asked", m.report.views_asked},
      {"measure_s", m.seconds},
      {"unseen", m.report.unseen},
      {"spearman_sh", rank_correlation(m.weights.sh, all.sh)},
      {"spearman_scale", rank_correlation(m.weights.scale, all.scale)},
      {"spearman_rotor_spatial", rank_correlation(m.weights.rotor_spatial, all.rotor_spatial)},
      {"spearman_rotor_temporal", rank_correlation(m.weights.rotor_temporal, all.rotor_temporal)}};
  row.update(measured);
  return row;
}

}  // namespace

Json run_sensitivity(Bench& bench) {
  const BenchScene& scene = bench.real();
  Json tables = {{"views", Json::array()},
                 {"agreement", Json::array()},
                 {"measures", Json::array()},
                 {"pruning", Json::array()}};
  for (const Selection& s : bench.take(shares())) {
    bench.add(tables["views"],
              measured_row(bench, s.name,
                           s.max_share < 1 ? measure_only(scene, s) : bench.measured_all_views()));
  }
  for (const Selection& s : bench.take(agreements())) {
    bench.add(tables["agreement"], measured_row(bench, s.name, measure_only(scene, s)));
  }
  bench.add(tables["agreement"],
            measured_row(bench, "0.95, others asked what they show", bench.measured(scene)));
  bench.add(tables["measures"],
            coding_row(bench, scene, "no weights", encode(scene.scene, {}, high())));
  bench.add(tables["measures"],
            coding_row(bench, scene, "sum", encode(scene.scene, bench.weights(scene), high())));
  l4d_measure_options squares = measure_options(kAgreement);
  squares.sensitivity.measure = L4D_SENSITIVITY_GAUSS_NEWTON;
  squares.skip_unseen = 1;
  const Measured gauss_newton = measure(scene, squares);
  bench.add(tables["measures"], coding_row(bench, scene, "gauss-newton",
                                           encode(scene.scene, gauss_newton.weights, high())));
  for (const double threshold : bench.take(std::vector<double>{-1, 0, 1e-8, 3e-8})) {
    char name[32];
    std::snprintf(name, sizeof name, threshold < 0 ? "never" : "%g", threshold);
    const Encoded e =
        encode(scene.scene, bench.weights(scene), high().with(L4D_ENC_PRUNE_WEIGHT, threshold));
    Json row = coding_row(bench, scene, name, e);
    row["pruned"] = e.report.pruned;
    bench.add(tables["pruning"], row);
  }
  return tables;
}

}  // namespace l4d::bench
