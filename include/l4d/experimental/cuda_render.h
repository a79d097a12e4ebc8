/* SPDX-License-Identifier: Apache-2.0
 * experimental/cuda_render.h: rendering from Gaussians in device memory into images in device
 * memory, for players and trainers. Conventions of cameras, images and attributes are those of
 * render.h and l4d.h. Every build has these functions; in one without device code
 * l4d_cuda_renderer_create fails with FEATURE_UNSUPPORTED. Experimental: it may change with each
 * version of the library.
 *
 *   l4d_cuda_renderer* r;
 *   l4d_cuda_renderer_create(NULL, &r);
 *   l4d_cuda_renderer_set_gaussians(r, &device_arrays, &timeline);
 *   l4d_cuda_renderer_reserve(r, &capacity);                     // once; render() never allocates
 *   l4d_cuda_renderer_render(r, 2.5, &camera, &image, stream);   // returns at once
 *   l4d_cuda_renderer_get_stats(r, stream, &stats);              // waits; was the capacity enough?
 *
 * CUDA streams are passed as void* (a cudaStream_t). Calls that take a stream only launch work on
 * it and may be captured into a CUDA graph; the others wait for the device. A renderer has one set
 * of buffers: run its frames one after the other, on one stream or ordered by events. Images repeat
 * bit for bit.
 */
#ifndef L4D_EXPERIMENTAL_CUDA_RENDER_H
#define L4D_EXPERIMENTAL_CUDA_RENDER_H

#include "l4d/render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_cuda_renderer l4d_cuda_renderer;

enum {
  L4D_CUDA_SH_FLOAT32 = 0,
  L4D_CUDA_SH_FLOAT16 = 1 /* half the memory; colours change by less than 1e-3 of their size */
};
typedef struct l4d_cuda_renderer_options {
  size_t struct_size;
  uint32_t device;    /* CUDA's number of it */
  uint32_t sh_format; /* L4D_CUDA_SH_*, of the copy that is rendered from */
  /* 1: frames time their passes, at a cost of some microseconds each (l4d_cuda_frame_stats) */
  uint32_t time_passes;
  uint32_t reserved;
} l4d_cuda_renderer_options;

/* options may be NULL. Fails with DEVICE if the device does not exist or this build has no code for
 * it. */
L4D_API l4d_status l4d_cuda_renderer_create(const l4d_cuda_renderer_options* options,
                                            l4d_cuda_renderer** out);
L4D_API void l4d_cuda_renderer_destroy(l4d_cuda_renderer* renderer); /* accepts NULL; waits */

/* ---- the scene ------------------------------------------------------------------------------- */

/* Sets a scene. The arrays of `gaussians` are device pointers, and copied; their values are not
 * checked. The renderer keeps 76 bytes and the SH of each Gaussian, and 8 more if gaussians->window
 * is not NULL. Waits. */
L4D_API l4d_status l4d_cuda_renderer_set_gaussians(l4d_cuda_renderer* renderer,
                                                   const l4d_gaussians* gaussians,
                                                   const l4d_timeline* timeline);

/* ---- frames ---------------------------------------------------------------------------------- */

/* Capacities for the largest frame. Memory: 76 bytes per visible Gaussian and 16 per instance. They
 * only grow. */
typedef struct l4d_cuda_frame_capacity {
  size_t struct_size;
  uint32_t width, height; /* pixels */
  uint64_t visible;       /* Gaussians visible at one time; the number of all is always enough */
  uint64_t instances;     /* pairs of Gaussian and tile of 16x16 pixels, below 2^26 */
} l4d_cuda_frame_capacity;
L4D_API l4d_status l4d_cuda_renderer_reserve(l4d_cuda_renderer* renderer,
                                             const l4d_cuda_frame_capacity* capacity);

/* Destination on the device, owned by the caller; NULL = not wanted. */
typedef struct l4d_cuda_image {
  size_t struct_size;
  float* rgb;          /* [height, width, 3] */
  float* alpha;        /* [height, width] */
  uint32_t* rgba8;     /* [height, width] bytes R, G, B, A: values times 255, rounded, clamped */
  float background[3]; /* red, green, blue; 0 = black */
  uint32_t reserved;
} l4d_cuda_image;

/* Renders at `time` seconds, clamped to the sequence. Consecutive frames of one time share the list
 * of visible Gaussians. Fails with INVALID_STATE if the reserved image size is too small. If a
 * frame exceeds the reserved Gaussians or instances, the farthest ones are dropped, and get_stats
 * fails with LIMIT_EXCEEDED. */
L4D_API l4d_status l4d_cuda_renderer_render(l4d_cuda_renderer* renderer, double time,
                                            const l4d_camera* camera, const l4d_cuda_image* image,
                                            void* stream);

typedef struct l4d_cuda_frame_stats {
  size_t struct_size;
  uint64_t visible, projected, instances; /* as in l4d_render_stats */
  uint64_t required_visible;              /* required capacities */
  uint64_t required_instances;
  double seconds[L4D_RENDER_MAX_PASSES]; /* of the device, by L4D_RENDER_PASS_*; 0 unless timed */
} l4d_cuda_frame_stats;
/* Returns statistics of the last frame. Waits for its stream. Fails with LIMIT_EXCEEDED, and sets
 * `stats` even so, if the frame exceeded the reserved capacities. */
L4D_API l4d_status l4d_cuda_renderer_get_stats(l4d_cuda_renderer* renderer, void* stream,
                                               l4d_cuda_frame_stats* stats);
#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_CUDA_RENDER_H */
