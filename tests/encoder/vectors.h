// SPDX-License-Identifier: Apache-2.0
// Points of the kinds an encoder meets, and the real ones.
#pragma once

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "tests/common/files.h"
#include "tests/common/random.h"

namespace l4d::test {

// [n, dim]: Gaussian blobs of width 0.05 around `centres` places in a box of falling extent.
inline std::vector<float> blobs(size_t n, size_t dim, size_t centres, uint64_t seed) {
  Random random(seed);
  std::vector<double> centre(centres * dim);
  for (size_t c = 0; c < centre.size(); ++c) {
    centre[c] = random.uniform(-1, 1) * 4 / (1 + static_cast<double>(c % dim));
  }
  std::vector<float> points(n * dim);
  for (size_t i = 0; i < n; ++i) {
    const size_t c = random.below(static_cast<uint32_t>(centres));
    for (size_t j = 0; j < dim; ++j) {
      points[i * dim + j] = static_cast<float>(centre[c * dim + j] + 0.05 * random.normal());
    }
  }
  return points;
}

// [n, dim]: most within 0.01 of the origin, a few a thousand times as far, as temporal rotors are.
inline std::vector<float> heavy_tails(size_t n, size_t dim, uint64_t seed) {
  Random random(seed);
  std::vector<float> points(n * dim);
  for (size_t i = 0; i < n; ++i) {
    const double size = 0.001 * std::pow(1e4, std::pow(random.uniform(), 6));
    for (size_t j = 0; j < dim; ++j) {
      points[i * dim + j] = static_cast<float>(size * random.normal());
    }
  }
  return points;
}

// [n, dim] integers in [-range, range]: their float distances are exact, and ties abound.
inline std::vector<float> lattice(size_t n, size_t dim, int range, uint64_t seed) {
  Random random(seed);
  std::vector<float> points(n * dim);
  for (float& v : points) {
    v = static_cast<float>(static_cast<int>(random.below(static_cast<uint32_t>(2 * range + 1))) -
                           range);
  }
  return points;
}

// Folder of the real scene; empty where there is none.
inline std::string basketball_folder() {
  const bool complete = !data_file("basketball/basketball.ply").empty() &&
                        !data_file("basketball/basketball-weights.ply").empty();
  return complete ? data_file("basketball") : std::string();
}

struct RealVectors {
  size_t n = 0;
  std::vector<float> sh;              // [n, 48], coefficient-major as the codec has it
  std::vector<float> temporal_rotor;  // [n, 4]
  std::vector<float> sh_weight;  // [n] 0.6 alpha_t: blending weight times a mean SH basis value
};

// One vertex element of nothing but float32 in little-endian order, as the real scene's files have
// it.
struct FloatRows {
  std::vector<std::string> names;
  std::vector<float> values;  // [rows, names]
  size_t column(const std::string& name) const {
    return static_cast<size_t>(std::find(names.begin(), names.end(), name) - names.begin());
  }
};

inline FloatRows read_float_rows(const std::string& path) {
  FloatRows out;
  std::ifstream file(path, std::ios::binary);
  size_t rows = 0;
  for (std::string line; std::getline(file, line) && line != "end_header";) {
    const std::string count = "element vertex ", property = "property float ";
    if (line.compare(0, count.size(), count) == 0) rows = std::stoul(line.substr(count.size()));
    if (line.compare(0, property.size(), property) == 0) {
      out.names.push_back(line.substr(property.size()));
    }
  }
  out.values.resize(rows * out.names.size());
  file.read(reinterpret_cast<char*>(out.values.data()),
            static_cast<std::streamsize>(out.values.size() * sizeof(float)));
  return out;
}

// Every step-th Gaussian of the scene.
inline RealVectors read_basketball(const std::string& folder, size_t step) {
  const FloatRows scene = read_float_rows(folder + "/basketball.ply");
  const FloatRows weights = read_float_rows(folder + "/basketball-weights.ply");
  const size_t rotor = scene.column("rotor_4"), alpha = weights.column("alpha_t");
  const size_t dc = scene.column("f_dc_0"), rest = scene.column("f_rest_0");
  RealVectors out;
  for (size_t i = 0; i * scene.names.size() < scene.values.size(); i += step, ++out.n) {
    const float* row = scene.values.data() + i * scene.names.size();
    for (size_t j = 0; j < 48; ++j) {
      const size_t coefficient = j / 3, channel = j % 3;
      out.sh.push_back(coefficient == 0 ? row[dc + channel]
                                        : row[rest + channel * 15 + coefficient - 1]);
    }
    out.temporal_rotor.insert(out.temporal_rotor.end(), row + rotor, row + rotor + 4);
    out.sh_weight.push_back(0.6f * weights.values[i * weights.names.size() + alpha]);
  }
  return out;
}

}  // namespace l4d::test
