// SPDX-License-Identifier: Apache-2.0
// Fidelity against bytes, of both families of codings.
#include <cstdio>

#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

Coding transform_at(double quality) {
  char name[32];
  std::snprintf(name, sizeof name, "quality %g", quality);
  Coding c = preset("default").with(L4D_ENC_QUALITY, quality);
  c.name = name;
  return c;
}

Coding indexed_at(double quality) {
  char name[48];
  std::snprintf(name, sizeof name, "codebooks by cost, quality %g", quality);
  Coding c = preset("indexed").with(L4D_ENC_QUALITY, quality);
  c.name = name;
  return c;
}

}  // namespace

Json run_rate(Bench& bench) {
  const BenchScene& scene = bench.real();
  Json transforms = Json::array(), codebooks = Json::array();
  for (const double quality : bench.take(std::vector<double>{34, 38, 42, 46, 50, 54, 58})) {
    Json row = coded_row(bench, scene, transform_at(quality));
    row["quality"] = quality;
    bench.add(transforms, row);
  }
  std::vector<Coding> codings;
  for (const double quality : {36, 40, 44, 48, 52}) codings.push_back(indexed_at(quality));
  for (const Coding& c : codebook_codings()) codings.push_back(c);
  for (const Coding& c : bench.take(codings)) bench.add(codebooks, coded_row(bench, scene, c));
  return {{"transforms", transforms}, {"codebooks", codebooks}};
}

}  // namespace l4d::bench
