/* SPDX-License-Identifier: Apache-2.0
 * experimental/columns.h: slices as structures of arrays, the form that renderers take.
 * Experimental: it may change with each version of the library.
 */
#ifndef L4D_EXPERIMENTAL_COLUMNS_H
#define L4D_EXPERIMENTAL_COLUMNS_H

#include "l4d/members.h"

#ifdef __cplusplus
extern "C" {
#endif

/* 3D Gaussians at one instant as a structure of arrays, the form that renderers take. */
typedef struct l4d_splat_columns {
  size_t struct_size;
  uint64_t capacity;     /* number of Gaussians that each array has room for */
  uint64_t count;        /* out: number of Gaussians, also if the call fails for capacity */
  float* position[3];    /* [M] each: x, y, z */
  float* covariance[6];  /* [M] each: xx xy xz yy yz zz */
  float* opacity;        /* [M] in [0, 1], temporal falloff applied */
  const float** sh_rows; /* [M] as in l4d_splat_buffers */
  /* As in l4d_splat_buffers. Here every Gaussian that looks the same throughout the sequence is
   * among the first num_still, whichever bucket holds it. */
  uint64_t num_still;
  uint64_t still_key;
  /* In: the call skips Gaussians whose opacity at `time` is below this. It may keep some that are
   * within rounding of it. 0 = skip none. */
  float min_opacity;
  uint32_t reserved;
  /* As in l4d_splat_buffers. All columns of one of these are NULL, or none is. */
  float* scale[3];     /* [M] each */
  float* rotation[4];  /* [M] each: w, x, y, z */
  float* color[3];     /* [M] each: red, green, blue */
  l4d_gaussian_id* id; /* [M], or NULL */
  double camera_position[3];
  l4d_operating_point point;
} l4d_splat_columns;
/* As l4d_slice_streams, in this form: the Gaussians and their numbers are the same, those of each
 * stream in another order. If capacity is 0, only `count` is computed; otherwise position,
 * covariance, opacity and sh_rows must not be NULL.
 * Fails with BUFFER_TOO_SMALL if capacity is above 0 and below `count`; of one stream, the arrays
 * are unchanged then. Fails with INVALID_ARGUMENT if min_opacity is not a number >= 0, if only some
 * columns of scale, rotation or color are NULL, or if camera_position is not finite and color is
 * given. */
L4D_API l4d_status l4d_slice_streams_columns(const l4d_shown_stream* streams, uint64_t count,
                                             l4d_splat_columns* out);

#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_COLUMNS_H */
