/* SPDX-License-Identifier: Apache-2.0
 * playback.h: plays a stream, or the streams of a playlist, over a link: what to request next, what
 * to do when an answer is late, cut or wrong, which rung of the stream the link carries, what can
 * be shown, and when playback has to wait. The engine has no thread, no clock and no sockets, and
 * calls nothing back.
 *
 *   l4d_playback_create(NULL, &p);
 *   l4d_playback_open(p, now, "scene.l4d", L4D_OPEN_STREAM, 0);
 *   l4d_playback_play(p, now);
 *   loop: l4d_playback_update(p, now);
 *         l4d_playback_take(p, items, 64, &count);  // start requests, cancel them, see events
 *         l4d_playback_get_state(p, &state);        // the time of this frame: see the struct
 *         l4d_playback_slice(p, time, &splats);     // the picture
 *         wait until state.wake_at, the next frame, or bytes of a request:
 *         l4d_playback_answered, _received and _finished for what has come
 *
 * `now` is the caller's: seconds of one monotonic clock, which no call may set back. The same calls
 * with the same times give the same items. Times of the presentation are seconds on the clock of
 * the stream, or on the one that all members of a playlist share.
 */
#ifndef L4D_PLAYBACK_H
#define L4D_PLAYBACK_H

#include "l4d/decode.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct l4d_playback l4d_playback;

/* Who keeps decoded buckets. */
enum {
  L4D_LOADER_SLICES = 0, /* the engine, for l4d_playback_slice */
  L4D_LOADER_CALLER = 1  /* the caller, who decodes each bucket once, as LOAD items ask */
};
/* 0 is the default of every field. */
typedef struct l4d_playback_options {
  size_t struct_size;
  /* Of all decoders together: headers, directory, decoded buckets; 1 GiB */
  uint64_t max_memory_bytes;
  uint64_t byte_pool_bytes; /* of received bytes, 1 MiB at least; 256 MiB */
  /* Gaussians in the store of the caller; 0: no limit, and what the path does not need is unloaded.
   * Where they are too few for one instant, the stream fails with LIMIT. */
  uint64_t max_units;
  uint32_t unit_grain;   /* a bucket takes a multiple of this many; 1 */
  uint32_t loader;       /* L4D_LOADER_* */
  uint32_t failures;     /* of requests in a row before the source counts as down; 5 */
  uint32_t max_requests; /* without an end; 6 */
  uint32_t max_loads;    /* without an answer; 2 */
  uint32_t threads;      /* of decoding, as in l4d_decoder_options; 1 */
  /* 1: what is lost stops playback where it is needed. 0: the rest is shown without it. */
  uint32_t strict;
  /* Of a live playlist that begins anew. 1: the engine fails with CHANGED. 0: it goes on with the
   * new one. */
  uint32_t refuse_restart;
  double ahead;       /* seconds of `now` that are fetched ahead; 6 */
  double start_ahead; /* of which are here before playback starts; 0.5 */
  /* Seconds until a request is cancelled and made again: without a byte, the same while the picture
   * waits for it, and without another byte. 10, 3, 5 */
  double first_byte_timeout, urgent_timeout, idle_timeout;
  /* Seconds between a failure and the next request: the first time, and at most. They double, and
   * vary by a quarter with the number of the request. 0.25, 8 */
  double retry_delay, max_retry_delay;
  double max_step; /* a step of `now` that is longer is reported by the event LATE; 1 */
  /* Of a playlist that grows, in seconds: how far behind its end to play, and from which distance
   * on to jump there. Two and ten of its target durations. Where a wait for bytes ends more than a
   * target duration beyond live_distance, playback jumps, too. */
  double live_distance, max_live_distance;
  double live_slow, live_fast; /* factors of the rate on the way there; 1 and 1: none. 0.95, 1.05 */
  double stale_after;          /* seconds without growth; three target durations, at least 6 */
} l4d_playback_options;

/* Why something is lost, late or has failed. */
enum {
  L4D_CAUSE_NONE = 0,
  L4D_CAUSE_TIMEOUT = 1,   /* no byte came in time */
  L4D_CAUSE_NETWORK = 2,   /* the link failed, or the server is busy or broken */
  L4D_CAUSE_FORBIDDEN = 3, /* the server refuses; it is not asked again */
  L4D_CAUSE_NOT_FOUND = 4,
  L4D_CAUSE_CHANGED = 5,   /* the file is another one than before */
  L4D_CAUSE_GARBLED = 6,   /* bytes arrive wrong, and each time others */
  L4D_CAUSE_DAMAGED = 7,   /* bytes arrive wrong, and are the same each time */
  L4D_CAUSE_TRUNCATED = 8, /* the file ends before them */
  L4D_CAUSE_CORRUPT = 9,   /* bytes are as the writer made them, and break a rule */
  L4D_CAUSE_NOT_L4D = 10,
  L4D_CAUSE_VERSION = 11,
  L4D_CAUSE_FEATURE = 12,
  L4D_CAUSE_LIMIT = 13,    /* memory or the store does not suffice */
  L4D_CAUSE_PLAYLIST = 14, /* the playlist breaks a rule, or lists no media member */
  L4D_CAUSE_NO_RANGES = 15 /* the server sends the whole file in place of a member */
};
/* The enumerator's name, static: "L4D_CAUSE_TIMEOUT". */
L4D_API const char* l4d_playback_cause_name(uint32_t cause);

/* Creates an engine without a stream. options may be NULL: all defaults. Fails with
 * INVALID_ARGUMENT if an option is out of range, with OUT_OF_MEMORY. */
L4D_API l4d_status l4d_playback_create(const l4d_playback_options* options, l4d_playback** out);
L4D_API void l4d_playback_destroy(l4d_playback* p); /* accepts NULL */

/* ---- commands --------------------------------------------------------------------------------
 * They return at once. They fail with INVALID_ARGUMENT if an argument or `now` is not finite, with
 * INVALID_STATE if they need a stream and none was given, with OUT_OF_MEMORY: what the link and the
 * stream do is state and events. */

enum {
  L4D_OPEN_STREAM = 0,  /* a file of one stream */
  L4D_OPEN_PLAYLIST = 1 /* a playlist of members (section 20.5 of the specification) */
};
/* Opens what `uri` names, and closes what was open. size: of the file in bytes, 0 if that is not
 * known; of a playlist 0. Copies `uri`, which the caller alone interprets. */
L4D_API l4d_status l4d_playback_open(l4d_playback* p, double now, const char* uri, uint32_t kind,
                                     uint64_t size);
/* A local file: the engine reads it itself, makes no requests, and its calls wait for the reader.
 * Borrows reader->user until the engine is closed. */
L4D_API l4d_status l4d_playback_open_reader(l4d_playback* p, double now, const l4d_reader* reader);
/* Requests under way are cancelled. */
L4D_API l4d_status l4d_playback_close(l4d_playback* p, double now);
/* At the end of the presentation, begins again. */
L4D_API l4d_status l4d_playback_play(l4d_playback* p, double now);
L4D_API l4d_status l4d_playback_pause(l4d_playback* p, double now);
/* Goes to `time`, which is clamped to the range; +infinity: to the live position, or to the end of
 * what does not grow. Before the stream is open, it waits for that.
 * Of a playlist that grows, a seek to more than max_live_distance behind its end stays there.
 * tolerance 0: seeks. What was sought before ends as REPLACED.
 * tolerance above 0, in seconds: scrubs, as while a finger drags. If an instant that near is here,
 * it is shown at once. Else one instant at a time is fetched, in the lowest rung and to its end,
 * then the newest one. A seek with tolerance 0, or play, ends scrubbing.
 * Each call leads to exactly one event SHOWN, REPLACED or FAILED with its `id`. */
L4D_API l4d_status l4d_playback_seek(l4d_playback* p, double now, double time, double tolerance,
                                     uint32_t id);
/* Seconds of the presentation in a second of `now`, from -64 to 64; below 0: backwards. 1 at first.
 */
L4D_API l4d_status l4d_playback_set_rate(l4d_playback* p, double now, double rate);
enum { L4D_PLAY_ONCE = 0, L4D_PLAY_LOOP = 1, L4D_PLAY_PING_PONG = 2 };
/* What is played of the presentation, and what follows its end. begin > end: all of it. */
L4D_API l4d_status l4d_playback_set_range(l4d_playback* p, double now, uint32_t mode, double begin,
                                          double end);
enum {
  L4D_NETWORK_ALL = 0,
  L4D_NETWORK_INSTANT = 1,  /* nothing ahead of the instant that is shown */
  L4D_NETWORK_METADATA = 2, /* headers, tables and directory */
  L4D_NETWORK_NONE = 3      /* no new request */
};
typedef struct l4d_quality {
  size_t struct_size;
  l4d_operating_point point; /* at most this much of the stream; all 0: all of it */
  /* 0: the engine chooses among the rungs up to `point`, by what the link carries. 1: it shows
   * `point`, and waits for it. */
  uint32_t fixed;
  uint32_t network; /* L4D_NETWORK_*; requests under way end */
} l4d_quality;
L4D_API l4d_status l4d_playback_set_quality(l4d_playback* p, double now,
                                            const l4d_quality* quality);
/* All that is lost, down or failed is tried again at once. */
L4D_API l4d_status l4d_playback_retry(l4d_playback* p, double now);
/* The caller's store is empty: LOADs come again. */
L4D_API l4d_status l4d_playback_refresh(l4d_playback* p, double now);

/* ---- running --------------------------------------------------------------------------------- */
/* Reaches all deadlines up to `now`, and plans. Call it at state.wake_at at the latest, and after
 * other calls, as often as it is convenient: only this call makes requests and loads. */
L4D_API l4d_status l4d_playback_update(l4d_playback* p, double now);

enum {
  L4D_ITEM_REQUEST = 1, /* ask for `size` bytes from `offset` on; size 0: up to the end */
  L4D_ITEM_CANCEL = 2,  /* the request `id` has ended; what still comes of it is ignored */
  L4D_ITEM_LOAD = 3,    /* decode a bucket (get_decoder), put it into the store, say loaded */
  L4D_ITEM_UNLOAD = 4,  /* drop a bucket from the store */
  L4D_ITEM_EVENT = 5
};
enum {
  L4D_REQUEST_FRESH = 1,   /* past all caches: what came before was wrong */
  L4D_REQUEST_WHOLE = 2,   /* the whole file, without a range: the server has none */
  L4D_REQUEST_URGENT = 4,  /* the picture waits for it */
  L4D_REQUEST_PLAYLIST = 8 /* the playlist; caches must not answer without asking the server */
};
enum {
  L4D_EVENT_STREAM = 1,   /* state.stream is another one; value: it; cause */
  L4D_EVENT_MOTION = 2,   /* state.motion is another one; value: it; time */
  L4D_EVENT_SHOWN = 3,    /* id of the seek; the instant `time` is here */
  L4D_EVENT_REPLACED = 4, /* id of the seek */
  L4D_EVENT_FAILED = 5,   /* id of the seek; cause */
  L4D_EVENT_RUNG = 6,     /* state.rung is another one; value: it */
  /* A chunk is lost; stream, offset in it, size, cause. size 0: a member, all of it. Once until
   * FOUND. */
  L4D_EVENT_LOST = 7,
  L4D_EVENT_FOUND = 8,        /* it came later; stream, offset, size */
  L4D_EVENT_RETRY = 9,        /* a request failed; id, cause, value: seconds until the next one */
  L4D_EVENT_SOURCE_DOWN = 10, /* `failures` in a row; one request each max_retry_delay follows */
  L4D_EVENT_SOURCE_UP = 11,   /* it answers again */
  L4D_EVENT_LIMIT = 12,       /* memory holds less than is wanted: less is fetched ahead */
  L4D_EVENT_LATE = 13,        /* `now` made a long step; value: seconds */
  L4D_EVENT_WRAPPED = 14,     /* a loop began again, or ping-pong turned; time */
  L4D_EVENT_LIVE = 15,        /* state.live is another one; value: it */
  L4D_EVENT_JUMPED = 16, /* playback goes on at `time`; value: the seconds that it leaves out */
  L4D_EVENT_GROWN = 17,  /* state.begin or .end is another one: the playlist has changed */
  L4D_EVENT_OPENED = 18, /* stream: a member is open, see get_decoder */
  L4D_EVENT_CLOSED = 19  /* stream: all that was known of it is gone, its decoder, too */
};
typedef struct l4d_playback_item {
  uint32_t kind, id;      /* L4D_ITEM_*; of the request, load or seek */
  uint32_t source, flags; /* REQUEST: see get_uri; L4D_REQUEST_* */
  uint64_t offset, size;  /* REQUEST: in the source; LOST and FOUND: in the stream */
  /* LOAD, UNLOAD; L4D_DETAIL_*. stream: the number of a member, 0 without a playlist */
  uint32_t stream, layer, bucket, detail;
  uint64_t units;        /* LOAD: Gaussians at most */
  double needed_at;      /* REQUEST, LOAD: the `now` after which it is late */
  uint32_t event, cause; /* EVENT: L4D_EVENT_*, L4D_CAUSE_* */
  double time, value;    /* EVENT: of the presentation; as the event says */
} l4d_playback_item;     /* frozen */
/* Moves up to `capacity` items out of the queue, oldest first; the others come with the next call,
 * which needs no update before it. While 256 wait in the queue, nothing new is requested or loaded.
 * Ids of requests and loads are never used again. */
L4D_API l4d_status l4d_playback_take(l4d_playback* p, l4d_playback_item* items, uint32_t capacity,
                                     uint32_t* count);

/* ---- link ------------------------------------------------------------------------------------
 * Calls with the id of a request that has ended or was cancelled return OK and do nothing. */
typedef struct l4d_answer {
  size_t struct_size;
  uint32_t status; /* as HTTP: 200, 206, 404, 416, 429, 503 ..; other links answer 206 */
  uint32_t reserved;
  uint64_t offset;      /* of the first byte that follows; 0 for 200 */
  uint64_t total_bytes; /* of the file; 0 = not known */
  uint64_t version;     /* hash of a strong ETag or the like; 0 = none */
  double retry_after;   /* seconds; 0 = not stated */
} l4d_answer;
/* The head of an answer. A status that is not 200 or 206 ends the request. Links without heads may
 * leave this call out: bytes then begin where the request does. */
L4D_API l4d_status l4d_playback_answered(l4d_playback* p, double now, uint32_t id,
                                         const l4d_answer* answer);
/* The next `n` bytes of an answer, which are copied. */
L4D_API l4d_status l4d_playback_received(l4d_playback* p, double now, uint32_t id, const void* data,
                                         size_t n);
enum {
  L4D_TRANSFER_ENDED = 0,    /* whether or not all bytes came */
  L4D_TRANSFER_FAILED = 1,   /* the link broke */
  L4D_TRANSFER_FORBIDDEN = 2 /* to try again is of no use */
};
L4D_API l4d_status l4d_playback_finished(l4d_playback* p, double now, uint32_t id,
                                         uint32_t outcome);

/* ---- showing --------------------------------------------------------------------------------- */
/* The decoder of a stream: of the member with this number, or of the only one, which is 0. Borrowed
 * until the event CLOSED or the next open or close. It has the bytes of the LOADs that are out:
 * l4d_decoder_decode with the kind L4D_QUERY_BUCKETS and the detail of the item. Its times are
 * those of the presentation less l4d_shown_member.shift. Fails with NEED_DATA while the stream is
 * not open. */
L4D_API l4d_status l4d_playback_get_decoder(l4d_playback* p, uint32_t stream, l4d_decoder** out);
/* A LOAD is done: the bucket has `units` Gaussians in the store. status: of decoding. CORRUPT and
 * the like: the bucket is shown without what is lost. */
L4D_API l4d_status l4d_playback_loaded(l4d_playback* p, double now, uint32_t id, uint64_t units,
                                       l4d_status status);
/* With L4D_LOADER_SLICES: l4d_decoder_slice in the rung that is shown; out->point is ignored. Of
 * several members that show `time`, as l4d_slice_streams. Rows of SH have the degree
 * state.sh_degree. Fails with NEED_DATA if `time` is outside [ready_from, ready_until], with
 * INVALID_STATE with another loader. */
L4D_API l4d_status l4d_playback_slice(l4d_playback* p, double time, l4d_splat_buffers* out);

/* ---- state ----------------------------------------------------------------------------------- */
enum {
  L4D_STREAM_CLOSED = 0,
  L4D_STREAM_OPENING = 1,
  L4D_STREAM_OPEN = 2,
  L4D_STREAM_DEGRADED = 3, /* open, and the source is down */
  L4D_STREAM_FAILED = 4    /* cause; tried again at times, and by retry and seeks */
};
enum {
  L4D_MOTION_PAUSED = 0,
  L4D_MOTION_PLAYING = 1,
  L4D_MOTION_WAITING = 2, /* for bytes */
  L4D_MOTION_ENDED = 3
};
enum { L4D_SEARCH_NONE = 0, L4D_SEARCH_SEEKING = 1, L4D_SEARCH_SCRUBBING = 2 };
enum {
  L4D_LIVE_NONE = 0,      /* what is open has its end */
  L4D_LIVE_ON_TIME = 1,   /* the playlist grows */
  L4D_LIVE_BEHIND = 2,    /* playback is more than a target duration too far behind */
  L4D_LIVE_STALE = 3,     /* the playlist has not grown for `stale_after`; it is looked at anyway */
  L4D_LIVE_RESTARTED = 4, /* the playlist is another one; nothing of it has been shown yet */
  L4D_LIVE_ENDED = 5      /* it grew, and is complete now */
};
/* A frame at `now` shows the time
 *   clamp(anchor_time + (now - anchor_now) * velocity, ready_from, ready_until)
 * which needs no call: who draws on another thread has a copy of this struct. If nothing can be
 * shown, ready_from and ready_until are both anchor_time, and `ready` is 0. */
typedef struct l4d_playback_state {
  size_t struct_size;
  uint32_t stream, motion, search; /* L4D_STREAM_*, L4D_MOTION_*, L4D_SEARCH_* */
  uint32_t cause;                  /* of FAILED */
  uint32_t rung, num_rungs;        /* shown; of the ladder, lowest first */
  uint32_t ready;                  /* 1: the instant anchor_time can be shown */
  uint32_t live;                   /* L4D_LIVE_* */
  double begin, end;               /* of the presentation */
  double anchor_time, anchor_now, velocity, ready_from, ready_until;
  double wake_at;  /* when to update again at the latest; it may have passed; infinity: never */
  double retry_at; /* of FAILED: the next attempt; infinity: by retry alone */
  double throughput, round_trip;     /* bytes per second and seconds; 0 = not known */
  double waited_seconds;             /* in WAITING */
  uint64_t received_bytes;           /* of answers */
  uint64_t wasted_bytes;             /* of these, those that were here, wrong or not kept */
  uint64_t requests, retries, waits; /* requests made, failures, times that playback stopped */
  uint64_t memory_bytes, units;      /* of pool and decoders; in the caller's store */
  /* Of a playlist that grows, in seconds: how far behind its end anchor_time is, between two steps
   * of its growth, too; and how far it is to be: grows with each starvation. Else 0 */
  double live_delay, live_distance;
  uint32_t sh_degree, reserved; /* the highest of the members that were open so far */
} l4d_playback_state;
/* This and the next calls neither plan nor change anything. */
L4D_API l4d_status l4d_playback_get_state(const l4d_playback* p, l4d_playback_state* state);
/* What of the presentation plays without another byte in the rung that is shown, as far as it has
 * been looked at: what is near the instant. Ascending. *count is their number; the first
 * min(capacity, *count) go to `spans`, which may be NULL where capacity is 0. */
typedef struct l4d_time_span {
  double begin;
  double end;
} l4d_time_span; /* frozen */
L4D_API l4d_status l4d_playback_get_buffered(const l4d_playback* p, l4d_time_span* spans,
                                             uint64_t capacity, uint64_t* count);
/* Which members show which part of [begin, end], which may be infinite: each media member whose
 * span has a part in it, in their order, and after it the standing members that it needs, with the
 * same span. Between two spans, the nearer one is shown as it is at its end. Without a playlist,
 * the stream. Output as that of get_buffered. */
typedef struct l4d_shown_member {
  uint32_t stream;   /* see l4d_playback_item.stream */
  uint32_t standing; /* 1: it is a standing member */
  double begin, end; /* of the span, in seconds of the presentation */
  double shift;      /* time of the presentation less time of the stream */
} l4d_shown_member;  /* frozen */
L4D_API l4d_status l4d_playback_get_shown(const l4d_playback* p, double begin, double end,
                                          l4d_shown_member* shown, uint64_t capacity,
                                          uint64_t* count);
/* What is lost now of the members that are held. Output as that of get_buffered. */
typedef struct l4d_playback_loss {
  uint32_t stream, cause; /* L4D_CAUSE_* */
  uint64_t offset, size;  /* in the stream, in bytes; size 0: a member, all of it */
  double retry_at;        /* infinity: by retry alone, or in another version */
} l4d_playback_loss;      /* frozen */
L4D_API l4d_status l4d_playback_get_losses(const l4d_playback* p, l4d_playback_loss* losses,
                                           uint64_t capacity, uint64_t* count);
/* The URI of a source: 0 is what was opened, others are URIs of members as the playlist has them.
 * Relative ones are relative to that of the playlist. Borrowed until the next call that is not one
 * of the state. */
L4D_API l4d_status l4d_playback_get_uri(const l4d_playback* p, uint32_t source, const char** uri);

#ifdef __cplusplus
}
#endif

#endif
