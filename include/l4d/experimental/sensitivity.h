/* SPDX-License-Identifier: Apache-2.0
 * experimental/sensitivity.h: importance added up view by view, where l4d_measure_importance
 * chooses too much by itself. Experimental: it may change with each version of the library.
 */
#ifndef L4D_EXPERIMENTAL_SENSITIVITY_H
#define L4D_EXPERIMENTAL_SENSITIVITY_H

#include "l4d/render.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Sums over views. */
typedef struct l4d_sensitivity l4d_sensitivity;

typedef struct l4d_sensitivity_options {
  size_t struct_size;
  uint32_t metric; /* L4D_SENSITIVITY_* */
  uint32_t reserved;
  uint64_t seed; /* as in l4d_measure_options */
} l4d_sensitivity_options;

/* For a scene of `count` Gaussians of degree sh_degree. options may be NULL. */
L4D_API l4d_status l4d_sensitivity_create(const l4d_sensitivity_options* options, uint64_t count,
                                          uint32_t sh_degree, l4d_sensitivity** out);
L4D_API void l4d_sensitivity_destroy(l4d_sensitivity* sensitivity); /* accepts NULL */

/* Adds one view at the renderer's time. The renderer must hold the scene of this accumulator
 * (l4d_renderer_set_gaussians), without a background. visibility_only = 1 records only which
 * Gaussians the view shows, without derivatives, in a fraction of the time: call it for the views
 * that you skip, so that pruning does not drop Gaussians visible only there. */
L4D_API l4d_status l4d_sensitivity_add_view(l4d_sensitivity* sensitivity, l4d_renderer* renderer,
                                            const l4d_camera* camera, int visibility_only);
/* Returns weights. which: L4D_WEIGHT_*. out: [count]. They are those of l4d_measure_importance with
 * these views. Fails with INVALID_STATE before the first full view. */
L4D_API l4d_status l4d_sensitivity_get_weights(const l4d_sensitivity* sensitivity, uint32_t which,
                                               float* out, uint64_t count);

#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_SENSITIVITY_H */
