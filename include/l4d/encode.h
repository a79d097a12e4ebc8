/* SPDX-License-Identifier: Apache-2.0
 * encode.h: writing .l4d streams.
 *
 *   l4d_encoder* encoder;
 *   l4d_encoder_create(NULL, &encoder);
 *   l4d_encoder_set_preset(encoder, "default");
 *   l4d_encoder_set_scene(encoder, &gaussians, &timeline, NULL);
 *   l4d_encoder_encode_file(encoder, "scene.l4d");
 *   l4d_encoder_destroy(encoder);
 */
#ifndef L4D_ENCODE_H
#define L4D_ENCODE_H

#include "l4d/l4d.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_encoder l4d_encoder;

typedef struct l4d_encoder_options {
  size_t struct_size;
  uint32_t threads; /* 0 = one per core; never changes the output */
  /* L4D_BACKEND_*; never changes the output. CUDA searches codebooks on CUDA device 0; AUTO does so
   * if there is one. */
  uint32_t backend;
  uint64_t seed; /* equal seeds give equal files on one machine */
} l4d_encoder_options;

/* Creates an encoder with the preset "default". options may be NULL: all defaults. On failure
 * l4d_last_error_message returns the reason.
 * Fails with INVALID_ARGUMENT if an option is out of range, OUT_OF_MEMORY, DEVICE if backend is
 * CUDA and no device can be used, FEATURE_UNSUPPORTED if this build lacks the backend. */
L4D_API l4d_status l4d_encoder_create(const l4d_encoder_options* options, l4d_encoder** out);
L4D_API void l4d_encoder_destroy(l4d_encoder* encoder); /* accepts NULL */
/* Registers a callback for the progress of encode calls; NULL removes it. Calls
 * inside a long step may repeat `done`; the last call has done == total. */
L4D_API l4d_status l4d_encoder_set_progress(l4d_encoder* encoder, l4d_progress_fn fn, void* user);

/* ---- parameters ---------------------------------------------------------------------------- */

/* Replaces all parameters by those of a preset. Fails with INVALID_ARGUMENT if there is no preset
 * of that name. l4d_encoder_preset_name(i) returns the i-th name, NULL after the last: "default",
 * "tiny", "small", "large", "archive": transforms at a quality. "indexed", "indexed-small",
 * "indexed-high": codebooks; with a packed form if L4D_ENC_PROFILE is 1. "paper-small",
 * "paper-large": settings of the paper's appendix "Compression"; use weights of
 * L4D_SENSITIVITY_SUM. "lossless": exact float32 bits. Gaussians are reordered. */
L4D_API l4d_status l4d_encoder_set_preset(l4d_encoder* encoder, const char* name);
L4D_API const char* l4d_encoder_preset_name(uint32_t index);
L4D_API const char* l4d_encoder_preset_description(uint32_t index);

/* A parameter has a name. Parameters below keep name and meaning as long as the library its major
 * version; those of experimental/parameters.h do not. l4d_encoder_parameter_info has all of them,
 * with ranges and defaults.
 *
 * A parameter that is per component takes the name of one behind a full stop: ".sh", ".scale",
 * ".rotor-spatial" or ".rotor-temporal". Without it, all are set, and that of SH is got. */
#define L4D_ENC_LOSSLESS "lossless" /* 0 | 1: raw float32 attributes */
/* Target fidelity in dB: PSNR of renders of the decoded scene against renders of the
 * input, 20..90. Sets every quantiser that has no parameter of its own. Calibrated for weights of
 * L4D_SENSITIVITY_GAUSS_NEWTON. */
#define L4D_ENC_QUALITY "quality"
/* 1..9: how hard to look for small codes, slower and better with each step. Sets kmeans-iterations,
 * kmeans-sample and zstd-level together; set one of them afterwards to override it. */
#define L4D_ENC_EFFORT "effort"
/* The next four bound the error of every single Gaussian, whatever its weight; 0 = no bound. A
 * Gaussian that exceeds a bound is coded more finely, or as an escape; the others are not
 * affected. A Gaussian's size is its largest standard deviation, or, if that is more, 1/4000 of
 * the scene's extent: on the axis where this is most, 1.25 times the side of the box that holds
 * nine tenths of the Gaussians, but at most the side of the box that holds all. The rounding of
 * binary16 positions adds to errors of position: then the stream states no bound on them.
 *
 * Distance between decoded and given position, in sizes, while the opacity is at least half of
 * its maximum. 0..1e6 */
#define L4D_ENC_MAX_POSITION_ERROR "max-position-error"
/* Ratio between a principal variance and the given one, whichever is larger over the other; and 1
 * plus the change of the variance in any direction over the largest variance. 0 or above 1 */
#define L4D_ENC_MAX_COVARIANCE_FACTOR "max-covariance-factor"
#define L4D_ENC_MAX_OPACITY_ERROR "max-opacity-error" /* of opacities at any instant, 0..1 */
/* Distance in scene units at any instant at which the Gaussian is visible. 0..1e30 */
#define L4D_ENC_MAX_VISIBLE_ERROR "max-visible-error"
/* The next two bound the errors of the colours of every single Gaussian, as the four above bound
 * others; 0 = no bound. Both are in colour units 0..1, or in parts of the largest colour of the
 * original if that is above 1: of the absolute value of a channel at degree 0, with its offset of
 * 0.5, and of the sum below over the original's own coefficients. If L4D_ENC_QUALITY is set below
 * the preset's quality, a bound that was not set is that of the preset times
 * 10^((preset's quality - quality) / 20).
 *
 * Base colour: the largest difference of a channel at degree 0. 0..1e6 */
#define L4D_ENC_MAX_BASE_COLOR_ERROR "max-base-color-error"
/* Directional colour: what degrees 1 to 3 add to the error, at most, in any view direction. It is
 * the sum over degrees l of sqrt((2l + 1) / (4 pi)) times the Euclidean norm of the difference of
 * the coefficients of degree l, of the channel in which this is largest. 0..1e6 */
#define L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR "max-directional-color-error"
#define L4D_ENC_DROP_INVALID "drop-invalid" /* 0 | 1: drop what encoding would refuse */
#define L4D_ENC_PRUNE_WEIGHT "prune-weight" /* drop Gaussians with ALPHA_T <= this; < 0 = never */
/* Drops a Gaussian if its bits reduce the error more when spent on other Gaussians: factor on
 * that threshold, 0 = drops none, 0..10. Needs weights L4D_WEIGHT_OPACITY of
 * L4D_SENSITIVITY_GAUSS_NEWTON. */
#define L4D_ENC_PRUNE_COST "prune-cost"
/* Gaussians per page, 64..65536. A device decodes pages in parallel: shorter pages use it better.
 * 4096 in presets with rANS pages, 32768 in presets with zstd. */
#define L4D_ENC_PAGE_SIZE "page-size"
/* What the stream declares (spec chapter "Profiles and levels"): -1 = the narrowest profile and
 * the smallest level that it meets, 0 = none. Encoding fails with INVALID_ARGUMENT if other
 * parameters contradict the profile, and with LIMIT_EXCEEDED if the finished stream exceeds the
 * level; it then writes nothing, and the message says which limit and by how much. */
#define L4D_ENC_PROFILE "profile" /* L4D_PROFILE_*, or -1 */
#define L4D_ENC_LEVEL "level"     /* 1..6, 0 or -1 */

/* A list: cuts the Gaussians of temporal level 0, the long-lived ones, into one tier more than it
 * has values, by importance: by alpha_t weights, else by those of opacities, else as the encoder
 * estimates it. The first k tiers hold the share values[k - 1] of them, about; small parts join the
 * tier before. A player shows a coarse picture with the first tier (l4d_operating_point.tiers).
 * Less than L4D_MAX_TIERS values between 0 and 1, ascending; none, as at first and in presets: one
 * tier. */
#define L4D_ENC_TIERS "tiers"
#define L4D_MAX_TIERS 8

/* Sets a parameter. Fails with INVALID_ARGUMENT if there is none of that name, with such a
 * component, if it is a list, or if value is out of range. */
L4D_API l4d_status l4d_encoder_set(l4d_encoder* encoder, const char* name, double value);
/* Sets a list. values: [count], which count as float32. Fails with INVALID_ARGUMENT if there is no
 * list of that name, or on another list than its description allows. */
L4D_API l4d_status l4d_encoder_set_list(l4d_encoder* encoder, const char* name,
                                        const double* values, uint32_t count);
/* Returns the value of a parameter that is no list. */
L4D_API l4d_status l4d_encoder_get(const l4d_encoder* encoder, const char* name, double* value);

typedef struct l4d_parameter_info {
  size_t struct_size;
  const char* name; /* static, as the other texts */
  const char* description;
  const char* unit;       /* "dB", "sizes", ..; "" = none */
  double min, max;        /* of a value */
  double initial;         /* of a new encoder; 0 of a list */
  uint32_t max_values;    /* 1: a number; more: a list of at most so many */
  uint32_t integer;       /* 1: whole numbers only */
  uint32_t per_component; /* 1: see above */
  uint32_t stable;        /* 0: of experimental/parameters.h */
} l4d_parameter_info;
/* Describes parameter `index`; lists come last. Fails with INVALID_ARGUMENT beyond the last.
 */
L4D_API l4d_status l4d_encoder_parameter_info(uint32_t index, l4d_parameter_info* info);

/* ---- input --------------------------------------------------------------------------------- */

/* Sets the scene. The encoder borrows the arrays until another scene is set, and reads them
 * while it encodes. placement may be NULL (identity). Log scales in (16, 17] are coded as 16, those
 * in
 * [-17, -16) as -16: coding errors make such values.
 * Fails with INVALID_SCENE if the scene has no Gaussian, and with INVALID_ARGUMENT if an array is
 * missing or the timeline is out of range. Encoding fails with INVALID_SCENE on NaN, Inf and log
 * scales outside [-17, 17], naming Gaussian and attribute, unless DROP_INVALID is set. */
L4D_API l4d_status l4d_encoder_set_scene(l4d_encoder* encoder, const l4d_gaussians* gaussians,
                                         const l4d_timeline* timeline,
                                         const l4d_placement* placement);

/* Codes these opacities in place of those of the scene, which were fitted to what is left when
 * others are dropped, say. The errors of opacity that the report and the stream state stay those
 * against the scene. opacity: [count] as the scene has them (L4D_OPACITY_LOGIT); borrowed until
 * another scene is set, which is coded with its own; NULL = the scene's. Fails with INVALID_STATE
 * without a scene. Encoding fails with INVALID_ARGUMENT where the stream is to be lossless. */
L4D_API l4d_status l4d_encoder_set_fitted_opacity(l4d_encoder* encoder, const float* opacity);

/* What importance was measured from. It decides what is dropped, unless L4D_ENC_PRUNE_WEIGHT and
 * L4D_ENC_PRUNE_COST are set after the preset. A lossless stream keeps all Gaussians whatever the
 * views. */
enum {
  /* Pruning is as the preset has it. */
  L4D_WEIGHT_VIEWS_UNKNOWN = 0,
  /* Every view that the scene is made for. A Gaussian whose alpha_t weight is 0 shows to nobody and
   * is dropped; one that costs more than it shows is dropped as the preset has it. */
  L4D_WEIGHT_VIEWS_ALL = 1,
  /* Some of these views, or made-up ones. A Gaussian may show in others: none is dropped, and where
   * ALPHA_T is given and the metric is Gauss-Newton's, an estimate counts beside them. */
  L4D_WEIGHT_VIEWS_SOME = 2
};

/* How much images of the scene change with each of its N Gaussians, and how large each has to be
 * for its errors to count. Any renderer can measure it. */
typedef struct l4d_importance {
  size_t struct_size;
  uint64_t count;  /* N */
  uint32_t metric; /* of the weights: L4D_SENSITIVITY_* */
  uint32_t views;  /* that they were measured from: L4D_WEIGHT_VIEWS_* */
  /* By L4D_WEIGHT_*: [N] or NULL; larger = more visible; finite and >= 0. A component without
   * weights of its own uses ALPHA_T, and without that an estimate from opacity, size, shape and
   * lifetime. ALPHA_T also decides what PRUNE_WEIGHT drops. */
  const float* weights[L4D_WEIGHT_COUNT];
  /* [N] scene units, or NULL; finite and >= 0. Sizes below which errors of single Gaussians do not
   * count (L4D_ENC_MAX_POSITION_ERROR), each Gaussian's own: half a pixel at its distance from the
   * nearest camera, say. The minimum size of the scene counts where that is larger. */
  const float* min_sizes;
} l4d_importance;

/* Sets the importance of the scene's Gaussians, all of it anew; NULL: it is estimated. The encoder
 * borrows the arrays until importance or a scene is set, which has none at first.
 * Fails with INVALID_STATE without a scene, with INVALID_ARGUMENT if count is not that of the scene
 * or metric or views is unknown, and with INVALID_SCENE on a number that is not finite or below 0,
 * naming the Gaussian. What was set before then stays. */
L4D_API l4d_status l4d_encoder_set_importance(l4d_encoder* encoder,
                                              const l4d_importance* importance);

/* States in the stream how it asks to be drawn and shown. NULL, or a
 * struct with the default of every field = the stream states nothing. Fails with INVALID_ARGUMENT
 * if a number is out of its range. Coded attributes do not depend on either. */
L4D_API l4d_status l4d_encoder_set_rendering(l4d_encoder* encoder, const l4d_rendering* rendering);
L4D_API l4d_status l4d_encoder_set_presentation(l4d_encoder* encoder,
                                                const l4d_presentation* presentation);

/* Adds a key and a value to the stream's metadata. Both are copied. Fails with INVALID_ARGUMENT if
 * one is not UTF-8. */
L4D_API l4d_status l4d_encoder_add_metadata(l4d_encoder* encoder, const char* key,
                                            const char* value);

/* ---- encoding ------------------------------------------------------------------------------ */
/* Encodes the scene and passes the stream to the writer. Can be called again, with other
 * parameters. Fails with INVALID_STATE without a scene, INVALID_SCENE, INVALID_ARGUMENT if
 * parameters contradict each other, LIMIT_EXCEEDED (see L4D_ENC_LEVEL), OUT_OF_MEMORY, CANCELLED,
 * IO if the writer fails, DEVICE. */
L4D_API l4d_status l4d_encoder_encode(l4d_encoder* encoder, const l4d_writer* writer);
/* Encodes to a file. Writes a temporary file PATH.l4dtmp0 in the same folder and renames it when it
 * is complete; on failure nothing remains, and an existing file stays as it was. Follows symbolic
 * links. Writes devices, pipes and /dev/fd/N in place. Fails as l4d_encoder_encode does. */
L4D_API l4d_status l4d_encoder_encode_file(l4d_encoder* encoder, const char* path);

/* Results of the last successful encode. Functions below fail with INVALID_STATE before the first.
 */
typedef struct l4d_encode_step {
  const char* name; /* static */
  double seconds;   /* of wall time */
} l4d_encode_step;  /* frozen */
typedef struct l4d_encode_report {
  size_t struct_size;
  uint64_t input_gaussians;
  uint64_t coded_gaussians;
  uint64_t invalid_dropped;
  uint64_t pruned;
  uint64_t moved_to_coarser; /* moved to a coarser layer after quantisation */
  uint64_t raw_bytes;        /* 4 (17 + 3 (D+1)^2) per input Gaussian */
  uint64_t file_bytes;
  uint32_t num_steps; /* of `steps` */
  uint32_t num_layers;
  double total_seconds;
  uint64_t escapes; /* Gaussians coded as escapes: far outside, or to meet a bound */
  /* Largest errors over all Gaussians, as the bounds on them measure them, whether there are any or
   * not. The stream states them: l4d_decoder_get_coding_errors. */
  double max_position_error;
  double max_covariance_factor;
  double max_opacity_error;
  double max_visible_error; /* scene units */
  double max_mean_t_error;  /* in standard deviations over time of the Gaussian */
  double max_base_color_error;
  double max_directional_color_error;
  /* [num_steps] how long each step took; lent until the encoder encodes again or is destroyed. */
  const l4d_encode_step* steps;
} l4d_encode_report;
L4D_API l4d_status l4d_encoder_get_report(const l4d_encoder* encoder, l4d_encode_report* report);
/* Returns where each decoded Gaussian comes from: order[i] is the index in the input scene of the
 * i-th Gaussian that decodes. order: [capacity]. Fails with BUFFER_TOO_SMALL if capacity is below
 * l4d_encode_report.coded_gaussians. */
L4D_API l4d_status l4d_encoder_get_order(const l4d_encoder* encoder, uint32_t* order,
                                         uint64_t capacity);

#ifdef __cplusplus
}
#endif
#endif /* L4D_ENCODE_H */
