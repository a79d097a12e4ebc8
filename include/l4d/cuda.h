/* SPDX-License-Identifier: Apache-2.0
 * cuda.h: what libl4dcodec does on CUDA devices. Every build has these functions; in one without
 * device code they fail with FEATURE_UNSUPPORTED, and l4d_cuda_get_device_count counts 0.
 *
 * Streams are cudaStream_t, device arrays plain device pointers, both told as void* so that this
 * header needs none of CUDA's.
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

/* Devices that the driver shows; *count is 0 where there is no driver or this build has no device
 * code. */
L4D_API l4d_status l4d_cuda_get_device_count(uint32_t* count);
/* Fails with INVALID_ARGUMENT where there is no such device. */
L4D_API l4d_status l4d_cuda_get_device_info(uint32_t device, l4d_cuda_device_info* info);

/* ---- decoding -------------------------------------------------------------------------------- */
/* Decodes what a query selects into arrays on the device, with the same bits as l4d_decoder_decode.
 * The host plans, reads and checks pages; rANS and reconstruction run on the device. Pages of
 * streams that are not coded by rANS (the presets paper and lossless) are decoded by the host and
 * uploaded: the calls are the same, and slower.
 *
 *   l4d_cuda_decoder_create(decoder, 0, &cuda);
 *   l4d_cuda_job job; l4d_cuda_job_init(&job);
 *   l4d_cuda_decoder_prepare(cuda, &query, &job);          // host: reads, checks, learns sizes
 *   ... device arrays of job.num_gaussians, a workspace of job.workspace_bytes ...
 *   l4d_cuda_decoder_decode(cuda, &buffers, workspace, job.workspace_bytes, stream);
 *   l4d_cuda_decoder_finish(cuda);                         // waits, tells what is damaged
 *
 * One job at a time; to prepare the next one while the device works, use two. */
typedef struct l4d_cuda_decoder l4d_cuda_decoder;

/* Attributes of a job. */
enum {
  L4D_CUDA_POSITION = 1u << 0,
  L4D_CUDA_MEAN_T = 1u << 1, /* mean_t and mean_t_local */
  L4D_CUDA_LOG_SCALE = 1u << 2,
  L4D_CUDA_ROTOR = 1u << 3,
  L4D_CUDA_OPACITY = 1u << 4,
  L4D_CUDA_SH = 1u << 5, /* without it, SH detail is neither read nor uploaded */
  L4D_CUDA_ALL_ATTRIBUTES = (1u << 6) - 1
};

/* What a job may be decoded to. */
enum {
  L4D_CUDA_FORM_EXPANDED = 1u << 0, /* by decode */
  L4D_CUDA_FORM_PACKED = 1u << 1    /* by decode_packed; alone, codebooks stay unread */
};

typedef struct l4d_cuda_job {
  size_t struct_size;
  uint32_t attributes;    /* in: those that decode may ask for; all unless set */
  uint32_t forms;         /* in: L4D_CUDA_FORM_*; EXPANDED unless set */
  uint64_t num_gaussians; /* out, as in l4d_selection */
  uint64_t num_ranges;
  uint64_t num_chunks;
  uint64_t upload_bytes;    /* from the host to the device in each decode */
  uint64_t workspace_bytes; /* of device memory; may be 0 where the host decodes all */
} l4d_cuda_job;
L4D_API void l4d_cuda_job_init_(l4d_cuda_job* job, size_t struct_size);
#define l4d_cuda_job_init(job) l4d_cuda_job_init_((job), sizeof(*(job)))

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
} l4d_cuda_gaussian_buffers;
L4D_API void l4d_cuda_gaussian_buffers_init_(l4d_cuda_gaussian_buffers* buffers,
                                             size_t struct_size);
#define l4d_cuda_gaussian_buffers_init(buffers) \
  l4d_cuda_gaussian_buffers_init_((buffers), sizeof(*(buffers)))

/* Likewise, as l4d_packed_buffers. The attribute of depths, indices and literals is that of their
 * component, and of scale_factor L4D_CUDA_LOG_SCALE. */
typedef struct l4d_cuda_packed_component {
  uint8_t* depth;            /* [N] */
  uint16_t* index;           /* [num_stages][N], stage s of Gaussian i at s * capacity + i */
  uint16_t* literal;         /* [literal_capacity, dim], in order of their Gaussians */
  uint64_t literal_capacity; /* the number of Gaussians is always enough */
} l4d_cuda_packed_component; /* frozen */
typedef struct l4d_cuda_packed_buffers {
  size_t struct_size;
  uint64_t capacity;      /* Gaussians each array can hold */
  uint16_t* position;     /* [N, 3] */
  uint16_t* mean_t;       /* [N] */
  uint16_t* opacity;      /* [N] */
  uint16_t* scale_factor; /* [N] */
  l4d_cuda_packed_component component[L4D_COMPONENT_COUNT];
} l4d_cuda_packed_buffers;
L4D_API void l4d_cuda_packed_buffers_init_(l4d_cuda_packed_buffers* buffers, size_t struct_size);
#define l4d_cuda_packed_buffers_init(buffers) \
  l4d_cuda_packed_buffers_init_((buffers), sizeof(*(buffers)))

/* Borrows `decoder`, whose stream must be open: it must outlive this object, keep that stream open,
 * and serve no other call while one of this object runs. Its limits hold; damage is refused,
 * whether it is tolerant or not. Fails with DEVICE where the device cannot be used. */
L4D_API l4d_status l4d_cuda_decoder_create(l4d_decoder* decoder, uint32_t device,
                                           l4d_cuda_decoder** out);
/* Waits for the job at hand. NULL is allowed. */
L4D_API void l4d_cuda_decoder_destroy(l4d_cuda_decoder* decoder);
/* Of the last failure of a call on this handle; "" after success. Valid until the next call. */
L4D_API const char* l4d_cuda_decoder_error_detail(const l4d_cuda_decoder* decoder);

/* Reads the pages that the query selects into pinned memory and checks all that the host can see of
 * them. Tables and codebooks go to the device where a page first needs them. Waits for the job
 * before. Fails as l4d_decoder_decode does, and with FEATURE_UNSUPPORTED where the packed form is
 * asked for and the stream has none, as l4d_decoder_decode_packed does. */
L4D_API l4d_status l4d_cuda_decoder_prepare(l4d_cuda_decoder* decoder, const l4d_query* query,
                                            l4d_cuda_job* job);
/* The ranges of what is prepared, in the order of the decoded arrays. *count is their number; the
 * first min(capacity, *count) go to `out`, which may be NULL where capacity is 0. */
L4D_API l4d_status l4d_cuda_decoder_get_ranges(const l4d_cuda_decoder* decoder, l4d_range* out,
                                               uint64_t capacity, uint64_t* count);

/* These put work on `stream` (a cudaStream_t; NULL = the default stream) and neither allocate nor
 * wait. workspace: device memory at a multiple of 256 bytes that nothing else uses until the work
 * is done. decode may be called again and again for what is prepared; it uploads the compressed
 * pages each time, unless upload() has just done so for the same workspace. It is the caller who
 * orders streams, where those of the two differ. */
L4D_API l4d_status l4d_cuda_decoder_upload(l4d_cuda_decoder* decoder, void* workspace,
                                           uint64_t workspace_size, void* stream);
L4D_API l4d_status l4d_cuda_decoder_decode(l4d_cuda_decoder* decoder,
                                           const l4d_cuda_gaussian_buffers* out, void* workspace,
                                           uint64_t workspace_size, void* stream);
/* With the bits of l4d_decoder_decode_packed. Where literals are wanted and there are more of a
 * component than it has room for, the first ones are written and finish() fails with
 * INVALID_ARGUMENT. */
L4D_API l4d_status l4d_cuda_decoder_decode_packed(l4d_cuda_decoder* decoder,
                                                  const l4d_cuda_packed_buffers* out,
                                                  void* workspace, uint64_t workspace_size,
                                                  void* stream);
/* Waits for the last decode and tells what became of it: CORRUPT, with clause and offset of the
 * first page that is damaged, where l4d_decoder_decode would. Rows of damaged pages, and those
 * only, then hold what they held before. */
L4D_API l4d_status l4d_cuda_decoder_finish(l4d_cuda_decoder* decoder);
/* Number of literals of one component that the last decode_packed produced, even if
 * literal_capacity was below it; 0 for a component of which no array was given. Fails with
 * INVALID_STATE before finish(), with INVALID_ARGUMENT if component is no L4D_COMPONENT_*. */
L4D_API l4d_status l4d_cuda_decoder_get_num_literals(l4d_cuda_decoder* decoder, uint32_t component,
                                                     uint64_t* count);
/* As l4d_decoder_get_codebook, with `entries` on the device: valid as long as `decoder`, those of
 * blocks until the next prepare(). Waits for the device where a codebook is not there yet. */
L4D_API l4d_status l4d_cuda_decoder_get_codebook(l4d_cuda_decoder* decoder, uint32_t layer,
                                                 uint32_t component, uint32_t stage, uint32_t block,
                                                 l4d_codebook* out);

#ifdef __cplusplus
}
#endif
#endif /* L4D_CUDA_H */
