// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdio>
#include <string>
#include <vector>

namespace l4d::io::test {

// A Gaussian of a SpacetimeGaussians lite model, under the names of its PLY.
struct StgRow {
  double position[3] = {1, 2, 3};
  double center = 0.5, log_width = -2;
  double motion[9] = {};
  double color[3] = {0.5, 0.75, 0.25};
  double opacity = 1;
  double scale[3] = {-3, -4, -5};
  double wxyz[4] = {1, 0, 0, 0};
  double omega[4] = {};
};

// The PLY. extra: lines of more properties.
inline std::string stg_ply(const std::vector<StgRow>& rows, const std::string& extra = "") {
  std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(rows.size()) + "\n";
  for (const char* name : {"x", "y", "z", "trbf_center", "trbf_scale", "nx", "ny", "nz"}) {
    text += std::string("property float ") + name + "\n";
  }
  const auto declare = [&](const char* name, int count) {
    for (int k = 0; k < count; ++k) {
      text += std::string("property float ") + name + "_" + std::to_string(k) + "\n";
    }
  };
  declare("motion", 9);
  declare("f_dc", 3);
  text += "property float opacity\n";
  declare("scale", 3);
  declare("rot", 4);
  declare("omega", 4);
  text += extra + "end_header\n";
  const auto put = [&](const double* values, int count) {
    char number[40];
    for (int k = 0; k < count; ++k) {
      std::snprintf(number, sizeof(number), "%.9g ", values[k]);
      text += number;
    }
  };
  for (const StgRow& row : rows) {
    const double zeros[3] = {};
    put(row.position, 3);
    put(&row.center, 1);
    put(&row.log_width, 1);
    put(zeros, 3);
    put(row.motion, 9);
    put(row.color, 3);
    put(&row.opacity, 1);
    put(row.scale, 3);
    put(row.wxyz, 4);
    put(row.omega, 4);
    text += "\n";
  }
  return text;
}

}  // namespace l4d::io::test
