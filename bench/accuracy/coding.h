// SPDX-License-Identifier: Apache-2.0
// One way to encode a scene, and what came of it.
#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "bench/accuracy/scene.h"
#include "io/ply/weights.h"
#include "l4d/experimental/inspect.h"
#include "l4d/experimental/parameters.h"
#include "l4d/l4d.hpp"
#include "l4d/render.h"

namespace l4d::bench {

struct Setting {
  std::string name;
  double value;
};

struct Coding {
  std::string name;
  std::string preset = "default";
  std::vector<Setting> settings;  // in this order, after the preset
  // Shares of residual stages, of SH and of the other components; empty = as the preset has them.
  std::vector<double> sh_stages, geometry_stages;
  uint64_t seed = 0;
  // Of the weights it is encoded with: thresholds of the paper's presets are in units of the sum.
  uint32_t metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  uint32_t views = L4D_WEIGHT_VIEWS_UNKNOWN;  // that they were measured from

  Coding with(const std::string& parameter, double value) const {
    Coding c = *this;
    c.settings.push_back({parameter, value});
    return c;
  }
};

// A preset under its own name, with the metric it wants.
Coding preset(const std::string& name);
// One stage of 4096 codewords for each component: what tables on codebooks vary.
Coding one_stage();
// Codebooks of k codewords, with these shares of residual stages.
Coding staged(const std::string& name, double k, std::vector<double> sh_stages,
              std::vector<double> geometry_stages);
// Shares and sizes of residual stages around those of the presets.
std::vector<Coding> codebook_codings();

struct Encoded {
  std::vector<unsigned char> file;
  l4d_encode_report report{};
  double cpu_seconds = 0;  // of all threads: other work on the machine disturbs it little
  std::vector<std::pair<std::string, double>> steps;  // name and seconds
  std::vector<uint32_t> order;                        // as l4d_encoder_get_order
  std::array<uint64_t, L4D_SECTION_COUNT> sections{};
  std::vector<uint64_t> layer_bytes;
  std::vector<l4d_layer_info> layers;

  double bytes() const { return static_cast<double>(file.size()); }
  double ratio() const { return static_cast<double>(report.raw_bytes) / bytes(); }
};

// weights: empty columns are not set. Of `runs` runs, which are equal but for their time, the
// fastest.
Encoded encode(const io::Scene& scene, const io::Weights& weights, const Coding& coding,
               int runs = 1);
// The same with the encoder's options given, of which the seed is the coding's.
Encoded encode(const io::Scene& scene, const io::Weights& weights, const Coding& coding, int runs,
               l4d_encoder_options options);

// A decoder of the file, which has to outlive it. backend: L4D_BACKEND_*.
DecoderHandle open(const std::vector<unsigned char>& file, uint32_t backend, uint32_t threads);
// The whole stream as a scene.
io::Scene decode(const std::vector<unsigned char>& file);

}  // namespace l4d::bench
