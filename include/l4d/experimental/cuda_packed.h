/* SPDX-License-Identifier: Apache-2.0
 * experimental/cuda_packed.h: the integers of a stream on CUDA devices.
 * Experimental: it may change with each version of the library.
 */
#ifndef L4D_EXPERIMENTAL_CUDA_PACKED_H
#define L4D_EXPERIMENTAL_CUDA_PACKED_H

#include "l4d/cuda.h"
#include "l4d/experimental/packed.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Device arrays as in l4d_packed_buffers. depth, index and escape of a component belong to that
 * component's L4D_CUDA_* attribute, scale_factor to L4D_CUDA_LOG_SCALE, window to L4D_CUDA_MEAN_T.
 */
typedef struct l4d_cuda_packed_component {
  uint8_t* depth;            /* [N] */
  uint16_t* index;           /* [num_stages][N], stage s of Gaussian i at s * capacity + i */
  uint16_t* escape;          /* [escape_capacity, dim], in order of their Gaussians */
  uint64_t escape_capacity;  /* the number of Gaussians is always enough */
} l4d_cuda_packed_component; /* frozen */
typedef struct l4d_cuda_packed_buffers {
  size_t struct_size;
  uint64_t capacity;      /* Gaussians each array can hold */
  uint16_t* position;     /* [N, 3] */
  uint16_t* mean_t;       /* [N] */
  uint16_t* opacity;      /* [N] */
  uint16_t* scale_factor; /* [N] */
  l4d_cuda_packed_component component[L4D_COMPONENT_COUNT];
  uint32_t* window; /* [N, 2] */
} l4d_cuda_packed_buffers;

/* Gives the bits of l4d_decoder_decode_packed. If a component has more escapes than
 * escape_capacity, the first ones are written and finish() fails with BUFFER_TOO_SMALL. */
L4D_API l4d_status l4d_cuda_decoder_decode_packed(l4d_cuda_decoder* decoder,
                                                  const l4d_cuda_packed_buffers* out,
                                                  void* workspace, uint64_t workspace_size,
                                                  void* stream);
/* Number of escapes of one component that the last decode_packed produced, even if
 * escape_capacity was below it; 0 for a component of which no array was given. Fails with
 * INVALID_STATE before finish(), with INVALID_ARGUMENT if component is no L4D_COMPONENT_*. */
L4D_API l4d_status l4d_cuda_decoder_get_num_escapes(l4d_cuda_decoder* decoder, uint32_t component,
                                                    uint64_t* count);
/* As l4d_decoder_get_codebook, with `entries` in device memory. It is valid until `decoder` is
 * destroyed; a codebook of a block only until the next prepare(). Waits if the codebook is not yet
 * on the device. */
L4D_API l4d_status l4d_cuda_decoder_get_codebook(l4d_cuda_decoder* decoder, uint32_t layer,
                                                 uint32_t component, uint32_t stage, uint32_t block,
                                                 l4d_codebook* out);

#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_CUDA_PACKED_H */
