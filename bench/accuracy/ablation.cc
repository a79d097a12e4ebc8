// SPDX-License-Identifier: Apache-2.0
// Table 4 of the paper: what each part of its compression brings.
#include "bench/accuracy/cov4d.h"
#include "bench/accuracy/sections.h"
#include "io/ply/weights.h"
#include "l4d/experimental/inspect.h"

namespace l4d::bench {
namespace {

// SH, opacity and means as the file of `base` has them, covariances quantised whole. Bytes are
// those of that file without its scales, rotors and their codebooks, and the entropy of the indices
// instead.
Json covariance_row(Bench& bench, const Encoded& base) {
  const BenchScene& scene = bench.real();
  io::Scene decoded = decode(base.file);
  const io::Weights& measured = bench.weights(scene);
  std::vector<float> weights;
  for (size_t i = 0; i < base.order.size(); ++i) {
    const size_t from = base.order[i];
    std::copy_n(&scene.scene.log_scale[4 * from], 4, &decoded.log_scale[4 * i]);
    std::copy_n(&scene.scene.rotor[8 * from], 8, &decoded.rotor[8 * i]);
    weights.push_back(measured.scale[from]);
  }
  const Cov4d cov = quantise_covariances(decoded, weights, 4096, 10);
  double codebooks = 0;
  for (const l4d_layer_info& l : base.layers) codebooks += static_cast<double>(l.codebook_bytes);
  const double bytes = base.bytes() - codebooks -
                       static_cast<double>(base.sections[L4D_SECTION_SCALE]) -
                       static_cast<double>(base.sections[L4D_SECTION_ROTOR_SPATIAL]) -
                       static_cast<double>(base.sections[L4D_SECTION_ROTOR_TEMPORAL]) +
                       cov.index_bits / 8 + cov.codebook_bytes;
  return {{"name", "VQ of 4D covariances"},
          {"bytes", bytes},
          {"ratio", static_cast<double>(base.report.raw_bytes) / bytes},
          {"fidelity_db", bench.judge(scene).of_scene(decoded).psnr},
          {"layers", 1}};
}

}  // namespace

Json run_ablation(Bench& bench) {
  const BenchScene& scene = bench.real();
  Json rows = Json::array();
  const auto named = [](Coding coding, const char* name) {
    coding.name = name;
    return coding;
  };
  const Coding closed = named(one_stage().with(L4D_ENC_RCQ, 0), "+ closed loop");
  const Coding closed_one =
      named(closed.with(L4D_ENC_MERGE_FRACTION, 1), "one layer, closed loop, no RCQ");
  const Coding layers = named(closed.with(L4D_ENC_CLOSED_LOOP, 0), "+ layers");
  const Coding one = named(closed_one.with(L4D_ENC_CLOSED_LOOP, 0), "+ factorised, one layer");
  const Coding rcq = named(closed.with(L4D_ENC_RCQ, 2).with(L4D_ENC_RCQ_SIZE, 256), "+ RCQ, 256");
  for (const Coding& coding : {one, layers, closed, rcq, closed_one}) {
    const Encoded e = encode(bench, scene, coding);
    if (rows.empty()) bench.add(rows, covariance_row(bench, e));
    Json row = coding_row(bench, scene, coding.name, e);
    row["layers"] = e.report.num_layers;
    bench.add(rows, row);
  }
  return {{"steps", rows}};
}

}  // namespace l4d::bench
