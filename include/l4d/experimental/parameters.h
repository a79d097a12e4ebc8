/* SPDX-License-Identifier: Apache-2.0
 * experimental/parameters.h: parameters of the encoder (encode.h) that choose how it codes.
 * Experimental: names, ranges and meanings may change with each version of the library.
 */
#ifndef L4D_EXPERIMENTAL_PARAMETERS_H
#define L4D_EXPERIMENTAL_PARAMETERS_H

#include "l4d/encode.h"

/* Per component: 0 codebooks, 1 transform, 2 the cheaper one by error and bits. Chosen once for
 * SH and per layer for the others; both halves of the rotor use the same coding. */
#define L4D_ENC_CODING "coding"
#define L4D_ENC_QUALITY_OFFSET "quality-offset"   /* per component: dB added to the quality */
#define L4D_ENC_POSITION_OFFSET "position-offset" /* dB added to that of fixed-point positions */
/* 0: binary16, 1: fixed point with a step that follows the quality */
#define L4D_ENC_FIXED_POSITIONS "fixed-positions"
/* 0..10: codes mean times as binary16 in units of the bucket width, and drops this number of low
 * bits. -1: chosen by the quality: binary16 if the stream has a packed form, else fixed point. */
#define L4D_ENC_MEAN_T_SHIFT "mean-t-shift"
#define L4D_ENC_OPACITY_BITS "opacity-bits"           /* 1..16; 0: as the quality allows */
#define L4D_ENC_SCALE_FACTOR_BITS "scale-factor-bits" /* 1..16 */
#define L4D_ENC_RANS "rans"                           /* 0: zstd, 1: rANS pages */
#define L4D_ENC_ZSTD_LEVEL "zstd-level"               /* 1..22 */
#define L4D_ENC_CLOSED_LOOP "closed-loop" /* 0 | 1: fit positions to the decoded shape */
/* Rotors: 0 as given, 1 sign, 2 nearest identity, 3 sorted scales. */
#define L4D_ENC_GAUGE "gauge"
/* A finest layer with fewer than this share of the Gaussians is merged, 0..1, ... */
#define L4D_ENC_MERGE_FRACTION "merge-fraction"
#define L4D_ENC_MERGE_COUNT "merge-count" /* ... or with fewer Gaussians than this. */

/* ---- codebooks ----------------------------------------------------------------------------- */
#define L4D_ENC_CODEBOOK_SIZE "codebook-size" /* per component: entries of each stage, 1..65536 */
/* Per component: weight above which a vector is coded as an escape; 0 = never. */
#define L4D_ENC_ESCAPE_THRESHOLD "escape-threshold"
#define L4D_ENC_RCQ "rcq"           /* 0 never, 1 where it pays, 2 wherever allowed */
#define L4D_ENC_RCQ_SIZE "rcq-size" /* entries of a residual codebook, 1..4096 */
/* 0 | 1. 1: the quality also chooses codebook sizes (at most CODEBOOK_SIZE), the number of stages
 * of each Gaussian, and escapes. Setting stages or an escape threshold sets this to 0. */
#define L4D_ENC_CODEBOOKS_BY_COST "codebooks-by-cost"
#define L4D_ENC_REFINE "refine" /* rounds of joint refinement of residual stages, 0..20 */
#define L4D_ENC_KMEANS_ITERATIONS "kmeans-iterations" /* 0..1000 */
#define L4D_ENC_KMEANS_SAMPLE "kmeans-sample"         /* training points per codeword, 1..1000000 */

/* A list, per component: stage s is coded for the share values[s] of the Gaussians, those with the
 * largest weight times squared residual. 1..L4D_MAX_STAGES values in [0, 1], not increasing, the
 * first 1. */
#define L4D_ENC_STAGES "stages"

#endif /* L4D_EXPERIMENTAL_PARAMETERS_H */
