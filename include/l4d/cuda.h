/* SPDX-License-Identifier: Apache-2.0
 * cuda.h: decoding on CUDA devices. Every build has these functions. In a build without device code
 * they fail with FEATURE_UNSUPPORTED, and l4d_cuda_get_device_count returns a count of 0.
 *
 * CUDA streams are passed as void* (a cudaStream_t), so that this header needs none of CUDA's.
 * Device arrays are typed pointers to device memory.
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

/* Returns the number of devices that the driver reports: 0 without a driver or without device code
 * in this build. */
L4D_API l4d_status l4d_cuda_get_device_count(uint32_t* count);
/* Fails with INVALID_ARGUMENT if there is no such device. */
L4D_API l4d_status l4d_cuda_get_device_info(uint32_t device, l4d_cuda_device_info* info);

/* ---- decoding -------------------------------------------------------------------------------- */
/* Decodes what a query selects into arrays on the device, with the same bits as l4d_decoder_decode.
 * The host plans, reads and checks pages; rANS and reconstruction run on the device. Pages of
 * streams that are not coded by rANS (the presets paper and lossless) are decoded by the host and
 * uploaded: the calls are the same, and slower.
 *
 *   l4d_cuda_decoder_create(decoder, 0, &cuda);
 *   l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
 *   l4d_cuda_decoder_prepare(cuda, &query, &request);      // host: reads, checks, learns sizes
 *   ... device arrays of request.num_gaussians, a workspace of request.workspace_bytes ...
 *   l4d_cuda_decoder_decode(cuda, &buffers, workspace, request.workspace_bytes, stream);
 *   l4d_cuda_decoder_finish(cuda);                         // waits, returns the status
 *
 * A decoder has one request at a time. To prepare the next request while the device works, use two.
 */
typedef struct l4d_cuda_decoder l4d_cuda_decoder;

/* Attributes of a request. */
enum {
  L4D_CUDA_POSITION = 1u << 0,
  L4D_CUDA_MEAN_T = 1u << 1, /* mean_t, mean_t_local and window */
  L4D_CUDA_LOG_SCALE = 1u << 2,
  L4D_CUDA_ROTOR = 1u << 3,
  L4D_CUDA_OPACITY = 1u << 4,
  L4D_CUDA_SH = 1u << 5, /* without it, SH detail is neither read nor uploaded */
  L4D_CUDA_ALL_ATTRIBUTES = (1u << 6) - 1
};

/* What a request may be decoded to. */
enum {
  L4D_CUDA_FORM_EXPANDED = 1u << 0, /* by decode */
  /* By decode_packed (experimental/cuda_packed.h); alone, codebooks stay unread. */
  L4D_CUDA_FORM_PACKED = 1u << 1
};

typedef struct l4d_cuda_request {
  size_t struct_size;
  uint32_t attributes;    /* in: L4D_CUDA_* attributes that decode may output; 0 = all */
  uint32_t forms;         /* in: L4D_CUDA_FORM_*; 0 = EXPANDED */
  uint64_t num_gaussians; /* out, as in l4d_selection */
  uint64_t num_spans;
  uint64_t num_pages;
  uint64_t upload_bytes;    /* from the host to the device in each decode */
  uint64_t workspace_bytes; /* device memory; may be 0 if the host decodes everything */
} l4d_cuda_request;

/* Device arrays, owned by the caller, each at a multiple of 16 bytes; shapes and units as in
 * l4d_gaussian_buffers. NULL = not wanted. */
typedef struct l4d_cuda_gaussian_buffers {
  size_t struct_size;
  uint64_t capacity;   /* Gaussians each array can hold */
  float* position;     /* [N, 3] */
  float* mean_t;       /* [N] */
  float* mean_t_local; /* [N] */
  float* log_scale;    /* [N, 4] */
  float* rotor;        /* [N, 8] */
  float* opacity;      /* [N] */
  float* sh;           /* [N, (D+1)^2, 3] */
  uint32_t* window;    /* [N, 2] */
} l4d_cuda_gaussian_buffers;

/* Creates a device decoder for the open stream of `decoder`, and borrows `decoder`: it must outlive
 * this object, keep that stream open, and serve no other call while one of this object runs. Its
 * limits apply. Damage fails the request even if `decoder` is tolerant. Fails with INVALID_STATE
 * without an open stream, DEVICE if the device cannot be used. */
L4D_API l4d_status l4d_cuda_decoder_create(l4d_decoder* decoder, uint32_t device,
                                           l4d_cuda_decoder** out);
/* Waits for the current request. Accepts NULL. */
L4D_API void l4d_cuda_decoder_destroy(l4d_cuda_decoder* decoder);

/* Waits for the previous request, then reads the pages that the query selects into pinned memory
 * and checks their structure. Uploads tables and codebooks on first use. Fails as
 * l4d_decoder_decode does, and with FEATURE_UNSUPPORTED if request->forms includes PACKED and the
 * stream has no packed form.
 */
L4D_API l4d_status l4d_cuda_decoder_prepare(l4d_cuda_decoder* decoder, const l4d_query* query,
                                            l4d_cuda_request* request);
/* upload, decode and decode_packed launch work on `stream` (a cudaStream_t; NULL = the default
 * stream) and neither allocate nor wait. workspace: device memory aligned to 256 bytes; nothing
 * else may use it until the work is done. A prepared request can be decoded many times; each decode
 * uploads the compressed pages, unless upload() has just done so for the same workspace. If upload
 * and decode use different streams, the caller orders them. */
L4D_API l4d_status l4d_cuda_decoder_upload(l4d_cuda_decoder* decoder, void* workspace,
                                           uint64_t workspace_size, void* stream);
L4D_API l4d_status l4d_cuda_decoder_decode(l4d_cuda_decoder* decoder,
                                           const l4d_cuda_gaussian_buffers* out, void* workspace,
                                           uint64_t workspace_size, void* stream);
/* Waits for the last decode and returns its status: CORRUPT, naming clause and offset of the first
 * damaged page, where l4d_decoder_decode would fail. The outputs of damaged pages are then
 * unmodified; all others are valid. */
L4D_API l4d_status l4d_cuda_decoder_finish(l4d_cuda_decoder* decoder);
#ifdef __cplusplus
}
#endif
#endif /* L4D_CUDA_H */
