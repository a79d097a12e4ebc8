/* SPDX-License-Identifier: Apache-2.0
 * cuda.h: what libl4dcodec does on CUDA devices. Every build has these functions; in one without device
 * code they fail with FEATURE_UNSUPPORTED, and l4d_cuda_get_device_count counts 0.
 *
 * Streams are cudaStream_t, device arrays plain device pointers, both told as void* so that this header
 * needs none of CUDA's.
 */
#ifndef L4D_CUDA_H
#define L4D_CUDA_H

#include "l4d/decode.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- devices --------------------------------------------------------------------------------- */
typedef struct l4d_cuda_device_info {
  size_t struct_size;
  char name[256];
  uint32_t compute_major, compute_minor; /* compute capability */
  uint32_t multiprocessors;
  uint32_t usable; /* 1: this build has code for it */
  uint64_t memory_bytes;
} l4d_cuda_device_info;
L4D_API void l4d_cuda_device_info_init_(l4d_cuda_device_info* info, size_t struct_size);
#define l4d_cuda_device_info_init(info) l4d_cuda_device_info_init_((info), sizeof(*(info)))

/* Devices that the driver shows; *count is 0 where there is no driver or this build has no device code. */
L4D_API l4d_status l4d_cuda_get_device_count(uint32_t* count);
/* Fails with INVALID_ARGUMENT where there is no such device. */
L4D_API l4d_status l4d_cuda_get_device_info(uint32_t device, l4d_cuda_device_info* info);

#ifdef __cplusplus
}
#endif
#endif /* L4D_CUDA_H */
