/* SPDX-License-Identifier: Apache-2.0
 * l4d.h: what decoding and encoding share: status codes, versions, host I/O, limits, scene views.
 *
 * Conventions, true of every function of this library:
 *  - A function that can fail returns l4d_status. Results come back through pointers, which are
 *    written only on L4D_OK unless a comment says otherwise.
 *  - A handle belongs to one thread at a time; different handles share no mutable state.
 *  - A callback must not call a function on the handle whose call it serves. Such a call changes
 *    nothing and returns L4D_ERR_INVALID_STATE; a destroy then does nothing, so the handle has to
 *    be destroyed later. Calls on other handles are allowed.
 *  - Multi-dimensional data is row-major, innermost axis last, written [N, 3]. Lengths are scene
 *    units, time is seconds, angles radians.
 *  - A struct is either versioned or frozen. A versioned struct begins with `size_t struct_size`,
 *    and later versions append fields. L4D_INIT sets struct_size, and all other fields to 0, which
 *    is the default of every field. A function that reads or fills a versioned struct returns
 *    L4D_ERR_INVALID_ARGUMENT if struct_size is below the size of the struct's first version. A
 *    frozen struct has no struct_size: the caller sets every field, and its layout never changes.
 *  - The elements of an array of versioned structs lie struct_size bytes apart, and all have the
 *    same struct_size. A program's own array is like that.
 *  - A function that fills a caller's array takes the array's capacity, and never writes beyond it.
 *    If the array is too small, the function returns L4D_ERR_BUFFER_TOO_SMALL and the count that it
 *    needed, or writes as many elements as fit and returns the full count; its comment says which.
 *  - The library never prints, exits, reads the environment or throws across this border.
 */
#ifndef L4D_L4D_H
#define L4D_L4D_H

#include <stddef.h>
#include <stdint.h>

#include "l4d/export.h"

/* A versioned struct with the default of every field, in C and in C++:
 *   l4d_query query = L4D_INIT(l4d_query);
 * In C, an object with static storage takes {.struct_size = sizeof(T)} in its place. */
#ifdef __cplusplus
template <typename T>
inline T l4d_make_() noexcept {
  T out = {};
  out.struct_size = sizeof(T);
  return out;
}
#define L4D_INIT(T) (l4d_make_<T>())
extern "C" {
#else
#define L4D_INIT(T) ((T){.struct_size = sizeof(T)})
#endif

/* ---- versions of the library and of the bitstream; they are independent
 * --------------------------------- */
#define L4D_VERSION_MAJOR 0
#define L4D_VERSION_MINOR 1
#define L4D_VERSION_PATCH 0
/* Newest bitstream this library reads, and the one it writes. */
#define L4D_BITSTREAM_MAJOR 1
#define L4D_BITSTREAM_MINOR 0
L4D_API uint32_t l4d_version_number(void);    /* major << 24 | minor << 16 | patch << 8 */
L4D_API const char* l4d_version_string(void); /* static storage */
/* Compiler, SIMD targets compiled in, the one chosen on this machine, "; "-separated; static. */
L4D_API const char* l4d_build_info(void);

/* ---- status -------------------------------------------------------------------------------- */
typedef int32_t l4d_status;
enum {
  L4D_OK = 0,
  L4D_ERR_INVALID_ARGUMENT = -1, /* an argument breaks the function's contract */
  L4D_ERR_INVALID_STATE = -2,    /* the handle cannot serve this call now */
  L4D_ERR_OUT_OF_MEMORY = -3,
  L4D_ERR_IO = -4,                   /* a reader or writer callback failed */
  L4D_ERR_CANCELLED = -5,            /* the progress callback asked to stop */
  L4D_ERR_LIMIT_EXCEEDED = -6,       /* a valid stream that needs more than the caller's limits */
  L4D_ERR_INVALID_SCENE = -7,        /* encoder input holds NaN, Inf or values out of range */
  L4D_ERR_BUFFER_TOO_SMALL = -8,     /* a caller's array is too small; the count it needs is set */
  L4D_ERR_NEED_DATA = -9,            /* bytes that are not here yet, see playback.h */
  L4D_ERR_NOT_L4D = -10,             /* the magic does not match */
  L4D_ERR_VERSION_UNSUPPORTED = -11, /* a bitstream major version this library does not read */
  L4D_ERR_FEATURE_UNSUPPORTED = -12, /* this library lacks a coding tool or a backend */
  L4D_ERR_TRUNCATED = -13,           /* the stream ends before data it refers to */
  L4D_ERR_CORRUPT = -14,             /* a MUST of the specification is violated */
  L4D_ERR_CHECKSUM = -15,            /* stored bytes do not match their checksum */
  L4D_ERR_DEVICE = -20,              /* no usable device, or the CUDA runtime failed */
  L4D_ERR_INTERNAL = -99             /* a defect of this library; please report it */
};
L4D_API const char* l4d_status_name(l4d_status status);        /* "L4D_ERR_CORRUPT"; static */
L4D_API const char* l4d_status_description(l4d_status status); /* one sentence; static */
/* Returns why the last failed call on this thread failed, of any function of libl4dcodec,
 * libl4dencoder or libl4drender; "" if none has failed. UTF-8, valid until the next call on this
 * thread that fails: read it, or copy it, before you call on. For people: its wording changes
 * between versions. */
L4D_API const char* l4d_last_error_message(void);
/* Internal, for libl4dencoder and libl4drender: sets that message, cut to 1023 bytes. */
L4D_API void l4d_keep_error_message_(const char* message);

/* ---- host services ------------------------------------------------------------------------- */

/* One of several reads: `size` bytes of the file from `offset` on go to `dst`. */
typedef struct l4d_read {
  uint64_t offset;
  size_t size;
  void* dst;
} l4d_read; /* frozen */

/* Random-access input. read_at behaves as pread(2): it returns the number of bytes read (fewer than
 * n only at the end), or a negative number on failure. The library calls a handle's reader on the
 * thread that called the library, and never twice at a time. One exception: a player of
 * cuda_player.h also reads on its own thread. */
typedef struct l4d_reader {
  size_t struct_size;
  void* user;
  int64_t (*read_at)(void* user, void* dst, size_t n, uint64_t offset);
  int64_t (*size)(void* user); /* total bytes, or < 0 on failure */
  /* Makes `count` reads, in any order or at the same time, and returns 0 when all are done, or
   * another value on failure. NULL: the library calls read_at for each. */
  int (*read_many)(void* user, const l4d_read* reads, size_t count);
  /* How many bytes take as long as one more read: latency times throughput. 0: of a local file,
   * and the decoder reads what it needs when it needs it. Otherwise, of a network (65536 suits
   * most), a decoder reads more and less often: the first block_bytes of the file at once, all
   * codebooks and directory pages that are not too large beforehand, all pages of a slice together,
   * over gaps of up to block_bytes, and the next second while slices step forward. */
  uint64_t block_bytes;
} l4d_reader;

/* Sequential output. write takes all n bytes and returns 0, or returns another value on failure. */
typedef struct l4d_writer {
  size_t struct_size;
  void* user;
  int (*write)(void* user, const void* src, size_t n);
} l4d_writer;

/* Called between steps of a long call, on the thread that made the call. `stage` is a short static
 * name. A nonzero return cancels: the call returns L4D_ERR_CANCELLED and the handle stays valid. */
typedef int (*l4d_progress_fn)(void* user, uint64_t done, uint64_t total, const char* stage);

/* Most threads that a handle can be given; more fail with INVALID_ARGUMENT. */
#define L4D_MAX_THREADS 4096u

/* ---- the scene ----------------------------------------------------------------------------- */

/* The time span of a scene. Frame k begins at time_begin + k * fps_den / fps_num seconds; the
 * sequence is the half-open interval of num_frames frames. All times of the API, mean times
 * included, are on this clock. It may have any origin; seconds since 1970 have a resolution of
 * 0.24 us. */
#define L4D_MAX_FRAMES (1u << 24)
typedef struct l4d_timeline {
  double time_begin;   /* seconds */
  uint32_t num_frames; /* 1..L4D_MAX_FRAMES */
  uint32_t fps_num;
  uint32_t fps_den;
  uint32_t reserved;
} l4d_timeline; /* frozen */

/* Meaning of the attribute arrays. */
enum {
  /* `position` holds where the Gaussian is at its mean time. Without this flag: where it is at
   * t_ref = clamp(mean_t, time_begin, time_end), the coded form of lossy streams. */
  L4D_POSITION_AT_MEAN_TIME = 1u << 0,
  /* `opacity` holds logits. Without this flag: values in [0, 1]. */
  L4D_OPACITY_LOGIT = 1u << 1
};

/* Input: N 4D-rotor Gaussians as read-only arrays, owned by the caller. Give map coordinates such
 * as UTM relative to an origin and put that origin into l4d_placement: absolute ones have a
 * resolution of half a metre in float32. Times are on the timeline's clock. */
typedef struct l4d_gaussians {
  size_t struct_size;
  uint64_t count;         /* N */
  uint32_t sh_degree;     /* D, 0..3 */
  uint32_t flags;         /* L4D_POSITION_AT_MEAN_TIME, L4D_OPACITY_LOGIT */
  const float* position;  /* [N, 3] scene units */
  const float* mean_t;    /* [N] seconds */
  const float* log_scale; /* [N, 4] natural logarithms; x, y, z in scene units, t in seconds */
  const float* rotor;     /* [N, 8] s b01 b02 b12 b03 b13 b23 p */
  const float* opacity;   /* [N] */
  const float* sh;        /* [N, (D+1)^2, 3] coefficient-major; colour = 0.5 + sum */
  /* [N] seconds, or NULL. If given, it replaces `mean_t`, which may then be NULL. float32 resolves
   * 8 ms after a day, and two minutes in seconds since 1970. */
  const double* mean_t_double;
  /* [N, 2] frames, or NULL. begin < end <= num_frames: a flat window. The Gaussian has its whole
   * opacity in the frames from `begin` to `end` - 1, and is not there in any other; `mean_t` says
   * what its position refers to, and nothing else. 0, 0: the Gaussian fades around its mean time.
   * Windows that begin where others end tile time: every time belongs to exactly one frame. A
   * caller whose windows do not begin and end with frames rounds them. */
  const uint32_t* window;
} l4d_gaussians;

/* Where a decoded scene lies in the world: world = origin + scale * position. The library stores
 * this and never applies it, so that large coordinates cost no precision. */
typedef struct l4d_placement {
  double origin[3];
  double scale;
  uint32_t coordinate_system; /* l4d_coordinate_system */
  uint32_t color_space;       /* l4d_color_space */
} l4d_placement;              /* frozen */
enum {
  L4D_COORDINATES_UNKNOWN = 0,
  L4D_COORDINATES_RIGHT_UP_BACK = 1,
  L4D_COORDINATES_RIGHT_DOWN_FORWARD = 2
};
enum { L4D_COLOR_SRGB = 0, L4D_COLOR_LINEAR_SRGB = 1 };

/* How a scene wants to be drawn (spec section "Rendering"): what renderers of Gaussians do
 * differently. A scene looks as it was trained only if the renderer uses the numbers of its
 * training. The numbers of 3D Gaussian splatting are dilation 0.3, cutoff 0, min_alpha 1/255,
 * max_alpha 0.999 and compensation 0. They hold if nothing is stated, and are what a struct means
 * whose five numbers are 0. */
typedef struct l4d_rendering {
  size_t struct_size;
  float dilation;  /* pixels^2, 0..16; added to both variances of every splat in the image */
  float cutoff;    /* standard deviations, 1..16, at which a splat ends; 0 = at min_alpha alone */
  float min_alpha; /* 1/255..1/4; a splat is skipped where its alpha is lower */
  float max_alpha; /* 0.5..0.999; alpha is clamped to it */
  /* 1: the opacity of a splat is multiplied by sqrt(det C / det C'), where C is its covariance in
   * the image before dilation and C' after ("anti-aliased" splatting). 0: it is not. */
  uint32_t compensation;
  uint32_t stated; /* output of l4d_decoder_get_rendering: 1 if the stream says so; else ignored */
} l4d_rendering;

/* What a player does with a scene unless its user says otherwise (spec section "Presentation"). */
enum {
  L4D_PLAYBACK_UNSTATED = 0,
  L4D_PLAYBACK_ONCE = 1,
  L4D_PLAYBACK_LOOP = 2,
  L4D_PLAYBACK_PING_PONG = 3 /* forwards, then backwards, and again */
};
typedef struct l4d_presentation {
  size_t struct_size;
  uint32_t playback;                   /* L4D_PLAYBACK_*, or of a later version */
  uint32_t has_bounds;                 /* 1: bounds_min and bounds_max are given */
  double bounds_min[3], bounds_max[3]; /* scene units; a box around what is worth looking at */
  uint32_t has_camera;                 /* 1: the camera is given */
  uint32_t reserved;
  double camera_position[3], camera_target[3]; /* scene units; the camera looks at the target */
  double camera_up[3];                         /* direction; not parallel to the view */
  double camera_fov;                           /* vertical field of view, in (0, 3) */
  double metres_per_unit;                      /* length of a scene unit; 0 = unknown */
} l4d_presentation;

/* Components: the parts of a Gaussian that are coded as vectors. Their number is final. */
enum {
  L4D_COMPONENT_SH = 0,
  L4D_COMPONENT_SCALE = 1,          /* log_scale less the scale factor */
  L4D_COMPONENT_ROTOR_SPATIAL = 2,  /* s b01 b02 b12 */
  L4D_COMPONENT_ROTOR_TEMPORAL = 3, /* b03 b13 b23 p */
  L4D_COMPONENT_COUNT = 4
};

#define L4D_MAX_STAGES 8

/* Importance weights: one for each component (SH, scale, both halves of the rotor), one for each
 * other attribute (position, opacity, mean_t), and ALPHA_T, the accumulated blending weight. */
enum {
  L4D_WEIGHT_SH = 0,
  L4D_WEIGHT_SCALE = 1,
  L4D_WEIGHT_ROTOR_SPATIAL = 2,
  L4D_WEIGHT_ROTOR_TEMPORAL = 3,
  L4D_WEIGHT_ALPHA_T = 4, /* sum of alpha times transmittance, per pixel */
  L4D_WEIGHT_POSITION = 5,
  L4D_WEIGHT_OPACITY = 6,
  L4D_WEIGHT_MEAN_T = 7,
  L4D_WEIGHT_COUNT = 8 /* final */
};

/* What a weight measures. */
enum {
  /* The sensitivity of the paper (section 3.3), as C3DGS defines it. Of each view the sum of all
   * pixels and channels is taken on black; the magnitude of its derivative by every number of an
   * attribute is added up over views and divided by the number of pixels, and the largest over the
   * attribute's numbers is its weight. Of SH it is the derivative of the sum of one channel. */
  L4D_SENSITIVITY_SUM = 0,
  /* One unit for all attributes: weight^2 e^2, added up over all numbers that have an error e,
   * predicts the squared error of images per pixel where errors are independent. That is with the
   * three channels added up: three times the mean squared error of PSNR. A weight is the root of
   * the mean, over the attribute's numbers, of the diagonal of the Gauss-Newton matrix: squared
   * derivatives of each channel of each pixel, added up and divided by the number of pixels. They
   * are estimated, without bias, by the squared derivative of one sum per view in which every
   * channel of every pixel has a random sign. Derivatives are by attributes as streams code them:
   * positions at t_ref, rotors normalised. */
  L4D_SENSITIVITY_GAUSS_NEWTON = 1
};

#ifdef __cplusplus
}
#endif
#endif /* L4D_L4D_H */
