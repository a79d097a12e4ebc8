/* SPDX-License-Identifier: Apache-2.0
 * cuda_player.h: playing an open stream on a CUDA device. Only the time buckets around the current
 * time are in device memory, decoded there from the stored bytes. A thread of the player reads and
 * decodes the buckets of the next frames while frames are rendered.
 *
 *   l4d_cuda_player* p;
 *   l4d_cuda_player_create(decoder, NULL, &p);            // a decoder with an open stream
 *   l4d_cuda_player_reserve(p, 1352, 1014, 1 << 21);      // once
 *   l4d_cuda_player_render(p, 2.5, &camera, &image, stream);
 *   l4d_cuda_player_get_stats(p, stream, &stats);         // waits; was the capacity enough?
 *
 * The timeline is divided into windows. A frame needs the buckets of its window; the player
 * prefetches those of the next window in the direction of playback, and the first window follows
 * the last one. After a seek, render blocks until the buckets of the new window are resident. An
 * image depends only on the stream, the time and the camera, not on what was played before.
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
  /* Memory budget for Gaussians. 0: as little as two windows need. Otherwise the store has this
   * size from the start, and buckets stay resident while it suffices, so that replaying does not
   * decode them again. Frames need the memory of l4d_cuda_frame_capacity in addition. */
  uint64_t memory_bytes;
  double window;       /* seconds; 0: 1/8 s, or the width of the finest buckets, at most 1 s */
  uint32_t read_ahead; /* 1 (the default): prefetch the next window on the player's thread */
  uint32_t max_tier;   /* highest tier shown (l4d_layer_info); UINT32_MAX (the default) = all */
} l4d_cuda_player_options;
L4D_API void l4d_cuda_player_options_init_(l4d_cuda_player_options* options, size_t struct_size);
#define l4d_cuda_player_options_init(options) \
  l4d_cuda_player_options_init_((options), sizeof(*(options)))

/* Creates a player and borrows `decoder` until the player is destroyed; nothing else may use it
 * meanwhile. The player's thread, which runs until l4d_cuda_player_destroy, also calls the stream's
 * reader: the reader must allow calls from another thread. Its calls never overlap. options may be
 * NULL. On failure l4d_last_error_message returns the reason. */
L4D_API l4d_status l4d_cuda_player_create(l4d_decoder* decoder,
                                          const l4d_cuda_player_options* options,
                                          l4d_cuda_player** out);
L4D_API void l4d_cuda_player_destroy(l4d_cuda_player* player); /* accepts NULL; waits */
/* As l4d_decoder_error_message. */
L4D_API const char* l4d_cuda_player_error_message(const l4d_cuda_player* player);

/* Reserves memory for images of width x height pixels with at most `instances` pairs of Gaussian
 * and tile. Capacities only grow. Waits. Memory for visible Gaussians grows by itself. */
L4D_API l4d_status l4d_cuda_player_reserve(l4d_cuda_player* player, uint32_t width, uint32_t height,
                                           uint64_t instances);

/* Waits until the buckets of `time` (seconds, clamped to the sequence) are resident: call it before
 * the first frame or an announced seek. Fails as l4d_cuda_decoder_prepare and
 * l4d_cuda_decoder_finish do, and with LIMIT_EXCEEDED if memory_bytes is too small. */
L4D_API l4d_status l4d_cuda_player_seek(l4d_cuda_player* player, double time);
/* As l4d_cuda_renderer_render: launches the frame on `stream` (a cudaStream_t) and returns. If the
 * buckets of `time` are not resident, it waits for them first, and fails as seek does. The player's
 * own work has the lowest stream priority; give `stream` a higher one for even frame times. */
L4D_API l4d_status l4d_cuda_player_render(l4d_cuda_player* player, double time,
                                          const l4d_camera* camera, const l4d_cuda_image* image,
                                          void* stream);
/* Of the last frame, as l4d_cuda_renderer_get_stats. */
L4D_API l4d_status l4d_cuda_player_get_stats(l4d_cuda_player* player, void* stream,
                                             l4d_cuda_frame_stats* stats);

typedef struct l4d_cuda_player_counters {
  size_t struct_size;
  uint64_t windows;     /* windows that frames entered */
  uint64_t stalls;      /* of these, windows that a frame waited for */
  double stall_seconds; /* sum of these waits */
  uint64_t buckets_decoded;
  uint64_t buckets_found; /* needed by a window and resident already */
  uint64_t gaussians_decoded;
  uint64_t bytes_uploaded;
  uint64_t resident_gaussians; /* in the store now */
  uint64_t store_bytes;        /* of the store, used or not */
  uint64_t scratch_bytes;      /* device memory that decoding works in */
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
