// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "io/ply/column_set.h"
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
Scene read_rt4dgs_ply(PlyReader& reader, const ImportOptions& options);
Scene read_compressed_ply(PlyReader& reader, const ImportOptions& options);

// Whether the rows are packed by chunks, as `.compressed.ply` files have them.
bool is_compressed_ply(const PlyElement& vertex);
// What such a scene takes together with what it is made of.
uint64_t compressed_ply_bytes(PlyReader& reader);

// Whether the columns are those of a Real-time-4DGS model.
bool is_rt4dgs_ply(const PlyElement& vertex);
// Whether they are those of a SpacetimeGaussians model, or t, scale_t and motion_*.
bool is_stg_ply(const PlyElement& vertex);
// Fails with L4D_ERR_FEATURE_UNSUPPORTED if a column says that the Gaussians change over time and
// no reader takes that column: a scene without it would be another one.
void refuse_unread_time(const PlyReader& reader);
// The same of columns that a layout leaves over.
void refuse_unread_time(const PlyReader& reader, const std::vector<std::string>& left_over);
// The same for a model whose Gaussians a network moves that lies next to the file.
void refuse_deformed(const PlyReader& reader);

// ---- what they share ----

// Number in a header comment; `fallback` if there is none.
double comment_number(const PlyReader& reader, const char* key, double fallback);
// Sets the frame rate from comment `fps`, a decimal or a fraction such as 30000/1001; 30 without
// it.
void set_fps_from_comment(const PlyReader& reader, l4d_timeline& timeline);

// Timeline of a format whose file says nothing about time; notes what was assumed.
void set_default_timeline(Scene& scene, const ImportOptions& options);
// Notes times of formats that state no unit of them where they do not fit the sequence:
// milliseconds or frames show nothing in one of seconds, and times around 0 are half before it.
void note_far_times(Scene& scene);
// Placement, rendering and presentation from the l4d_* comments.
void read_placement(const PlyReader& reader, Scene& scene);

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
// Raises the scales of a Gaussian, [3], that are below the codec's least of e^-16; whether there
// were any. Viewers' exporters write flat Gaussians with e^-20 and less, which look the same.
bool raise_flat_scale(float* log_scale);
// The same of all Gaussians of a scene; a note says of how many.
void raise_flat_scales(Scene& scene);
// On every scene that make_static() made.
inline constexpr char kStaticNote[] =
    "Static Gaussians last 16 times the sequence: their opacity varies by less than 0.05 %.";
// Makes Gaussians with these rotations (w x y z, [N, 4]) last: raises scales below the codec's
// least, and sets times and rotors, with notes on both.
void make_static(const std::vector<float>& rotation, Scene& scene);
// A note says how many quaternions, [N, 4], have length 0: they are taken as no rotation.
void note_unturned(const std::vector<float>& quaternion, Scene& scene);
// What readers of foreign files do with rows as they come, before scales are used: infinite logits
// become those of 0 and 1, with a count. With options.activated, opacities in [0, 1] become logits
// and scales logarithms, 4 where num_scales counts that along time; without, a note says where they
// look as if they were.
void settle_rows(const PlyReader& reader, const ImportOptions& options, Scene& scene,
                 size_t num_scales = 3);
// Marks Gaussian i as unusable (NaN scales): the encoder names it, or drops it where told to.
void store_invalid_shape(Scene& scene, size_t i);

}  // namespace l4d::io
