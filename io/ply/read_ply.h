// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "io/ply/ply.h"
#include "io/ply/scene_ply.h"
#include "io/scene/rotor_math.h"

namespace l4d::io {

// What read_scene_ply() does once the file is open. `reader` is one of element `vertex`.
Scene read_scene(PlyReader& reader, const ImportOptions& options);

// The readers it chooses between.
Scene read_l4d_ply(PlyReader& reader, const ImportOptions& options);
Scene read_ftgs_ply(PlyReader& reader, const ImportOptions& options);
Scene read_stg_ply(PlyReader& reader, const ImportOptions& options);
Scene read_3dgs_ply(PlyReader& reader, const ImportOptions& options);

// ---- what they share ----

// Number in a header comment; `fallback` if there is none.
double comment_number(const PlyReader& reader, const char* key, double fallback);
// Sets the frame rate from comment `fps`, a decimal or a fraction such as 30000/1001; 30 without
// it.
void set_fps_from_comment(const PlyReader& reader, l4d_timeline& timeline);

// Timeline of a format whose file says nothing about time; notes what was assumed.
void set_default_timeline(Scene& scene, const ImportOptions& options);
// Placement, rendering and presentation from the l4d_* comments.
void read_placement(const PlyReader& reader, Scene& scene);

// SH degree from the number of f_rest_* properties; throws on a count that no degree has.
uint32_t sh_degree_of(const PlyReader& reader);

// Collects where columns go, then reads them all in one pass.
class ColumnSet {
 public:
  explicit ColumnSet(PlyReader& reader) : reader_(reader) {}

  // To to[first], to[first + stride], ...; an array without rows may be NULL.
  void add(const std::string& property, float* to, size_t first, size_t stride);
  // name_0, name_1, ... to consecutive floats
  void add_indexed(const std::string& name, size_t count, float* to, size_t stride);
  // f_dc_*, and f_rest_* from channel-major to coefficient-major
  void add_sh(Scene& scene);
  // x y z: as they are where float32; where double, less a common origin that goes to the
  // placement, so that map coordinates keep their millimetres.
  void add_position(Scene& scene);
  // Mean times, as they are where float32, and where double.
  void add_time(const std::string& property, Scene& scene);
  void read();

 private:
  size_t require(const std::string& property) const;

  PlyReader& reader_;
  std::vector<PlyColumn> columns_;
  Scene* scene_with_floats_ = nullptr;
  Scene* scene_with_doubles_ = nullptr;
  std::vector<double> positions_;  // [N, 3]
  Scene* scene_with_times_ = nullptr;
  std::vector<double> times_;  // [N]
};

inline bool all_finite(const double* values, size_t count) {
  for (size_t i = 0; i < count; ++i) {
    if (!(values[i] - values[i] == 0)) return false;
  }
  return true;
}

// Stores the shape of Gaussian i in float32.
void store_shape(Scene& scene, size_t i, const Shape4& shape);
// The same for a Gaussian at rest; its three spatial log scales are in place already.
void store_still_shape(Scene& scene, size_t i, const Vec4& wxyz, double sigma_t);
// Marks Gaussian i as unusable (NaN scales): the encoder names it, or drops it where told to.
void store_invalid_shape(Scene& scene, size_t i);

}  // namespace l4d::io
