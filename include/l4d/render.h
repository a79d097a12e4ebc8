/* SPDX-License-Identifier: Apache-2.0
 * render.h: images of a scene, gradients of images, and the importance of each Gaussian.
 * A separate library (libl4drender): neither a decoder nor an encoder needs it.
 *
 *   l4d_renderer* renderer;
 *   l4d_renderer_create(NULL, &renderer);
 *   l4d_renderer_set_streams(renderer, &decoder, NULL, 1, NULL);  // or l4d_renderer_set_gaussians
 *   l4d_renderer_set_time(renderer, 2.5);              // shared by all cameras of that instant
 *   l4d_renderer_render(renderer, &camera, &image);
 *   l4d_renderer_destroy(renderer);
 *
 * Images follow the conventions of 3D Gaussian splatting. In all backends:
 *  - A Gaussian whose mean has z <= near_plane in camera axes is skipped. The others are drawn in
 *    ascending order of z of their means. Backends order equal depths differently.
 *  - A splat has the mean (fx x/z + cx, fy y/z + cy) and the covariance J S J^T + 0.3 I, in pixels.
 *    S is the covariance in camera axes, J the derivative of the projection at the mean (EWA). In J
 *    alone, x/z and y/z are clamped to the image extended by 15 % of its width and height on each
 *    side, because J grows without bound. Beyond that the splat's shape is approximate, and
 * gradients treat the clamped slope as constant.
 *  - alpha = min(0.999, opacity exp(-q/2)) at the centre of each pixel, where q is the squared
 *    Mahalanobis distance. A splat is skipped where alpha is below 1/255: its border is a step of
 *    1/255, and a fading one disappears at 1/255. Gradients ignore these steps, the clamp of alpha,
 *    changes of the order, and the near plane.
 *  - Blending is front to back. A splat that would bring a pixel's transmittance below 1e-4 ends
 * the blending of that pixel and is not drawn. The remaining transmittance shows the background.
 *  - Colour is 0.5 + SH in the direction from the camera to the sliced mean, clamped to at least 0.
 *  - The numbers 0.3, 0.999 and 1/255 are those of 3D Gaussian splatting. Where l4d_rendering says
 *    otherwise, its dilation, max_alpha and min_alpha replace them, a splat also ends at its
 * cutoff, and its compensation scales the opacity. Images have no upper clamp. Rendering is not
 * normative: backends agree within rounding, not bit for bit, and rounding decides on which side of
 * a step a pixel lies. Each backend is deterministic: neither the number of threads nor
 * max_memory_bytes changes its result.
 */
#ifndef L4D_RENDER_H
#define L4D_RENDER_H

#include "l4d/decode.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_renderer l4d_renderer;

enum {
  L4D_RENDER_EXP_ACCURATE = 0, /* relative error below 2e-7 */
  /* Relative error below 1e-4. Single pixels change by more than a step of 8 bits, where the error
   * decides whether blending stops before a splat or after it. */
  L4D_RENDER_EXP_FAST = 1
};

typedef struct l4d_renderer_options {
  size_t struct_size;
  uint32_t threads; /* at most L4D_MAX_THREADS; 0 = one per core; never changes the result */
  /* L4D_BACKEND_*. AUTO and CPU: float, SIMD, tiles, threads. REFERENCE: double precision, one loop
   * per formula; slow, for checking the others. CUDA: a device. */
  uint32_t backend;
  uint32_t exponential; /* L4D_RENDER_EXP_*, of the CPU backend */
  uint32_t device;      /* of the CUDA backend: CUDA's number of the device */
  /* What the CPU backends may hold; 0 = 16 GiB. A call that needs more fails with LIMIT_EXCEEDED.
   * It counts the scene prepared, the Gaussians of the instant (52 bytes each, and 36 more of a
   * stream), splats of a view (144 bytes each) and the lists of splats by tile. The lists are made
   * for as much of the image at a time as fits, and never for more than 256 MiB; the image does not
   * depend on that. Not counted: what the caller gives, images and gradients among it, the
   * decoder's memory, which has a limit of its own, and sums of importance. The 12 bytes that
   * importance takes for each pixel of a view have to fit beside what is held. */
  uint64_t max_memory_bytes;
  /* Not NULL: another thread, or a handler of signals, may set *cancel to another number than 0. A
   * call of the CPU backend that draws, or derives importance, then fails with CANCELLED within
   * some tenths of a second, however large the image is. Borrowed until the renderer is destroyed.
   */
  const int32_t* cancel;
} l4d_renderer_options;

/* options may be NULL. Fails with INVALID_ARGUMENT if an option is out of range. A renderer of the
 * CUDA backend takes its device when it is given a scene; that call fails with
 * FEATURE_UNSUPPORTED in a build without device code, and with DEVICE where there is no device that
 * this build has code for. What it renders from is copied to the device, and images come back to
 * the host: a player that keeps both on the device uses cuda_render.h. It differs from the CPU
 * backend by rounding. */
L4D_API l4d_status l4d_renderer_create(const l4d_renderer_options* options, l4d_renderer** out);
L4D_API void l4d_renderer_destroy(l4d_renderer* renderer); /* accepts NULL */

/* ---- the scene ------------------------------------------------------------------------------ */

/* A scene of 4D Gaussians. Its arrays are borrowed until another scene is set or the renderer is
 * destroyed, and must not change meanwhile; what does not depend on time is prepared here. Fails
 * with INVALID_SCENE on NaN, Inf and log scales outside [-16, 16], naming Gaussian and attribute.
 */
L4D_API l4d_status l4d_renderer_set_gaussians(l4d_renderer* renderer,
                                              const l4d_gaussians* gaussians,
                                              const l4d_timeline* timeline);
/* Open streams: one, or several that are shown together, as the members of a file that show an
 * instant (members.h). At a time each is sliced at this time less its shift, through its decoder's
 * own cache, and the Gaussians of all are drawn as those of one scene, in the numbers that the
 * first stream states. Decoders are borrowed likewise, and used on the calling thread only.
 * decoders: [count], each once. shifts: [count] seconds; NULL = 0. point: what is shown of each;
 * NULL = all. Fails with INVALID_ARGUMENT if count is 0, a decoder NULL, a shift not finite or the
 * detail unknown, with INVALID_STATE if a decoder has no open stream. */
L4D_API l4d_status l4d_renderer_set_streams(l4d_renderer* renderer, l4d_decoder* const* decoders,
                                            const double* shifts, uint32_t count,
                                            const l4d_operating_point* point);
/* Sets the background colour; black at first. rgb: finite. */
L4D_API l4d_status l4d_renderer_set_background(l4d_renderer* renderer, const float* rgb /* [3] */);

/* How splats are drawn from now on, whatever the scene states. NULL = as the scene states: a stream
 * as its header does (l4d_decoder_get_rendering), Gaussians as 3D Gaussian splatting does.
 * Fails with INVALID_ARGUMENT if a number is out of its range. The CUDA backend draws by the
 * defaults alone: with others, set_streams, this function and rendering fail with
 * FEATURE_UNSUPPORTED. */
L4D_API l4d_status l4d_renderer_set_rendering(l4d_renderer* renderer,
                                              const l4d_rendering* rendering);

/* Slices the scene at `time` seconds (clamped to the sequence) for all calls that follow. */
L4D_API l4d_status l4d_renderer_set_time(l4d_renderer* renderer, double time);

/* ---- images -------------------------------------------------------------------------------- */
#define L4D_MAX_IMAGE_SIDE 16384u /* pixels */

/* A pinhole camera. Camera axes: x right, y down, z forward. A point p of the scene is at
 * world_to_camera (p, 1), and z > near_plane projects to (fx x/z + cx, fy y/z + cy) in pixels, the
 * centre of the first pixel being (0.5, 0.5). */
typedef struct l4d_camera {
  size_t struct_size;
  uint32_t width, height; /* pixels, 1..L4D_MAX_IMAGE_SIDE each */
  double fx, fy, cx, cy;  /* pixels */
  /* [3, 4] row-major, a rotation and a translation. A matrix whose rows are off by more than 1e-3
   * from unit length or right angles, or that mirrors, fails with INVALID_ARGUMENT. A rotation
   * of nine zeros is the identity. */
  double world_to_camera[12];
  double near_plane; /* scene units; 0 = 0.02 */
} l4d_camera;

/* Destination, owned by the caller. */
typedef struct l4d_image {
  size_t struct_size;
  float* rgb;   /* [height, width, 3], linear in the scene's colour space; may be NULL */
  float* alpha; /* [height, width] opacity of all Gaussians together; may be NULL */
} l4d_image;

/* Renders the instant of the last set_time. Fails with INVALID_STATE without one, INVALID_ARGUMENT
 * if the camera is invalid (see l4d_camera), LIMIT_EXCEEDED (see max_memory_bytes), OUT_OF_MEMORY,
 * DEVICE. */
L4D_API l4d_status l4d_renderer_render(l4d_renderer* renderer, const l4d_camera* camera,
                                       const l4d_image* image);

/* ---- gradients ----------------------------------------------------------------------------- */

/* Gradients of a scalar with respect to the attributes as they were given: [N, ...] as in
 * l4d_gaussians, so to logits where opacities are logits, and to unnormalised rotors. The call adds
 * to the arrays. NULL = not wanted. */
typedef struct l4d_gradients {
  size_t struct_size;
  uint64_t count;   /* N, must be the scene's */
  float* position;  /* [N, 3] */
  float* mean_t;    /* [N] */
  float* log_scale; /* [N, 4] */
  float* rotor;     /* [N, 8] */
  float* opacity;   /* [N] */
  float* sh;        /* [N, (D+1)^2, 3] */
  /* [9] by what the view is of: its time (1/s); a rotation vector w (rad) and a shift m (scene
   * units), both along the camera's axes, by which its world_to_camera x becomes exp([w]) x + m;
   * ln fx; ln fy. Gaussians whose own are not finite add nothing. */
  double* view;
} l4d_gradients;

/* Backward pass of one view at the time of the last set_time. rgb_gradient: [height, width, 3], the
 * derivative of the scalar with respect to each pixel. Adds to the arrays of `gradients`. Fails
 * with INVALID_STATE unless the scene is one of l4d_renderer_set_gaussians. */
L4D_API l4d_status l4d_renderer_backward(l4d_renderer* renderer, const l4d_camera* camera,
                                         const float* rgb_gradient, l4d_gradients* gradients);

/* ---- importance ---------------------------------------------------------------------------- */

/* One view of l4d_measure_importance. */
typedef struct l4d_view {
  double time;     /* seconds */
  uint32_t camera; /* index into the cameras */
  uint32_t reserved;
} l4d_view; /* frozen */

/* Distributed measurement: every process loads the same scene into its own renderer, calls
 * l4d_measure_importance with equal arguments, and gets the same result. Each process renders the
 * views of a part of the instants. */
typedef struct l4d_process_group {
  size_t struct_size;
  uint32_t rank;  /* of this process, below count */
  uint32_t count; /* number of processes; 0 = 1 */
  /* All-reduce: replaces values [n] by their sums over all processes. All processes call it with
   * the same n in the same order, on the thread that called l4d_measure_importance. Returns 0, or
   * another value on failure; l4d_measure_importance then fails with IO. */
  int (*sum)(void* user, int64_t* values, uint64_t n);
  void* user;
} l4d_process_group;

typedef struct l4d_measure_options {
  size_t struct_size;
  uint32_t metric; /* L4D_SENSITIVITY_* */
  uint32_t reserved;
  uint64_t seed; /* of the random signs, which depend on it, the view and its repetitions alone */
  /* Measuring stops when the rank correlation between the weights of both halves of the views is at
   * least this for every component; above 1 = never, 0 = 0.95. */
  double agreement;
  double max_share; /* measuring stops at this share of the views; 0 = 1 */
  /* The views that were not measured then get a visibility-only pass, in rounds of 1/16 of the
   * views of each instant, until less than 1e-4 of a round's blending weight belongs to Gaussians
   * that no view has shown before. */
  uint32_t skip_visibility; /* 1: no such pass */
  uint32_t visibility_all;  /* 1: the pass covers all of these views */
  /* NULL = this process alone. Otherwise, even for one process, sums are in fixed point, so that
   * weights do not depend on the number of processes. */
  const l4d_process_group* group;
  l4d_progress_fn progress; /* counts views; NULL = none */
  void* progress_user;
} l4d_measure_options;

typedef struct l4d_measure_report {
  size_t struct_size;
  uint64_t views;                 /* given */
  uint64_t views_measured;        /* with derivatives */
  uint64_t views_visibility_only; /* in the visibility-only pass */
  uint32_t rounds;
  uint32_t agreed;     /* 1: the halves agreed */
  double agreement[4]; /* rank correlation of the halves, by L4D_COMPONENT_*; 0 = not tested */
  uint64_t unseen;     /* Gaussians that none of the measured and visibility-only views shows */
} l4d_measure_report;

/* Measures how much images change with each Gaussian, by attribute, over as many of the views as
 * are needed. Works in rounds: each round adds views from other cameras at every instant, and
 * compares the weights of two independent halves of the views. SH derivatives are those without the
 * clamp of colours at 0: a Gaussian that is clamped to black still hides what lies behind it.
 * Opacities count as values in [0, 1] whatever the scene's flags.
 *
 * The renderer must hold the scene (l4d_renderer_set_gaussians), without a background; the call
 * changes its time. cameras: [num_cameras], cameras[0].struct_size bytes apart. views: [num_views],
 * in any order. options and report may be NULL. weights: [L4D_WEIGHT_COUNT], by L4D_WEIGHT_*; each
 * [count], or NULL if it is not wanted: what l4d_importance (encode.h) has. ALPHA_T is the sum of
 * alpha times transmittance per pixel, over the measured views; for Gaussians that only the
 * visibility-only pass shows, over all views.
 * Fails with INVALID_STATE without such a scene, INVALID_ARGUMENT if count is not that of the scene
 * or an argument is out of range, CANCELLED, IO, OUT_OF_MEMORY, LIMIT_EXCEEDED, DEVICE. */
L4D_API l4d_status l4d_measure_importance(l4d_renderer* renderer, const l4d_camera* cameras,
                                          uint32_t num_cameras, const l4d_view* views,
                                          uint64_t num_views, const l4d_measure_options* options,
                                          float* const* weights, uint64_t count,
                                          l4d_measure_report* report);

/* ---- statistics ---------------------------------------------------------------------------- */
enum {
  L4D_RENDER_PASS_SLICE = 0, /* the last set_time, including decoding */
  L4D_RENDER_PASS_PROJECT,
  L4D_RENDER_PASS_SORT,
  L4D_RENDER_PASS_BIN,
  L4D_RENDER_PASS_BLEND,
  L4D_RENDER_PASS_BACKWARD,
  L4D_RENDER_PASS_COUNT
};
#define L4D_RENDER_MAX_PASSES                              \
  8 /* length of arrays by pass, now and in later versions \
     */
typedef struct l4d_render_stats {
  size_t struct_size;
  uint64_t visible;   /* Gaussians visible at the time */
  uint64_t projected; /* of these, those that touch a pixel of the last view's frame */
  uint64_t instances; /* pairs of Gaussian and tile; 0 on the reference backend */
  double seconds[L4D_RENDER_MAX_PASSES]; /* by L4D_RENDER_PASS_*; 0 beyond */
} l4d_render_stats;
L4D_API l4d_status l4d_renderer_get_stats(const l4d_renderer* renderer, l4d_render_stats* stats);

#ifdef __cplusplus
}
#endif
#endif /* L4D_RENDER_H */
