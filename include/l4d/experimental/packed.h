/* SPDX-License-Identifier: Apache-2.0
 * experimental/packed.h: the integers of a stream, for players that keep data quantised.
 * Experimental: it may change with each version of the library.
 */
#ifndef L4D_EXPERIMENTAL_PACKED_H
#define L4D_EXPERIMENTAL_PACKED_H

#include "l4d/decode.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Packed form, for players that keep data quantised: the integers of the stream, entropy-decoded
 * and not dequantised. l4d_decoder_get_codebook returns the codebooks. */
typedef struct l4d_packed_component {
  uint8_t* depth;   /* [N] number of stages to add up, 255 = escape; may be NULL */
  uint16_t* index;  /* [num_stages][N], stage s of Gaussian i at s * capacity + i; entries of
                       unused or absent stages are 0 */
  uint16_t* escape; /* [escape_capacity, dim] binary16 bits, in order of their Gaussians */
  uint64_t escape_capacity;
  uint64_t num_escapes; /* out: also set when escape is NULL */
} l4d_packed_component; /* frozen */
typedef struct l4d_packed_buffers {
  size_t struct_size;
  uint64_t capacity;
  uint64_t count;         /* out */
  uint16_t* position;     /* [N, 3] binary16 bits in the coded frame */
  uint16_t* mean_t;       /* [N] binary16 bits, bucket widths from the bucket centre */
  uint16_t* opacity;      /* [N] SQ code */
  uint16_t* scale_factor; /* [N] SQ code */
  l4d_packed_component component[L4D_COMPONENT_COUNT];
  l4d_bucket_span* spans;
  uint64_t span_capacity;
  uint64_t num_spans; /* out, where spans is given */
  uint32_t* window;   /* [N, 2] frames, as in l4d_gaussian_buffers; mean_t is 0 there */
} l4d_packed_buffers;
/* Decodes to the packed form. Only streams of the profile "indexed" have one; the encoder's presets
 * "indexed*" make them if L4D_ENC_PROFILE is 1. Other streams fail with FEATURE_UNSUPPORTED. A
 * tolerant decoder skips lost pages, and their escapes, as l4d_decoder_decode does. Fails with
 * BUFFER_TOO_SMALL if a capacity is too small. */
L4D_API l4d_status l4d_decoder_decode_packed(l4d_decoder* decoder, const l4d_query* query,
                                             l4d_packed_buffers* out);

/* Returns one codebook as float32. The decoder owns it. It is valid until the stream is closed; a
 * codebook of a block only until the next call that selects, decodes or slices. `block`:
 * L4D_NO_BLOCK, or, for stage 0 of a component with RCQ, a block of the layer. All layers have the
 * same SH codebooks. */
typedef struct l4d_codebook {
  size_t struct_size;
  const float* entries; /* [num_entries, dim]; NULL where the component has no such stage */
  uint32_t num_entries;
  uint32_t dim;
} l4d_codebook;
L4D_API l4d_status l4d_decoder_get_codebook(l4d_decoder* decoder, uint32_t layer,
                                            uint32_t component, uint32_t stage, uint32_t block,
                                            l4d_codebook* out);

/* How to dequantise the packed integers of a layer:
 *   position = position_center + position_scale * half
 *   opacity = opacity_offset + code * opacity_step, clamped to [0, 1] unless the stream has
 *             L4D_OPACITY_LOGIT
 *   factor = scale_factor_offset + code * scale_factor_step
 *   log_scale[k] = factor + k-th element of the scale vector, clamped to [-17, 17] */
typedef struct l4d_dequantization {
  size_t struct_size;
  float position_center[3];
  float position_scale;
  float opacity_offset, opacity_step;
  float scale_factor_offset, scale_factor_step;
  float log_scale_t; /* permanent layers: temporal log scale of every Gaussian; else 0 */
  uint32_t reserved;
} l4d_dequantization;
L4D_API l4d_status l4d_decoder_get_dequantization(l4d_decoder* decoder, uint32_t layer,
                                                  l4d_dequantization* out);

#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_PACKED_H */
