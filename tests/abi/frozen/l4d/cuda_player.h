/* SPDX-License-Identifier: Apache-2.0
 * cuda_player.h: playing an open stream on a CUDA device: only the time buckets that the instants
 * at hand need lie in its memory, decoded there from the stored bytes. What the next instants need
 * is read and decoded by a thread of the player, beside the frames.
 *
 *   l4d_cuda_player* p;
 *   l4d_cuda_player_create(decoder, NULL, &p);            // a decoder with an open stream
 *   l4d_cuda_player_reserve(p, 1352, 1014, 1 << 21);      // once
 *   l4d_cuda_player_render(p, 2.5, &camera, &image, stream);
 *   l4d_cuda_player_get_figures(p, stream, &figures);     // waits: was there room for all?
 *
 * The timeline is cut into windows. A frame needs the buckets of its window; those of the next one
 * in the direction of play are fetched meanwhile, and behind the last window comes the first one. A
 * frame in a window that nobody saw coming (a seek) waits until its buckets are there. An image
 * depends on the stream, the time and the camera alone, not on what was played before.
 *
 * Conventions are those of cuda_render.h. Every build has these functions; in one without device
 * code l4d_cuda_player_create fails with FEATURE_UNSUPPORTED. */
#ifndef L4D_CUDA_PLAYER_H
#define L4D_CUDA_PLAYER_H

#include "l4d/cuda_render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_cuda_player l4d_cuda_player;

typedef struct l4d_cuda_player_options {
  size_t struct_size;
  uint32_t device;    /* CUDA's number of it */
  uint32_t sh_format; /* L4D_CUDA_SH_*; FLOAT16 is the default */
  uint32_t detail;    /* L4D_DETAIL_*; FULL is the default */
  uint32_t max_level; /* finest temporal level shown; UINT32_MAX (the default) = all */
  /* Budget of the store of Gaussians. 0: as little as two windows take. Else buckets stay as long
   * as there is room, so that what is played again is not decoded again, and the store has this
   * size from the beginning. What frames use beside it: l4d_cuda_room. */
  uint64_t memory_bytes;
  double window;       /* seconds; 0: 1/8 s, or the width of the finest buckets, at most 1 s */
  uint32_t read_ahead; /* 1 (the default): the next window is fetched beside the frames */
  uint32_t reserved;
} l4d_cuda_player_options;
L4D_API void l4d_cuda_player_options_init_(l4d_cuda_player_options* options, size_t struct_size);
#define l4d_cuda_player_options_init(options) \
  l4d_cuda_player_options_init_((options), sizeof(*(options)))

/* Borrows `decoder` as l4d_cuda_decoder_create does: nobody else may use it until the player is
 * destroyed. The stream's reader is also called on the player's thread, which runs from this call
 * to l4d_cuda_player_destroy: the reader has to allow that, and so does what it refers to. Calls of
 * the reader never overlap. options may be NULL. The detail of a failure is that of
 * l4d_last_error_message. */
L4D_API l4d_status l4d_cuda_player_create(l4d_decoder* decoder,
                                          const l4d_cuda_player_options* options,
                                          l4d_cuda_player** out);
L4D_API void l4d_cuda_player_destroy(l4d_cuda_player* player); /* accepts NULL; waits */
/* As l4d_decoder_error_detail. */
L4D_API const char* l4d_cuda_player_error_detail(const l4d_cuda_player* player);
L4D_API l4d_status l4d_cuda_player_set_background(l4d_cuda_player* player,
                                                  const float* rgb /* [3], host */);

/* Memory for images of width x height pixels with at most `instances` pairs of Gaussian and tile.
 * Only grows; waits. Room for visible Gaussians follows the stream by itself. */
L4D_API l4d_status l4d_cuda_player_reserve(l4d_cuda_player* player, uint32_t width, uint32_t height,
                                           uint64_t instances);

/* Waits until the buckets of `time` (seconds, clamped to the sequence) are on the device, for
 * instance where a seek is about to come, or before the first frame. Damage and failures of the
 * reader are those of l4d_cuda_decoder_prepare and l4d_cuda_decoder_finish; LIMIT_EXCEEDED:
 * memory_bytes is too small. */
L4D_API l4d_status l4d_cuda_player_seek(l4d_cuda_player* player, double time);
/* As l4d_cuda_renderer_render: puts the frame on `stream` (a cudaStream_t) and returns; where the
 * buckets of `time` are not there yet it waits for them first, and fails as seek does. The thread's
 * work runs at the lowest priority: a stream of a higher one keeps frames even. */
L4D_API l4d_status l4d_cuda_player_render(l4d_cuda_player* player, double time,
                                          const l4d_camera* camera, const l4d_cuda_image* image,
                                          void* stream);
/* Of the last frame, as l4d_cuda_renderer_get_figures. */
L4D_API l4d_status l4d_cuda_player_get_figures(l4d_cuda_player* player, void* stream,
                                               l4d_cuda_figures* figures);

typedef struct l4d_cuda_player_counters {
  size_t struct_size;
  uint64_t windows;     /* that frames came to */
  uint64_t stalls;      /* of these, those that had to be waited for */
  double stall_seconds; /* in all */
  uint64_t buckets_decoded;
  uint64_t buckets_found; /* wanted by a window and there already */
  uint64_t gaussians_decoded;
  uint64_t bytes_uploaded;
  uint64_t resident_gaussians; /* in the store now */
  uint64_t store_bytes;        /* of the store, used or not */
  uint64_t scratch_bytes;      /* of device memory that decoding works in */
} l4d_cuda_player_counters;
L4D_API void l4d_cuda_player_counters_init_(l4d_cuda_player_counters* counters, size_t struct_size);
#define l4d_cuda_player_counters_init(counters) \
  l4d_cuda_player_counters_init_((counters), sizeof(*(counters)))
L4D_API l4d_status l4d_cuda_player_get_counters(const l4d_cuda_player* player,
                                                l4d_cuda_player_counters* counters);

#ifdef __cplusplus
}
#endif
#endif /* L4D_CUDA_PLAYER_H */
