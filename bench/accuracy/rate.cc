// SPDX-License-Identifier: Apache-2.0
// Fidelity against bytes: of both families of codings, of single parts, and of another scene.
#include <cstdio>

#include "bench/accuracy/sections.h"

namespace l4d::bench {
namespace {

// What is coded one way or the other as a whole: rotors of a transform are one number.
struct Part {
  const char* name;
  std::vector<int> components;
};
std::vector<Part> parts() {
  return {{"sh", {L4D_COMPONENT_SH}},
          {"scale", {L4D_COMPONENT_SCALE}},
          {"rotors", {L4D_COMPONENT_ROTOR_SPATIAL, L4D_COMPONENT_ROTOR_TEMPORAL}}};
}

// What is not looked at: components at this quality, the rest without regard to any.
constexpr double kOtherQuality = 64;

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

// One part at the quality, all else much better.
Coding alone(const Part& part, double quality) {
  Coding c = transform_at(quality)
                 .with(L4D_ENC_PRUNE_COST, 0)
                 .with(L4D_ENC_POSITION_OFFSET, kOtherQuality - quality)
                 .with(L4D_ENC_MEAN_T_SHIFT, 0)
                 .with(L4D_ENC_OPACITY_BITS, 12)
                 .with(L4D_ENC_QUALITY_OFFSET, kOtherQuality - quality);
  for (const int own : part.components) c = c.with(L4D_ENC_QUALITY_OFFSET, 0, own);
  return c;
}

// Stages of each component of a part, as ways to spend bits on it.
struct Stages {
  double k;
  std::vector<float> shares;
};
std::vector<Stages> component_stages() {
  return {{1024, {1}}, {4096, {1}}, {1024, {1, 1}}, {1024, {1, 1, 1}}};
}

void add_part(Bench& bench, Json& table, const Judge& judge, const Part& part, const char* family,
              const std::string& setting, const Coding& coding) {
  const Encoded e = encode(bench, bench.real(), coding);
  const auto section = [&](uint32_t s) { return static_cast<double>(e.sections[s]); };
  // No other part has codebooks. Codebooks of scales are of what is left without a factor.
  double bytes = section(L4D_SECTION_CODEBOOKS) + section(L4D_SECTION_RCQ_TABLES);
  for (const int c : part.components) {
    bytes += section(L4D_SECTION_SH + static_cast<uint32_t>(c));
    if (c == L4D_COMPONENT_SCALE) bytes += section(L4D_SECTION_SCALE_FACTOR);
  }
  bench.add(table, {{"name", part.name},
                    {"family", family},
                    {"setting", setting},
                    {"bytes", bytes},
                    {"bits_per_gaussian", 8 * bytes / static_cast<double>(e.order.size())},
                    {"fidelity_db", judge.of_file(e.file).psnr}});
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

Json run_crossover(Bench& bench) {
  const BenchScene& scene = bench.real();
  // Curves of one part need few views.
  const Judge judge(scene, scene.frames(2));
  Json rows = Json::array();
  for (const Part& part : bench.take(parts())) {
    for (const double quality : bench.take(std::vector<double>{34, 40, 46, 54})) {
      const Coding coding = alone(part, quality);
      add_part(bench, rows, judge, part, "transform", coding.name, coding);
    }
    for (const Stages& s : bench.take(component_stages())) {
      Coding coding = alone(part, 40);
      for (const int c : part.components) {
        coding = coding.with(L4D_ENC_CODING, 0, c).with(L4D_ENC_CODEBOOK_SIZE, s.k, c);
        (c == L4D_COMPONENT_SH ? coding.sh_stages : coding.geometry_stages) = s.shares;
      }
      const size_t n = s.shares.size();
      add_part(bench, rows, judge, part, "codebooks",
               std::to_string(n) + (n == 1 ? " stage, K=" : " stages, K=") +
                   std::to_string(static_cast<int>(s.k)),
               coding);
    }
    for (const double quality : bench.take(std::vector<double>{34, 40, 46, 54})) {
      Coding coding =
          alone(part, quality).with(L4D_ENC_REFINE, 2).with(L4D_ENC_CODEBOOK_SIZE, 4096);
      for (const int c : part.components) coding = coding.with(L4D_ENC_CODING, 0, c);
      coding = coding.with(L4D_ENC_CODEBOOKS_BY_COST, 1);
      add_part(bench, rows, judge, part, "codebooks by cost", coding.name, coding);
    }
  }
  return {{"parts", rows}};
}

Json run_second(Bench& bench) {
  const BenchScene& scene = bench.synth();
  Json rows = Json::array();
  for (const char* name : {"tiny", "small", "large", "indexed"}) {
    const Encoded e = encode(bench, scene, preset(name));
    Json row = coding_row(bench, scene, name, e);
    row["coded_gaussians"] = e.report.coded_gaussians;
    row["gaussians"] = e.report.input_gaussians;
    row["views"] = bench.judge(scene).num_views();
    bench.add(rows, row);
  }
  return {{"presets", rows}};
}

}  // namespace l4d::bench
