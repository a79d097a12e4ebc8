/* SPDX-License-Identifier: Apache-2.0
 * experimental/inspect.h: what a stream consists of, how exact it is, and what it demands of a
 * player. Experimental: it may change with each version of the library.
 */
#ifndef L4D_EXPERIMENTAL_INSPECT_H
#define L4D_EXPERIMENTAL_INSPECT_H

#include "l4d/decode.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The encoder's statement on single Gaussians (spec section "ErrorStatement"): the largest errors
 * over all decoded Gaussians of the stream, and the bounds that were set. The decoder does not
 * check it.
 */
typedef struct l4d_coding_errors {
  size_t struct_size;
  uint32_t stated; /* 0: the stream states no errors; all that follows is 0 */
  /* 1: the caller of the encoder gave each Gaussian a minimum size of its own, such as half a pixel
   * at the nearest camera; smaller sizes count as that. */
  uint32_t own_min_sizes;
  /* Distance while the Gaussian has half of its greatest opacity or more, over its size. */
  double position;
  /* Ratio between a principal variance and the given one, whichever is larger over the other; and 1
   * plus the change of the variance in any direction over the largest variance. 1 = no error */
  double covariance;
  double opacity; /* at any instant */
  double visible; /* scene units: distance at any instant at which the Gaussian is visible */
  double mean_t;  /* in standard deviations over time of the Gaussian */
  /* 0 = there was none. */
  double position_bound;
  double covariance_bound;
  double opacity_bound;
  double visible_bound;
  double min_size; /* scene units: the size of a Gaussian that is smaller counts as this */
  /* Colours, as L4D_ENC_MAX_BASE_COLOR_ERROR and L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR measure them.
   * 0: the stream states nothing of colours, and the next four are 0. */
  uint32_t colors_stated;
  uint32_t reserved;
  double base_color;
  double directional_color;
  double base_color_bound;
  double directional_color_bound;
} l4d_coding_errors;
L4D_API l4d_status l4d_decoder_get_coding_errors(const l4d_decoder* decoder,
                                                 l4d_coding_errors* errors);

/* Parts of a file. Their stored bytes add up to the size of the file. */
enum {
  L4D_SECTION_HEADER = 0, /* file header, scene header, extensions */
  L4D_SECTION_DIRECTORY,  /* page tables, directory pages */
  L4D_SECTION_CODEBOOKS,
  L4D_SECTION_RCQ_TABLES,
  L4D_SECTION_PAGE_OVERHEAD,
  L4D_SECTION_POSITION,
  L4D_SECTION_MEAN_T, /* or flat windows */
  L4D_SECTION_OPACITY,
  L4D_SECTION_SCALE_FACTOR,
  L4D_SECTION_SH,
  L4D_SECTION_SCALE,
  L4D_SECTION_ROTOR_SPATIAL,
  L4D_SECTION_ROTOR_TEMPORAL,
  L4D_SECTION_ENTROPY_TABLES, /* of rANS pages */
  L4D_SECTION_COUNT
};
L4D_API const char* l4d_section_name(uint32_t section); /* "codebooks"; static; NULL if unknown */
/* Counts stored bytes. Reads every directory page and the head of every page.
 * sections: [capacity], indexed by L4D_SECTION_*. *count, unless NULL, receives the number of
 * sections that this library knows; the first min(capacity, *count) elements are written.
 * layer_bytes: [layer_capacity], bytes of each layer's directory, codebooks, tables and pages; the
 * first min(layer_capacity, num_layers) elements are written. May be NULL if layer_capacity is 0.
 */
L4D_API l4d_status l4d_decoder_get_sections(l4d_decoder* decoder, uint64_t* sections,
                                            uint32_t capacity, uint32_t* count,
                                            uint64_t* layer_bytes, uint32_t layer_capacity);

/* ---- profiles and levels --------------------------------------------------------------------- */

L4D_API const char* l4d_profile_name(uint32_t profile); /* "main"; static; NULL if unknown */

/* Upper limits of a level. Byte counts are stored (compressed) bytes, except table_bytes and
 * memory_bytes. */
typedef struct l4d_level_limits {
  size_t struct_size;
  const char* name; /* "phone"; static */
  uint64_t instant_gaussians;
  uint64_t table_bytes;
  uint64_t instant_bytes;
  uint64_t start_bytes;
  uint64_t bytes_per_second;
  uint64_t burst_bytes;
  uint64_t memory_bytes;
  uint64_t instant_symbols;    /* of rANS */
  uint64_t symbols_per_second; /* with instant_symbols at once */
} l4d_level_limits;
/* level: 1..L4D_NUM_LEVELS. profile: L4D_PROFILE_LOSSLESS allows more stored bytes. */
#define L4D_NUM_LEVELS 6
L4D_API l4d_status l4d_get_level_limits(uint32_t level, uint32_t profile, l4d_level_limits* limits);

/* What playing the stream forward at normal speed demands of a player. */
typedef struct l4d_stream_demand {
  size_t struct_size;
  uint32_t profile;              /* the narrowest that the stream meets, L4D_PROFILE_* */
  uint32_t level;                /* the smallest that the stream meets; 0 = none */
  uint64_t instant_gaussians;    /* of the pages that an instant needs, the most of all instants */
  double instant_gaussians_time; /* seconds: the first such instant */
  uint64_t instant_bytes;        /* stored, of these pages and their block codebooks */
  double instant_bytes_time;
  uint64_t memory_bytes; /* tables, and pages and block codebooks of an instant, expanded */
  double memory_time;
  uint64_t table_bytes; /* codebooks and entropy tables, decoded */
  /* Stored, of all that the first instant needs, headers and codebooks included. */
  uint64_t start_bytes;
  /* In: a link, set by the caller. */
  uint64_t bytes_per_second;
  uint64_t burst_bytes;
  /* Out: bytes that a player must buffer before it starts, at bytes_per_second (leaky bucket), and
   * the window of time that determines them, in seconds. */
  uint64_t min_burst_bytes;
  double window_begin, window_end;
  /* Out: lowest rate at which a player that buffers burst_bytes never stalls; UINT64_MAX if a
   * single instant needs more than burst_bytes. */
  uint64_t min_bytes_per_second;
  /* Entropy decoding: symbols of rANS, by the bound that layers declare for each Gaussian. Of the
   * pages that an instant needs, the most of all instants, and the first such instant. */
  uint64_t instant_symbols;
  double instant_symbols_time;
  /* In: symbols that a player has decoded ahead, set by the caller. Out: lowest rate of decoding,
   * in symbols a second, that then keeps up; UINT64_MAX if none does. */
  uint64_t burst_symbols;
  uint64_t min_symbols_per_second;
} l4d_stream_demand;
/* Reads the whole directory and no page. Fails on damage, also in a tolerant decoder. */
L4D_API l4d_status l4d_decoder_get_stream_demand(l4d_decoder* decoder, l4d_stream_demand* demand);

/* Checks an open stream against a profile and a level, whatever it declares; 0 = do not check.
 * Calls `fn`, unless NULL, for each broken rule of the spec's chapter "Profiles and levels"; the
 * message says by how much and when. Fails with INVALID_ARGUMENT if the profile or the level is
 * unknown. */
L4D_API l4d_status l4d_decoder_check_conformance(l4d_decoder* decoder, uint32_t profile,
                                                 uint32_t level, l4d_violation_fn fn, void* user,
                                                 uint64_t* num_violations);

#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_INSPECT_H */
