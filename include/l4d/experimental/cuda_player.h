/* SPDX-License-Identifier: Apache-2.0
 * experimental/cuda_player.h: playing a stream on a CUDA device, from a local file or over a link.
 * Only the time buckets around the current time are in device memory, decoded there from the stored
 * bytes. A thread of the player drives an engine of playback.h, and reads and decodes what comes
 * next while frames are rendered. Experimental: it may change with each version of the library.
 *
 *   l4d_cuda_player_options options = L4D_INIT(l4d_cuda_player_options);
 *   options.reader = &reader;                             // or options.uri
 *   l4d_cuda_player_create(&options, &p);
 *   l4d_cuda_player_reserve(p, 1352, 1014, 1 << 21);      // once
 *   l4d_cuda_player_render(p, 2.5, &camera, &image, stream);
 *   l4d_cuda_player_get_stats(p, stream, &stats);         // waits; was the capacity enough?
 *
 * The caller says the time of each frame. The player keeps the buckets that the next
 * l4d_playback_options.ahead seconds need, in the direction of the rate; after the end the
 * presentation begins again. Where a frame needs a bucket that is not resident, render blocks until
 * it is. An image depends only on the stream, the time and the camera, not on what was played
 * before, unless options.automatic is 1.
 *
 * Conventions are those of cuda_render.h. Every build has these functions; in one without device
 * code l4d_cuda_player_create fails with FEATURE_UNSUPPORTED. */
#ifndef L4D_EXPERIMENTAL_CUDA_PLAYER_H
#define L4D_EXPERIMENTAL_CUDA_PLAYER_H

#include "l4d/experimental/cuda_render.h"
#include "l4d/playback.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_cuda_player l4d_cuda_player;

typedef struct l4d_cuda_player_options {
  size_t struct_size;
  /* A local file: the player's thread calls the reader, which is borrowed until the player is
   * destroyed. NULL: what `uri` names comes over a link, see take. */
  const l4d_reader* reader;
  const char* uri; /* as l4d_playback_open, as is `size` */
  uint64_t size;
  /* Limits and deadlines, copied; NULL: all defaults. `ahead` is 0.5 seconds of a local file unless
   * given. With max_units, the store has room for this many Gaussians from the start, and buckets
   * stay resident while it suffices, so that replaying does not decode them again: each bucket
   * takes a multiple of 1024. Frames need the memory of l4d_cuda_frame_capacity in addition. What
   * one instant needs to be read has to fit into three quarters of byte_pool_bytes. The player
   * chooses loader, unit_grain, max_loads, strict and start_ahead. */
  const l4d_playback_options* playback;
  l4d_operating_point point; /* what is shown: see l4d_quality */
  uint32_t automatic;        /* 1: lower rungs are shown where the link does not carry `point` */
  uint32_t device;           /* CUDA's number of it */
  uint32_t sh_float32;       /* 1: SH coefficients are float32 on the device; 0: binary16 */
  uint32_t no_read_ahead;    /* 1: nothing is fetched ahead of the instant that is shown */
  /* 1: seek and render do not wait for buckets. They return NEED_DATA, and what they lack comes. */
  uint32_t no_wait;
  uint32_t reserved;
} l4d_cuda_player_options;

/* Creates a player. Of a local file, waits until it is open, and fails as l4d_playback_open_reader
 * and l4d_cuda_decoder_create do; of a link, those failures come from seek and render. Fails with
 * FEATURE_UNSUPPORTED if the stream states a rendering of its own. On failure
 * l4d_last_error_message returns the reason. */
L4D_API l4d_status l4d_cuda_player_create(const l4d_cuda_player_options* options,
                                          l4d_cuda_player** out);
L4D_API void l4d_cuda_player_destroy(l4d_cuda_player* player); /* accepts NULL; waits */

/* Reserves memory for images of width x height pixels with at most `instances` pairs of Gaussian
 * and tile. Capacities only grow. Waits. Memory for visible Gaussians grows by itself. */
L4D_API l4d_status l4d_cuda_player_reserve(l4d_cuda_player* player, uint32_t width, uint32_t height,
                                           uint64_t instances);

/* Waits until the buckets of `time` (seconds, clamped to the presentation) are resident: call it
 * before the first frame or an announced seek. Fails as l4d_cuda_decoder_prepare and
 * l4d_cuda_decoder_finish do, with CHECKSUM if stored bytes are wrong, with IO if the reader or the
 * link fails, with LIMIT_EXCEEDED if max_units or memory of the engine is too small. A later call
 * tries again. A file that changes over a link fails for good. */
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

/* ---- link ------------------------------------------------------------------------------------
 * These calls are allowed on any thread, also while another call of the player runs: a link may
 * hand in what a blocking render waits for. They wait while the player's thread plans or reads
 * stored bytes. The player's clock stands for `now`. */

/* l4d_playback_take without LOAD, UNLOAD and the events of seeks. The queue holds 256; while it is
 * full, nothing is requested or loaded. Of a local file there are none. */
L4D_API l4d_status l4d_cuda_player_take(l4d_cuda_player* player, l4d_playback_item* items,
                                        uint32_t capacity, uint32_t* count);
/* As l4d_playback_answered, _received and _finished. */
L4D_API l4d_status l4d_cuda_player_answered(l4d_cuda_player* player, uint32_t id,
                                            const l4d_answer* answer);
L4D_API l4d_status l4d_cuda_player_received(l4d_cuda_player* player, uint32_t id, const void* data,
                                            size_t n);
L4D_API l4d_status l4d_cuda_player_finished(l4d_cuda_player* player, uint32_t id, uint32_t outcome);
/* As l4d_playback_set_rate: in which direction and how fast the times of frames are going to step.
 * 1 unless given. */
L4D_API l4d_status l4d_cuda_player_set_rate(l4d_cuda_player* player, double rate);
/* Of the engine when it planned last. A render whose time is in [ready_from, ready_until] does not
 * wait, if `ready` is 1. */
L4D_API l4d_status l4d_cuda_player_get_state(const l4d_cuda_player* player,
                                             l4d_playback_state* state);

typedef struct l4d_cuda_player_counters {
  size_t struct_size;
  uint64_t frames;      /* that were rendered */
  uint64_t stalls;      /* calls of render and seek that waited for buckets */
  double stall_seconds; /* sum of these waits */
  uint64_t buckets_decoded;
  uint64_t gaussians_decoded;
  uint64_t bytes_uploaded;
  uint64_t resident_gaussians; /* in the store now */
  uint64_t store_bytes;        /* of the store, used or not */
  uint64_t scratch_bytes;      /* device memory that decoding works in */
} l4d_cuda_player_counters;
L4D_API l4d_status l4d_cuda_player_get_counters(const l4d_cuda_player* player,
                                                l4d_cuda_player_counters* counters);

#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_CUDA_PLAYER_H */
