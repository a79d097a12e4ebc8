/* SPDX-License-Identifier: Apache-2.0
 * cuda_render.h: rendering from Gaussians in device memory into images in device memory, for
 * players and trainers. Conventions of cameras, images and attributes are those of render.h and
 * l4d.h. Every build has these functions; in one without device code l4d_cuda_renderer_create fails
 * with FEATURE_UNSUPPORTED.
 *
 *   l4d_cuda_renderer* r;
 *   l4d_cuda_renderer_create(NULL, &r);
 *   l4d_cuda_renderer_set_gaussians(r, &device_arrays, &timeline);
 *   l4d_cuda_renderer_reserve(r, &room);                         // once; render() never allocates
 *   l4d_cuda_renderer_render(r, 2.5, &camera, &image, stream);   // returns at once
 *   l4d_cuda_renderer_get_figures(r, stream, &figures);          // waits: was there room for all?
 *
 * Streams are cudaStream_t told as void*, device arrays plain device pointers. Calls that take a
 * stream only launch work on it and may be captured into a CUDA graph; the others wait for the
 * device. A renderer has one set of buffers: its frames are to follow each other, on one stream or
 * ordered by events. Images repeat bit for bit, whatever the device runs beside them.
 */
#ifndef L4D_CUDA_RENDER_H
#define L4D_CUDA_RENDER_H

#include "l4d/decode.h"
#include "l4d/render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_cuda_renderer l4d_cuda_renderer;

enum {
  L4D_CUDA_SH_FLOAT32 = 0,
  L4D_CUDA_SH_FLOAT16 = 1 /* half the memory; colours change by less than 1e-3 of their size */
};
typedef struct l4d_cuda_renderer_options {
  size_t struct_size;
  uint32_t device;    /* CUDA's number of it */
  uint32_t sh_format; /* L4D_CUDA_SH_*, of the copy that is rendered from */
} l4d_cuda_renderer_options;
L4D_API void l4d_cuda_renderer_options_init_(l4d_cuda_renderer_options* options,
                                             size_t struct_size);
#define l4d_cuda_renderer_options_init(options) \
  l4d_cuda_renderer_options_init_((options), sizeof(*(options)))

/* options may be NULL. Fails with DEVICE where there is no device that this build has code for. */
L4D_API l4d_status l4d_cuda_renderer_create(const l4d_cuda_renderer_options* options,
                                            l4d_cuda_renderer** out);
L4D_API void l4d_cuda_renderer_destroy(l4d_cuda_renderer* renderer); /* accepts NULL; waits */
/* As l4d_decoder_error_detail. */
L4D_API const char* l4d_cuda_renderer_error_detail(const l4d_cuda_renderer* renderer);

/* ---- the scene ------------------------------------------------------------------------------- */

/* A whole scene. The arrays of `gaussians` are device pointers; values are taken as they are,
 * unchecked, and prepared: 76 bytes and the SH coefficients of each Gaussian stay in the renderer's
 * memory. The arrays themselves are read again by l4d_cuda_renderer_backward alone. */
L4D_API l4d_status l4d_cuda_renderer_set_gaussians(l4d_cuda_renderer* renderer,
                                                   const l4d_gaussians* gaussians,
                                                   const l4d_timeline* timeline);

/* Or a scene whose SH is told by indices of codewords, as l4d_cuda_decoder_decode_packed leaves
 * them: 2 bytes a stage and 2 or 4 beside them stay of each Gaussian, and colours are made of the
 * codewords in each frame. With L4D_CUDA_SH_FLOAT32 images are those of the expanded SH to the last
 * bit. `codebooks`: of all stages, `entries` on the device, as l4d_cuda_decoder_get_codebook tells
 * them (SH codebooks are the same for every layer); codebooks[0].struct_size bytes apart; they are
 * copied, in the renderer's sh_format. A scene that told SH by those before is lost. count = 0: no
 * codebooks any more. */
L4D_API l4d_status l4d_cuda_renderer_set_sh_codebooks(l4d_cuda_renderer* renderer,
                                                      const l4d_codebook* codebooks,
                                                      uint32_t count);
/* Device arrays of N Gaussians. An index beyond its codebook counts as the last one, a depth beyond
 * the stages as all, and a literal beyond num_literals as no SH. */
typedef struct l4d_cuda_sh_indices {
  size_t struct_size;
  const uint8_t* depth;  /* [N] stages that add up, 255 = literal; NULL: all stages, no literals */
  const uint16_t* index; /* [num_stages][N], stage s of Gaussian i at s * stride + i */
  uint64_t stride;       /* the capacity of l4d_cuda_packed_buffers */
  const uint16_t* literal; /* [num_literals, (D+1)^2, 3] binary16, in order of their Gaussians */
  uint64_t num_literals;
  /* Of l4d_cuda_renderer_store_indexed_rows: where in the room for literals. */
  uint64_t first_literal;
} l4d_cuda_sh_indices;
L4D_API void l4d_cuda_sh_indices_init_(l4d_cuda_sh_indices* indices, size_t struct_size);
#define l4d_cuda_sh_indices_init(indices) l4d_cuda_sh_indices_init_((indices), sizeof(*(indices)))
/* As l4d_cuda_renderer_set_gaussians; gaussians->sh is NULL. Fails with INVALID_STATE without
 * codebooks. l4d_cuda_renderer_backward does not work of such a scene (INVALID_STATE). */
L4D_API l4d_status l4d_cuda_renderer_set_indexed_gaussians(l4d_cuda_renderer* renderer,
                                                           const l4d_gaussians* gaussians,
                                                           const l4d_cuda_sh_indices* indices,
                                                           const l4d_timeline* timeline);

/* Or a scene that comes and goes in parts: a store of rows, filled part by part, and slabs of rows
 * that frames show. Filling rows that no slab of the frames under way shows is safe beside them. */
L4D_API l4d_status l4d_cuda_renderer_reserve_rows(l4d_cuda_renderer* renderer, uint64_t rows,
                                                  uint32_t sh_degree, const l4d_timeline* timeline);
/* Where there are codebooks, these are rows of indices, without room for literals until there is a
 * number of them: what was in it is lost. */
L4D_API l4d_status l4d_cuda_renderer_reserve_literals(l4d_cuda_renderer* renderer,
                                                      uint64_t literals);
/* Fills rows first_row, first_row + 1, ... from device arrays, which may be given up once the
 * stream has passed. */
L4D_API l4d_status l4d_cuda_renderer_store_rows(l4d_cuda_renderer* renderer, uint64_t first_row,
                                                const l4d_gaussians* gaussians, void* stream);
/* Likewise rows of indices, with gaussians->sh NULL; their literals go to first_literal,
 * first_literal + 1,
 * ... of the room for them. Each of the two fails with INVALID_STATE on rows of the other kind. */
L4D_API l4d_status l4d_cuda_renderer_store_indexed_rows(l4d_cuda_renderer* renderer,
                                                        uint64_t first_row,
                                                        const l4d_gaussians* gaussians,
                                                        const l4d_cuda_sh_indices* indices,
                                                        void* stream);
/* What can be seen to change in a slab while the sequence lasts; what cannot is not worked out. */
enum {
  L4D_CUDA_ROWS_STILL = 0,  /* nothing */
  L4D_CUDA_ROWS_FADING = 1, /* opacity */
  L4D_CUDA_ROWS_MOVING = 2  /* position and opacity: right for any */
};
typedef struct l4d_cuda_slab {
  uint32_t first, count; /* rows */
  uint32_t motion;       /* L4D_CUDA_ROWS_* */
  uint32_t reserved;
} l4d_cuda_slab; /* frozen */
/* At most 256 slabs without a row in common; of Gaussians at equal depth the one of the earlier
 * slab, then the earlier row is in front. */
L4D_API l4d_status l4d_cuda_renderer_set_slabs(l4d_cuda_renderer* renderer,
                                               const l4d_cuda_slab* slabs, uint32_t count,
                                               void* stream);
L4D_API l4d_status l4d_cuda_renderer_set_background(l4d_cuda_renderer* renderer,
                                                    const float* rgb /* [3], host */);

/* ---- frames ---------------------------------------------------------------------------------- */

/* Memory for the largest frame that will be asked for: 76 bytes a visible Gaussian, 16 an instance,
 * and for the way back 60 and 52 more. Only grows. */
typedef struct l4d_cuda_room {
  size_t struct_size;
  uint32_t width, height; /* pixels */
  uint64_t visible;       /* Gaussians visible at one time; the number of rows is always enough */
  uint64_t instances;     /* pairs of Gaussian and tile of 16x16 pixels, below 2^26 */
  uint32_t backward;      /* 1: l4d_cuda_renderer_backward will be called */
  uint32_t reserved;
} l4d_cuda_room;
L4D_API void l4d_cuda_room_init_(l4d_cuda_room* room, size_t struct_size);
#define l4d_cuda_room_init(room) l4d_cuda_room_init_((room), sizeof(*(room)))
L4D_API l4d_status l4d_cuda_renderer_reserve(l4d_cuda_renderer* renderer,
                                             const l4d_cuda_room* room);

/* Destination on the device, owned by the caller; NULL = not wanted. */
typedef struct l4d_cuda_image {
  size_t struct_size;
  float* rgb;      /* [height, width, 3] */
  float* alpha;    /* [height, width] */
  uint32_t* rgba8; /* [height, width] bytes R, G, B, A: values times 255, rounded, clamped */
} l4d_cuda_image;
L4D_API void l4d_cuda_image_init_(l4d_cuda_image* image, size_t struct_size);
#define l4d_cuda_image_init(image) l4d_cuda_image_init_((image), sizeof(*(image)))

/* Renders at `time` seconds (clamped to the sequence). Frames of one time that follow each other
 * share the list of what is visible then. Fails with INVALID_STATE where there is no room for the
 * image's size. A frame with more Gaussians or instances than there is room for comes out without
 * the farthest of them, and get_figures says so. */
L4D_API l4d_status l4d_cuda_renderer_render(l4d_cuda_renderer* renderer, double time,
                                            const l4d_camera* camera, const l4d_cuda_image* image,
                                            void* stream);

/* Renders and goes back: adds to gradients, whose arrays are device pointers here, what
 * l4d_renderer_backward would. rgb_gradient: [height, width, 3] on the device. Needs a whole scene
 * (INVALID_STATE otherwise). Sums are made in a fixed order: gradients repeat bit for bit.
 * Of a frame that there was not room for nothing is added. */
L4D_API l4d_status l4d_cuda_renderer_backward(l4d_cuda_renderer* renderer, double time,
                                              const l4d_camera* camera, const l4d_cuda_image* image,
                                              const float* rgb_gradient,
                                              const l4d_gradients* gradients, void* stream);

typedef struct l4d_cuda_figures {
  size_t struct_size;
  uint64_t visible, projected, instances; /* as in l4d_render_stats */
  uint64_t wanted_visible;                /* had there been room for all */
  uint64_t wanted_instances;
  double seconds[L4D_RENDER_MAX_STAGES]; /* of the device, by L4D_RENDER_STAGE_*; 0 unless timed */
} l4d_cuda_figures;
L4D_API void l4d_cuda_figures_init_(l4d_cuda_figures* figures, size_t struct_size);
#define l4d_cuda_figures_init(figures) l4d_cuda_figures_init_((figures), sizeof(*(figures)))
/* Of the last frame; waits for its stream. Fails with LIMIT_EXCEEDED, figures set, where the frame
 * lacks something. */
L4D_API l4d_status l4d_cuda_renderer_get_figures(l4d_cuda_renderer* renderer, void* stream,
                                                 l4d_cuda_figures* figures);
/* From now on frames time their stages, which costs some microseconds each. */
L4D_API l4d_status l4d_cuda_renderer_time_stages(l4d_cuda_renderer* renderer);

#ifdef __cplusplus
}
#endif
#endif /* L4D_CUDA_RENDER_H */
