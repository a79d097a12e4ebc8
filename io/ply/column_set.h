// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "io/ply/ply.h"
#include "io/scene/scene.h"

namespace l4d::io {

// Spherical harmonics that a file has.
struct ShColumns {
  uint32_t degree = 0;  // that is read: at most 3
  size_t rest = 0;      // f_rest properties of each channel in the file
  std::string note;     // on those that are not read; empty if there are none
};
// From the number of f_rest_* properties. Degree 4 is cut to 3. over_time: of colours that change
// over time, as Real-time-4DGS has them, the part that does not. Throws on a count that no degree
// has.
ShColumns sh_columns_of(const PlyReader& reader, bool over_time = false);

// Collects where columns go, then reads them all in one pass. `scene` has its SH degree and count.
class ColumnSet {
 public:
  ColumnSet(PlyReader& reader, Scene& scene) : reader_(reader), scene_(scene) {}

  // To to[first], to[first + stride], ...; an array without rows may be NULL.
  void add(const std::string& property, float* to, size_t first, size_t stride);
  // name_0, name_1, ... to consecutive floats
  void add_indexed(const std::string& name, size_t count, float* to, size_t stride);
  // f_dc_*, and f_rest_* from channel-major to coefficient-major; red, green and blue where there
  // is no f_dc. `sh`: what the degree of the scene comes from.
  void add_sh(const ShColumns& sh);
  // x y z: as they are where float32; where double, less a common origin that goes to the
  // placement, so that map coordinates keep their millimetres.
  void add_position();
  // Mean times, as they are where float32, and where double.
  void add_time(const std::string& property);
  // Notes name what the file has besides, and how often a row was nothing but zeros: such rows,
  // which stand for no Gaussian, are left out, and the scene then has fewer of them than the file.
  void read();

 private:
  size_t require(const std::string& property);
  void store_colors();
  void leave_out_zeros();
  void note_unread();

  PlyReader& reader_;
  Scene& scene_;
  std::vector<PlyColumn> columns_;
  size_t halves_ = 0;                  // properties of 16-bit integers, taken for binary16
  std::vector<std::string> integers_;  // names of properties of other integers
  bool has_floats_ = false;            // positions
  bool has_colors_ = false;            // red, green and blue in place of f_dc
  PlyType color_type_ = PlyType::kUint8;
  std::vector<double> positions_;  // [N, 3], else empty
  std::vector<double> times_;      // [N], else empty
};

}  // namespace l4d::io
