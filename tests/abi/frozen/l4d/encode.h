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
  /* L4D_BACKEND_*; never changes the output. CUDA searches codebooks on a device; AUTO does so
   * where there is one. L4D_ERR_DEVICE from l4d_encoder_create where CUDA is asked for and there is
   * none, FEATURE_UNSUPPORTED where this build has no device code. */
  uint32_t backend;
  uint64_t seed; /* equal seeds give equal files on one machine */
} l4d_encoder_options;
L4D_API void l4d_encoder_options_init_(l4d_encoder_options* options, size_t struct_size);
#define l4d_encoder_options_init(options) l4d_encoder_options_init_((options), sizeof(*(options)))

L4D_API l4d_status l4d_encoder_create(const l4d_encoder_options* options, l4d_encoder** out);
L4D_API void l4d_encoder_destroy(l4d_encoder* encoder); /* accepts NULL */
/* As l4d_decoder_error_detail. */
L4D_API const char* l4d_encoder_error_detail(const l4d_encoder* encoder);
L4D_API l4d_status l4d_encoder_set_progress(l4d_encoder* encoder, l4d_progress_fn fn, void* user);

/* ---- parameters ---------------------------------------------------------------------------- */

/* Replaces all parameters by those of a preset. l4d_encoder_preset_name(i) lists them, NULL after
 * the last: "default", "tiny", "small", "large", "archive" (transforms at a quality), "indexed",
 * "indexed-small", "indexed-high" (codebooks only), "paper-small" and "paper-large" (the paper's
 * own settings, appendix "Compression"; they need weights measured as sums), "lossless" (float32
 * bits exactly, in any order). */
L4D_API l4d_status l4d_encoder_set_preset(l4d_encoder* encoder, const char* name);
L4D_API const char* l4d_encoder_preset_name(uint32_t index);
L4D_API const char* l4d_encoder_preset_description(uint32_t index);

/* Parameters are ids with a value, so that a new one changes no layout. `component` is an
 * L4D_COMPONENT_*, or L4D_ALL_COMPONENTS; it must be the latter for parameters that have none. */
#define L4D_ALL_COMPONENTS (-1)
typedef int32_t l4d_encoder_parameter;
enum {
  L4D_ENC_LOSSLESS = 0,      /* 0 | 1: raw float32 attributes */
  L4D_ENC_CODEBOOK_SIZE = 1, /* per component: entries of each stage, 1..65536 */
  L4D_ENC_LITERAL_THRESHOLD =
      2,                /* per component: weight above which a vector stays literal; 0 = never */
  L4D_ENC_RCQ = 3,      /* 0 never, 1 where it pays, 2 wherever allowed */
  L4D_ENC_RCQ_SIZE = 4, /* entries of a residual codebook, 1..4096 */
  L4D_ENC_MERGE_FRACTION = 5, /* a finest layer with fewer than this share is merged, 0..1 */
  L4D_ENC_MERGE_COUNT = 6,    /* ... or with fewer Gaussians than this */
  L4D_ENC_PRUNE_WEIGHT = 7,   /* drop Gaussians with alpha_t weight <= this; < 0 = never */
  /* Gaussians per page, 64..65536. A device decodes the pages of an instant side by side: long ones
   * keep it waiting. Presets of rANS pages: 4096, of zstd streams: 32768 */
  L4D_ENC_PAGE_SIZE = 8,
  L4D_ENC_CLOSED_LOOP = 9,   /* 0 | 1: choose means so that decoded Gaussians are in place */
  L4D_ENC_GAUGE = 10,        /* rotors: 0 as given, 1 sign, 2 nearest identity, 3 sorted scales */
  L4D_ENC_OPACITY_BITS = 11, /* 1..16; 0: as the quality allows */
  L4D_ENC_SCALE_FACTOR_BITS = 12, /* 1..16 */
  L4D_ENC_KMEANS_ITERATIONS = 13, /* 0..1000 */
  L4D_ENC_KMEANS_SAMPLE = 14,     /* training points per codeword, 1..1000000 */
  L4D_ENC_ZSTD_LEVEL = 15,        /* 1..22 */
  L4D_ENC_DROP_INVALID = 16,      /* 0 | 1: drop Gaussians with NaN, Inf or values out of range */
  /* 1..9: setting it sets how hard k-means and zstd try (13, 14, 15), from a measured front of time
   * against quality; those may be set after it. */
  L4D_ENC_EFFORT = 17,
  /* Per component: 0 codebooks, 1 transform, 2 whichever costs less, by error and bits: of SH once,
   * of the rest in each layer. Both halves of a rotor go together. */
  L4D_ENC_CODING = 18,
  /* Of a transform, fixed positions, and what else is left to it: about the fidelity in dB that
   * renders of the coded scene have, where weights are Gauss-Newton's. 20..90 */
  L4D_ENC_QUALITY = 19,
  L4D_ENC_QUALITY_OFFSET = 20, /* per component: dB on top of the quality */
  L4D_ENC_FIXED_POSITIONS =
      21, /* 0: binary16, 1: fixed point with a step that follows the quality */
  /* 0..10: mean times are binary16 in bucket widths, less so many low bits. -1: as the quality
   * allows, binary16 where the stream is to have a packed form, else fixed point. */
  L4D_ENC_MEAN_T_SHIFT = 22,
  L4D_ENC_RANS = 23, /* 0: zstd, 1: rANS pages */
  L4D_ENC_WEIGHT_MEASURE =
      24, /* what the weights given are: 0 L4D_SENSITIVITY_SUM, 1 _GAUSS_NEWTON */
  /* Drops Gaussians without which the image changes less than other Gaussians' errors of as many
   * bits would, times this; 0 = none. Needs Gauss-Newton weights of opacity. 0..10 */
  L4D_ENC_PRUNE_COST = 25,
  /* Per component: what a bit of a codebook index is worth, in the slope at which the error of
   * codewords falls with their rate; 0 = the nearest codeword whatever it costs. 0..10 */
  L4D_ENC_RATE_PRICE = 26,
  L4D_ENC_POSITION_OFFSET = 27, /* dB on top of the quality, of fixed positions */
  /* What the stream declares (spec chapter "Profiles and levels"); -1: the narrowest profile and
   * the smallest level that it keeps to, 0: none. A profile that the other parameters break is
   * refused with INVALID_ARGUMENT, a level that the finished stream goes beyond with
   * LIMIT_EXCEEDED; nothing is written then, and the detail says what breaks it and by how much. */
  L4D_ENC_PROFILE = 28, /* L4D_PROFILE_*, or -1 */
  L4D_ENC_LEVEL = 29,   /* 1..6, 0 or -1 */
  /* 1: codebooks follow the quality as transforms do: their sizes (up to the codebook size), depths
   * and literals are what they are worth. 0 | 1; setting stages or a literal threshold sets it to 0
   */
  L4D_ENC_CODEBOOKS_BY_COST = 30,
  L4D_ENC_REFINE = 31, /* rounds in which residual stages are coded again for each other, 0..20 */
  /* Where SH is a transform: 0: freely chosen axes, 1: base colours first (L4D_TOOL_SH_BASE), so
   * that players can do without SH detail. 0 | 1 */
  L4D_ENC_SH_BASE = 32,
  /* Bounds on the error of each single Gaussian, whatever its weight; 0 = none. Those that the
   * quality leaves beyond one are coded more finely, or literally, which only they pay for. Sizes
   * below 1/4000 of the extent of the scene (of nine tenths of its Gaussians on each axis, and a
   * quarter more) count as that. With binary16 positions, the rounding of these comes on top.
   *
   * Distance between where the Gaussian is seen and where it should be, in its own largest standard
   * deviations, while it has half of its greatest opacity in the sequence or more. 0..1e6 */
  L4D_ENC_MAX_POSITION_ERROR = 33,
  /* Largest ratio of a principal variance to what it should be, one way or the other, and 1 +
   * largest change of a variance in any direction in parts of the largest: 1.5, say. 0, or above 1
   */
  L4D_ENC_MAX_COVARIANCE_FACTOR = 34,
  L4D_ENC_MAX_OPACITY_ERROR = 35, /* of the opacity seen at any instant, 0..1 */
  /* Distance in scene units at any instant at which the Gaussian is visible. */
  L4D_ENC_MAX_VISIBLE_ERROR = 36,
  /* What the weights were measured from, L4D_WEIGHT_VIEWS_*. It decides what is dropped, unless
   * L4D_ENC_PRUNE_WEIGHT and L4D_ENC_PRUNE_COST are set after the preset. A lossless stream keeps
   * all Gaussians whatever the views. */
  L4D_ENC_WEIGHT_VIEWS = 37,
  L4D_ENC_PARAMETER_COUNT = 38
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

/* Residual stages: stage s of a component is coded for the share fractions[s] of all Gaussians,
 * those with the largest weight x squared residual. fractions: [num_stages], 1..L4D_MAX_STAGES of
 * them, each in [0, 1] and none above the one before; the first is 1. */
L4D_API l4d_status l4d_encoder_set_stages(l4d_encoder* encoder, int32_t component,
                                          uint32_t num_stages, const float* fractions);

/* ---- input --------------------------------------------------------------------------------- */

/* Sets the scene. Arrays are borrowed until encode returns or another scene is set. placement may
 * be NULL (identity). A scene of no Gaussian: INVALID_SCENE. So are NaN, Inf and log scales outside
 * [-17, 17] in encode, naming Gaussian and attribute, unless DROP_INVALID drops them; log scales
 * between 16 and 17, as coding errors leave them, are coded as 16, those below -16 likewise. */
L4D_API l4d_status l4d_encoder_set_scene(l4d_encoder* encoder, const l4d_gaussians* gaussians,
                                         const l4d_timeline* timeline,
                                         const l4d_placement* placement);

/* Importance of each Gaussian, larger = more visible; finite and >= 0. which: L4D_WEIGHT_*.
 * weights: [count], borrowed as the scene is, NULL removes. ALPHA_T serves pruning, and SH where
 * that is not given. Where a component's own weights are missing ALPHA_T stands in, and without
 * that a proxy of opacity, projected area and lifetime. */
L4D_API l4d_status l4d_encoder_set_weights(l4d_encoder* encoder, uint32_t which,
                                           const float* weights, uint64_t count);

/* Sizes below which errors of single Gaussians do not count (L4D_ENC_MAX_POSITION_ERROR), each
 * Gaussian's own: half a pixel at its distance from the nearest camera, say. The least size of the
 * scene counts where that is larger. sizes: [count], scene units, finite and >= 0, borrowed as the
 * scene is, NULL removes. */
L4D_API l4d_status l4d_encoder_set_least_sizes(l4d_encoder* encoder, const float* sizes,
                                               uint64_t count);

/* A key and a value that go into the stream's metadata. Both are copied. Fails with
 * INVALID_ARGUMENT where one is not UTF-8. */
L4D_API l4d_status l4d_encoder_add_metadata(l4d_encoder* encoder, const char* key,
                                            const char* value);

/* ---- encoding ------------------------------------------------------------------------------ */
L4D_API l4d_status l4d_encoder_encode(l4d_encoder* encoder, const l4d_writer* writer);
/* Writes PATH.l4dtmp0 beside the file (or beside what a link there leads to) and renames it when it
 * is whole; failure leaves nothing. Devices, pipes and /dev/fd/N are written in place. */
L4D_API l4d_status l4d_encoder_encode_file(l4d_encoder* encoder, const char* path);

/* What the last successful encode did. */
typedef struct l4d_encode_report {
  size_t struct_size;
  uint64_t input_gaussians;
  uint64_t coded_gaussians;
  uint64_t invalid_dropped;
  uint64_t pruned;
  uint64_t moved_to_coarser; /* decoded extent left the layer chosen from the input */
  uint64_t raw_bytes;        /* 4 (17 + 3 (D+1)^2) per input Gaussian */
  uint64_t file_bytes;
  uint32_t num_stages; /* timed steps, see l4d_encoder_get_stage */
  uint32_t num_layers;
  double total_seconds;
  uint64_t literals; /* Gaussians in a layer of literals: out of reach, or else beyond a bound */
  /* Largest errors over all Gaussians, as the bounds on them measure them, whether there are any or
   * not. The stream states them: l4d_decoder_get_coding_errors. */
  double max_position_error;
  double max_covariance_factor;
  double max_opacity_error;
  double max_visible_error; /* scene units */
  double max_mean_t_error;  /* in standard deviations over time of the Gaussian */
} l4d_encode_report;
L4D_API void l4d_encode_report_init_(l4d_encode_report* report, size_t struct_size);
#define l4d_encode_report_init(report) l4d_encode_report_init_((report), sizeof(*(report)))
L4D_API l4d_status l4d_encoder_get_report(const l4d_encoder* encoder, l4d_encode_report* report);
/* order[i] = index in the scene given of the Gaussian that a decoder hands out as number i.
 * order: [capacity], capacity >= coded_gaussians. */
L4D_API l4d_status l4d_encoder_get_order(const l4d_encoder* encoder, uint32_t* order,
                                         uint64_t capacity);
/* Name (static) and wall seconds of step `index`. */
L4D_API l4d_status l4d_encoder_get_stage(const l4d_encoder* encoder, uint32_t index,
                                         const char** name, double* seconds);

#ifdef __cplusplus
}
#endif
#endif /* L4D_ENCODE_H */
