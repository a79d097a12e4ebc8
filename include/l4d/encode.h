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
L4D_API void l4d_encoder_options_init_(l4d_encoder_options* options, size_t struct_size);
#define l4d_encoder_options_init(options) l4d_encoder_options_init_((options), sizeof(*(options)))

/* Creates an encoder with the preset "default". options may be NULL: all defaults. On failure
 * l4d_last_error_message returns the reason.
 * Fails with INVALID_ARGUMENT if an option is out of range, OUT_OF_MEMORY, DEVICE if backend is
 * CUDA and no device can be used, FEATURE_UNSUPPORTED if this build lacks the backend. */
L4D_API l4d_status l4d_encoder_create(const l4d_encoder_options* options, l4d_encoder** out);
L4D_API void l4d_encoder_destroy(l4d_encoder* encoder); /* accepts NULL */
/* As l4d_decoder_error_message. */
L4D_API const char* l4d_encoder_error_message(const l4d_encoder* encoder);
/* Registers a callback for the progress of encode calls; NULL removes it. */
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

/* A parameter is an id with a value. `component` is an L4D_COMPONENT_* or L4D_ALL_COMPONENTS; a
 * parameter that is not per component accepts L4D_ALL_COMPONENTS only. */
#define L4D_ALL_COMPONENTS (-1)
typedef int32_t l4d_encoder_parameter;
enum {
  L4D_ENC_LOSSLESS = 0,      /* 0 | 1: raw float32 attributes */
  L4D_ENC_CODEBOOK_SIZE = 1, /* per component: entries of each stage, 1..65536 */
  L4D_ENC_ESCAPE_THRESHOLD =
      2,           /* per component: weight above which a vector is coded as an escape; 0 = never */
  L4D_ENC_RCQ = 3, /* 0 never, 1 where it pays, 2 wherever allowed */
  L4D_ENC_RCQ_SIZE = 4,       /* entries of a residual codebook, 1..4096 */
  L4D_ENC_MERGE_FRACTION = 5, /* a finest layer with fewer than this share is merged, 0..1 */
  L4D_ENC_MERGE_COUNT = 6,    /* ... or with fewer Gaussians than this */
  L4D_ENC_PRUNE_WEIGHT = 7,   /* drop Gaussians with alpha_t weight <= this; < 0 = never */
  /* Gaussians per page, 64..65536. A device decodes pages in parallel: shorter pages use it better.
   * 4096 in presets with rANS pages, 32768 in presets with zstd. */
  L4D_ENC_PAGE_SIZE = 8,
  L4D_ENC_CLOSED_LOOP = 9,   /* 0 | 1: fit positions to the decoded shape */
  L4D_ENC_GAUGE = 10,        /* rotors: 0 as given, 1 sign, 2 nearest identity, 3 sorted scales */
  L4D_ENC_OPACITY_BITS = 11, /* 1..16; 0: as the quality allows */
  L4D_ENC_SCALE_FACTOR_BITS = 12, /* 1..16 */
  L4D_ENC_KMEANS_ITERATIONS = 13, /* 0..1000 */
  L4D_ENC_KMEANS_SAMPLE = 14,     /* training points per codeword, 1..1000000 */
  L4D_ENC_ZSTD_LEVEL = 15,        /* 1..22 */
  L4D_ENC_DROP_INVALID = 16,      /* 0 | 1: drop Gaussians with NaN, Inf or values out of range */
  /* 1..9: sets KMEANS_ITERATIONS, KMEANS_SAMPLE and ZSTD_LEVEL together, slower and better with
   * each step; set one of them afterwards to override it. */
  L4D_ENC_EFFORT = 17,
  /* Per component: 0 codebooks, 1 transform, 2 the cheaper one by error and bits. Chosen once for
   * SH and per layer for the others; both halves of the rotor use the same coding. */
  L4D_ENC_CODING = 18,
  /* Target fidelity in dB: PSNR of renders of the decoded scene against renders of the
   * input, 20..90. Sets every quantiser that has no parameter of its own. Calibrated for weights of
   * L4D_SENSITIVITY_GAUSS_NEWTON. */
  L4D_ENC_QUALITY = 19,
  L4D_ENC_QUALITY_OFFSET = 20, /* per component: dB added to the quality */
  L4D_ENC_FIXED_POSITIONS =
      21, /* 0: binary16, 1: fixed point with a step that follows the quality */
  /* 0..10: codes mean times as binary16 in units of the bucket width, and drops this number of low
   * bits. -1: chosen by the quality: binary16 if the stream has a packed form, else fixed point. */
  L4D_ENC_MEAN_T_SHIFT = 22,
  L4D_ENC_RANS = 23, /* 0: zstd, 1: rANS pages */
  L4D_ENC_WEIGHT_METRIC =
      24, /* what the caller's weights are: 0 L4D_SENSITIVITY_SUM, 1 _GAUSS_NEWTON */
  /* Drops a Gaussian if its bits reduce the error more when spent on other Gaussians: factor on
   * that threshold, 0 = drops none, 0..10. Needs weights L4D_WEIGHT_OPACITY of
   * L4D_SENSITIVITY_GAUSS_NEWTON. */
  L4D_ENC_PRUNE_COST = 25,
  /* Per component: Lagrangian weight of the rate of codebook indices, relative to the slope of the
   * codebook's own rate-distortion curve; 0 = always the nearest codeword. 0..10 */
  L4D_ENC_RATE_LAMBDA = 26,
  L4D_ENC_POSITION_OFFSET = 27, /* dB added to the quality of fixed-point positions */
  /* What the stream declares (spec chapter "Profiles and levels"): -1 = the narrowest profile and
   * the smallest level that it meets, 0 = none. Encoding fails with INVALID_ARGUMENT if other
   * parameters contradict the profile, and with LIMIT_EXCEEDED if the finished stream exceeds the
   * level; it then writes nothing, and the message says which limit and by how much. */
  L4D_ENC_PROFILE = 28, /* L4D_PROFILE_*, or -1 */
  L4D_ENC_LEVEL = 29,   /* 1..6, 0 or -1 */
  /* 0 | 1. 1: the quality also chooses codebook sizes (at most CODEBOOK_SIZE), the number of stages
   * of each Gaussian, and escapes. Setting stages or an escape threshold sets this to 0. */
  L4D_ENC_CODEBOOKS_BY_COST = 30,
  L4D_ENC_REFINE = 31, /* rounds of joint refinement of residual stages, 0..20 */
  /* 0 | 1, where SH is a transform. 1: codes base colours apart from SH detail (L4D_TOOL_SH_BASE),
   * so that players can skip the latter. */
  L4D_ENC_SH_BASE = 32,
  /* The next four bound the error of every single Gaussian, whatever its weight; 0 = no bound. A
   * Gaussian that exceeds a bound is coded more finely, or as an escape; the others are not
   * affected. A Gaussian's size is its largest standard deviation, or, if that is more, 1/4000 of
   * the scene's extent: 1.25 times the largest side of the box that holds nine tenths of the
   * Gaussians on each axis. The rounding of binary16 positions adds to errors of position: then
   * the stream states no bound on them.
   *
   * Distance between decoded and given position, in sizes, while the opacity is at least half of
   * its maximum. 0..1e6 */
  L4D_ENC_MAX_POSITION_ERROR = 33,
  /* Ratio between a principal variance and the given one, whichever is larger over the other; and 1
   * plus the change of the variance in any direction over the largest variance. 0 or above 1 */
  L4D_ENC_MAX_COVARIANCE_FACTOR = 34,
  L4D_ENC_MAX_OPACITY_ERROR = 35, /* difference of opacities at any instant, 0..1 */
  /* Distance in scene units at any instant at which the Gaussian is visible. 0..1e6 */
  L4D_ENC_MAX_VISIBLE_ERROR = 36,
  /* What the weights were measured from, L4D_WEIGHT_VIEWS_*. It decides what is dropped, unless
   * L4D_ENC_PRUNE_WEIGHT and L4D_ENC_PRUNE_COST are set after the preset. A lossless stream keeps
   * all Gaussians whatever the views. */
  L4D_ENC_WEIGHT_VIEWS = 37,
  /* The next two bound the errors of the colours of every single Gaussian, as the four above bound
   * others; 0 = no bound. Both are in colour units 0..1, or in parts of the largest colour of the
   * original if that is above 1: of the absolute value of a channel at degree 0, with its offset of
   * 0.5, and of the sum below over the original's own coefficients. If L4D_ENC_QUALITY is set below
   * the preset's quality, a bound that was not set is that of the preset times
   * 10^((preset's quality - quality) / 20).
   *
   * Base colour: the largest difference of a channel at degree 0. 0..1e6 */
  L4D_ENC_MAX_BASE_COLOR_ERROR = 38,
  /* Directional colour: what degrees 1 to 3 add to the error, at most, in any view direction. It is
   * the sum over degrees l of sqrt((2l + 1) / (4 pi)) times the Euclidean norm of the difference of
   * the coefficients of degree l, of the channel in which this is largest. 0..1e6 */
  L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR = 39,
  L4D_ENC_PARAMETER_COUNT = 40
};
/* Values of L4D_ENC_WEIGHT_VIEWS. */
enum {
  /* Pruning is as the preset has it. */
  L4D_WEIGHT_VIEWS_UNKNOWN = 0,
  /* Every view that the scene is made for. A Gaussian whose alpha_t weight is 0 shows to nobody and
   * is dropped; one that costs more than it shows is dropped as the preset has it. */
  L4D_WEIGHT_VIEWS_ALL = 1,
  /* Some of these views, or made-up ones. A Gaussian may show in others: none is dropped. */
  L4D_WEIGHT_VIEWS_SOME = 2
};
L4D_API l4d_status l4d_encoder_set(l4d_encoder* encoder, l4d_encoder_parameter id,
                                   int32_t component, double value);
L4D_API l4d_status l4d_encoder_get(const l4d_encoder* encoder, l4d_encoder_parameter id,
                                   int32_t component, double* value);
typedef struct l4d_parameter_info {
  size_t struct_size;
  const char* name;        /* "codebook-size"; static */
  const char* description; /* static */
  double min, max;
  uint32_t per_component;
  uint32_t integer;
} l4d_parameter_info;
L4D_API void l4d_parameter_info_init_(l4d_parameter_info* info, size_t struct_size);
#define l4d_parameter_info_init(info) l4d_parameter_info_init_((info), sizeof(*(info)))
L4D_API l4d_status l4d_encoder_parameter_info(l4d_encoder_parameter id, l4d_parameter_info* info);

/* Cuts the Gaussians of temporal level 0, the long-lived ones, into num_shares + 1 tiers by
 * importance: by alpha_t weights, else by those of opacities, else as the encoder estimates it. The
 * first k tiers hold the share shares[k - 1] of them, about; small parts join the tier before. A
 * player shows a coarse picture with the first tier (l4d_query.max_tier). shares: [num_shares],
 * less than L4D_MAX_TIERS values between 0 and 1, ascending; 0 of them, as at first: one tier. A
 * preset sets that too. Fails with INVALID_ARGUMENT on any other list. */
#define L4D_MAX_TIERS 8
L4D_API l4d_status l4d_encoder_set_tiers(l4d_encoder* encoder, uint32_t num_shares,
                                         const float* shares);

/* Sets residual stages. Stage s of a component is coded for the share fractions[s] of the
 * Gaussians: those with the largest weight times squared residual. fractions:
 * [num_stages], 1..L4D_MAX_STAGES values in [0, 1], not increasing, the first 1. Fails with
 * INVALID_ARGUMENT otherwise. */
L4D_API l4d_status l4d_encoder_set_stages(l4d_encoder* encoder, int32_t component,
                                          uint32_t num_stages, const float* fractions);

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

/* Sets importance weights: larger = more visible; finite and >= 0. which: L4D_WEIGHT_*. weights:
 * [count], borrowed as the scene is; NULL removes them. A component without weights of its own uses
 * ALPHA_T, and without that an estimate from opacity, projected area and lifetime. ALPHA_T also
 * decides what PRUNE_WEIGHT drops. */
L4D_API l4d_status l4d_encoder_set_weights(l4d_encoder* encoder, uint32_t which,
                                           const float* weights, uint64_t count);

/* States in the stream how it asks to be drawn and shown. NULL, or what l4d_rendering_init and
 * l4d_presentation_init set = the stream states nothing. Fails with INVALID_ARGUMENT if a number is
 * out of its range. Coded attributes do not depend on either. */
L4D_API l4d_status l4d_encoder_set_rendering(l4d_encoder* encoder, const l4d_rendering* rendering);
L4D_API l4d_status l4d_encoder_set_presentation(l4d_encoder* encoder,
                                                const l4d_presentation* presentation);

/* Sizes below which errors of single Gaussians do not count (L4D_ENC_MAX_POSITION_ERROR), each
 * Gaussian's own: half a pixel at its distance from the nearest camera, say. The minimum size of
 * the scene counts where that is larger. sizes: [count], scene units, finite and >= 0, borrowed as
 * the scene is, NULL removes. */
L4D_API l4d_status l4d_encoder_set_min_sizes(l4d_encoder* encoder, const float* sizes,
                                             uint64_t count);

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
typedef struct l4d_encode_report {
  size_t struct_size;
  uint64_t input_gaussians;
  uint64_t coded_gaussians;
  uint64_t invalid_dropped;
  uint64_t pruned;
  uint64_t moved_to_coarser; /* moved to a coarser layer after quantisation */
  uint64_t raw_bytes;        /* 4 (17 + 3 (D+1)^2) per input Gaussian */
  uint64_t file_bytes;
  uint32_t num_steps; /* timed steps, see l4d_encoder_get_step */
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
} l4d_encode_report;
L4D_API void l4d_encode_report_init_(l4d_encode_report* report, size_t struct_size);
#define l4d_encode_report_init(report) l4d_encode_report_init_((report), sizeof(*(report)))
L4D_API l4d_status l4d_encoder_get_report(const l4d_encoder* encoder, l4d_encode_report* report);
/* Returns where each decoded Gaussian comes from: order[i] is the index in the input scene of the
 * i-th Gaussian that decodes. order: [capacity]. Fails with BUFFER_TOO_SMALL if capacity is below
 * l4d_encode_report.coded_gaussians. */
L4D_API l4d_status l4d_encoder_get_order(const l4d_encoder* encoder, uint32_t* order,
                                         uint64_t capacity);
/* Returns the name (static) and the wall seconds of step `index`, below
 * l4d_encode_report.num_steps. */
L4D_API l4d_status l4d_encoder_get_step(const l4d_encoder* encoder, uint32_t index,
                                        const char** name, double* seconds);

#ifdef __cplusplus
}
#endif
#endif /* L4D_ENCODE_H */
