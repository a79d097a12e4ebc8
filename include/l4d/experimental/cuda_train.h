/* SPDX-License-Identifier: Apache-2.0
 * experimental/cuda_train.h: rendering of a scene whose Gaussians change in every step, for
 * trainers. All arrays are in device memory and belong to the caller, who changes them between
 * steps. Conventions of cameras, images, attributes and gradients are those of render.h and l4d.h.
 * Every build has these functions; in one without device code l4d_cuda_trainable_create fails with
 * FEATURE_UNSUPPORTED. Experimental: it may change with each version of the library.
 *
 *   l4d_cuda_trainable_create(NULL, &trainable);
 *   l4d_cuda_trainable_set_scene(trainable, &gaussians, &timeline, &rows);     // once
 *   l4d_cuda_trainable_reserve(trainable, &capacity);                          // once
 *   for each step:
 *     l4d_cuda_trainable_refresh(trainable, stream);                           // after the
 * optimiser l4d_cuda_trainable_forward(trainable, views, num_views, stream);         // images
 *     ...                                                            // the caller's loss
 *     l4d_cuda_trainable_backward(trainable, losses, num_views, &gradients, &statistics, stream);
 *     ...                                                            // the caller's optimiser
 *   every few steps:
 *     l4d_cuda_trainable_copy_report(trainable, stream);                       // does not wait
 *     l4d_cuda_trainable_get_report(trainable, 0, &report);                    // was the capacity
 * enough?
 *
 * CUDA streams are passed as void* (a cudaStream_t). refresh, forward, backward and copy_report
 * only launch work: they neither allocate nor wait. All work is ordered after the earlier work on
 * `stream`, and later work on `stream` is ordered after it. Calls for one handle use one stream, or
 * streams that the caller orders by events. Images, gradients and statistics repeat bit for bit. A
 * handle serves one thread at a time.
 */
#ifndef L4D_EXPERIMENTAL_CUDA_TRAIN_H
#define L4D_EXPERIMENTAL_CUDA_TRAIN_H

#include "l4d/experimental/cuda_render.h"

#ifdef __cplusplus
extern "C" {
#endif

#define L4D_CUDA_TRAINABLE_MAX_VIEWS 16u /* of one forward */

typedef struct l4d_cuda_trainable l4d_cuda_trainable;

/* options may be NULL; sh_format must be L4D_CUDA_SH_FLOAT32. Fails with DEVICE if the device does
 * not exist or this build has no code for it. */
L4D_API l4d_status l4d_cuda_trainable_create(const l4d_cuda_renderer_options* options,
                                             l4d_cuda_trainable** out);
L4D_API void l4d_cuda_trainable_destroy(l4d_cuda_trainable* trainable); /* accepts NULL; waits */

/* ---- the scene ------------------------------------------------------------------------------- */

/* The parameters of arrays of fixed capacity N, in addition to l4d_gaussians. */
typedef struct l4d_cuda_trainable_rows {
  size_t struct_size;
  /* [1] on the device: rows in use, [0, min(*count, N)); NULL = N. */
  const uint32_t* count;
  /* float32 numbers from the SH of one row to that of the next, in l4d_gaussians.sh and in
   * l4d_gradients.sh. A multiple of 4 that is at least 3 (D+1)^2; 0 = 3 (D+1)^2 rounded up to a
   * multiple of 4. sh must be aligned to 16 bytes. */
  uint32_t sh_stride;
  uint32_t reserved;
  /* [1] on the device: a view that exceeds the reserved capacity sets it to 1; NULL = not wanted.
   */
  uint32_t* overflow;
} l4d_cuda_trainable_rows;

/* Sets the arrays. The arrays of `gaussians` and rows->count are device pointers and are borrowed
 * until another scene is set or the handle is destroyed; gaussians->count is the capacity N. Keeps
 * 84 bytes of each row, and 8 more if there are flat windows, which stay as they are given; SH is
 * read in place. rows may be NULL. Waits for the device. Fails with INVALID_ARGUMENT if an array is
 * NULL or sh_stride is invalid. */
L4D_API l4d_status l4d_cuda_trainable_set_scene(l4d_cuda_trainable* trainable,
                                                const l4d_gaussians* gaussians,
                                                const l4d_timeline* timeline,
                                                const l4d_cuda_trainable_rows* rows);
/* Renders SH up to this degree only, from now on: 0 .. D, D at first. Coefficients of higher
 * degrees get no gradient. */
L4D_API l4d_status l4d_cuda_trainable_set_sh_degree(l4d_cuda_trainable* trainable, uint32_t degree);
/* Prepares all rows from the arrays as the earlier work on `stream` left them. Views show the scene
 * of the last refresh; backward reads the arrays again, so they must not change between refresh and
 * backward. Rows whose attributes are not finite are not shown. */
L4D_API l4d_status l4d_cuda_trainable_refresh(l4d_cuda_trainable* trainable, void* stream);

/* ---- views ----------------------------------------------------------------------------------- */

/* Allocates memory for the largest view and for `views` views of one forward: for each view 136
 * bytes per visible Gaussian and 68 per instance. Only grows. Waits for the device if it has to
 * allocate. capacity->backward is taken as 1. Fails with INVALID_ARGUMENT if views is 0 or above
 * L4D_CUDA_TRAINABLE_MAX_VIEWS. */
L4D_API l4d_status l4d_cuda_trainable_reserve(l4d_cuda_trainable* trainable,
                                              const l4d_cuda_frame_capacity* capacity,
                                              uint32_t views);

/* A view of forward. rgb and alpha are device pointers of the caller's. */
typedef struct l4d_cuda_trainable_view {
  size_t struct_size;
  const l4d_camera* camera; /* on the host */
  double time;              /* seconds, clamped to the sequence */
  float background[3];
  uint32_t reserved;
  float* rgb;   /* [height, width, 3], must stay unchanged until backward */
  float* alpha; /* [height, width]; NULL = not wanted */
} l4d_cuda_trainable_view;

/* Renders views of the scene, and keeps what backward needs. views: [num_views],
 * views[0].struct_size bytes apart. Views of one time share the list of visible Gaussians; views
 * run concurrently. A view that exceeds the reserved capacity shows the nearest Gaussians only,
 * gets no gradients and no statistics, and is counted in the report. Fails with INVALID_STATE if
 * nothing was refreshed, or if the reserved image size or number of views is too small. */
L4D_API l4d_status l4d_cuda_trainable_forward(l4d_cuda_trainable* trainable,
                                              const l4d_cuda_trainable_view* views,
                                              uint32_t num_views, void* stream);

/* The loss of a view, on the device. */
typedef struct l4d_cuda_trainable_loss {
  size_t struct_size;
  const float* rgb_gradient; /* [height, width, 3] derivative of the loss by the view's rgb */
  /* [height, width] a weight of each pixel, for statistics->error_coverage; NULL = 0. */
  const float* error;
  double* view_gradient; /* [9] += as l4d_gradients.view has it, of this view; NULL = not wanted */
} l4d_cuda_trainable_loss;

/* What views show of each row; device arrays of the caller's, NULL = not wanted. A row counts as
 * shown by a view if it contributes to at least one pixel. */
typedef struct l4d_cuda_trainable_statistics {
  size_t struct_size;
  uint8_t* shown;  /* [N] = 1 if a view shows the row */
  uint32_t* views; /* [N] += 1 for each view that shows the row */
  /* [N] += sum over pixels of alpha times transmittance. */
  float* coverage;
  /* [N] += sum over pixels of alpha times transmittance times error. */
  float* error_coverage;
  /* [N] += length of the loss's derivative by the projected mean, in units of half the image:
   * |(width/2 dL/dx, height/2 dL/dy)| with x and y in pixels. */
  float* screen_gradient;
} l4d_cuda_trainable_statistics;

/* Backward pass of the views of the last forward, without rendering again. losses: [num_views],
 * losses[0].struct_size bytes apart, in the order of the views. Adds to the arrays of `gradients`
 * (device pointers; gradients->count must be N, ->view NULL; SH rows are sh_stride apart) and of
 * `statistics`, view after view; the caller sets them to 0. statistics may be NULL. Fails with
 * INVALID_STATE unless the last forward had num_views views and nothing was refreshed or reserved
 * since. */
L4D_API l4d_status l4d_cuda_trainable_backward(l4d_cuda_trainable* trainable,
                                               const l4d_cuda_trainable_loss* losses,
                                               uint32_t num_views, const l4d_gradients* gradients,
                                               const l4d_cuda_trainable_statistics* statistics,
                                               void* stream);

/* ---- report ---------------------------------------------------------------------------------- */

/* Counters of all forwards since set_scene. */
typedef struct l4d_cuda_trainable_report {
  size_t struct_size;
  uint64_t views;              /* rendered */
  uint64_t skipped;            /* of these, views that exceeded the reserved capacity */
  uint64_t rows;               /* rows in use at the last refresh */
  uint64_t required_visible;   /* largest of all views */
  uint64_t required_instances; /* likewise, of tiles of 32x16 pixels as the capacity counts them */
  uint64_t visible, projected, instances; /* of view 0 of the last forward */
  /* Of view 0 of the last forward and backward; 0 unless the options have time_passes, and then
   * get_report waits for the last view. */
  double seconds[L4D_RENDER_MAX_PASSES];
} l4d_cuda_trainable_report;

/* Launches a copy of the counters to the host. */
L4D_API l4d_status l4d_cuda_trainable_copy_report(l4d_cuda_trainable* trainable, void* stream);
/* Returns the counters of the last copy. wait = 0: if that copy is not complete, leaves `report` as
 * it is and fails with INVALID_STATE; wait = 1: waits for it. Fails with INVALID_STATE without a
 * copy. */
L4D_API l4d_status l4d_cuda_trainable_get_report(l4d_cuda_trainable* trainable, uint32_t wait,
                                                 l4d_cuda_trainable_report* report);
#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_CUDA_TRAIN_H */
