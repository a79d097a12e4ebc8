// SPDX-License-Identifier: Apache-2.0
// How many views the weights need, which measure serves best, and what pruning brings.
#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

Coding coded() { return preset("default"); }

struct Selection {
  std::string name;
  double max_share;
};

std::vector<Selection> shares() {
  return {{"1/108", 1.0 / 108}, {"1/54", 1.0 / 54}, {"1/27", 1.0 / 27}, {"4/27", 4.0 / 27}};
}

// Views that are measured, none of the others being asked anything.
Measured measure_share(const BenchScene& scene, double share) {
  l4d_measure_options options = measure_options(L4D_SENSITIVITY_GAUSS_NEWTON, 2, share);
  options.skip_visibility = 1;
  return measure(scene, options);
}

Json measured_row(Bench& bench, const std::string& name, const Measured& m,
                  const io::Weights& most) {
  const BenchScene& scene = bench.real();
  Json row = coding_row(bench, scene, name, encode(scene.scene, m.weights, coded()));
  const Json measured = {
      {"views_measured", m.report.views_measured},
      {"views_visibility_only", m.report.views_visibility_only},
      {"measure_s", m.seconds},
      {"unseen", m.report.unseen},
      {"spearman_sh", rank_correlation(m.weights.sh, most.sh)},
      {"spearman_scale", rank_correlation(m.weights.scale, most.scale)},
      {"spearman_rotor_spatial", rank_correlation(m.weights.rotor_spatial, most.rotor_spatial)},
      {"spearman_rotor_temporal", rank_correlation(m.weights.rotor_temporal, most.rotor_temporal)}};
  row.update(measured);
  return row;
}

void add_measures(Bench& bench, Json& table) {
  const BenchScene& scene = bench.real();
  for (const char* name : {"default", "indexed"}) {
    const Coding c = preset(name);
    const auto add = [&](const char* metric, const io::Weights& weights) {
      bench.add(table, coding_row(bench, scene, std::string(metric) + ", " + name,
                                  encode(scene.scene, weights, c)));
    };
    add("no weights", {});
    add("sum", bench.weights(scene, L4D_SENSITIVITY_SUM));
    add("gauss-newton", bench.weights(scene));
  }
}

}  // namespace

Json run_sensitivity(Bench& bench) {
  const BenchScene& scene = bench.real();
  Json tables = {{"views", Json::array()}, {"measures", Json::array()}, {"pruning", Json::array()}};
  std::vector<std::pair<std::string, Measured>> all;
  for (const Selection& s : bench.take(shares())) {
    bench.note("measuring " + s.name + " of the views");
    all.emplace_back(s.name, measure_share(scene, s.max_share));
  }
  all.emplace_back("agreement of 0.95", bench.measured(scene, L4D_SENSITIVITY_GAUSS_NEWTON));
  const Measured most = all[all.size() - 2].second;
  for (const auto& [name, m] : all) {
    bench.add(tables["views"], measured_row(bench, name, m, most.weights));
  }
  add_measures(bench, tables["measures"]);
  for (const double cost : bench.take(std::vector<double>{0, 0.05, 0.2, 0.5, 1})) {
    const Encoded e = encode(bench, scene, coded().with(L4D_ENC_PRUNE_COST, cost));
    Json row = coding_row(bench, scene, "default", e);
    row["prune_cost"] = cost;
    row["pruned"] = e.report.pruned;
    bench.add(tables["pruning"], row);
  }
  return tables;
}

}  // namespace l4d::bench
