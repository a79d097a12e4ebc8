/* SPDX-License-Identifier: Apache-2.0
 * rate.h: how much of a stream to fetch over a link whose throughput varies. The controller knows
 * what was measured and what lacks, and chooses a rung of the stream's ladder. It reads no clock,
 * waits for nothing and needs no thread: all times are the caller's, in seconds.
 *
 *   l4d_decoder_get_rungs(decoder, rungs, L4D_MAX_RUNGS, &num_rungs);  // once the headers are here
 *   l4d_rate_create(NULL, num_rungs, &rate);
 *   for each answered request: l4d_rate_add_transfer(rate, sent, first_byte, last_byte, bytes);
 *   a few times a second:
 *     for each rung r: l4d_decoder_get_rung_state(decoder, time, 6, &rungs[r], &states[r]);
 *     l4d_rate_choose(rate, states, num_rungs, &choice);
 *     plan and request choice.rung, then, with what the link has left, choice.fill_rung;
 *     show choice.rung (l4d_decoder_set_layers, l4d_decoder_set_detail).
 */
#ifndef L4D_RATE_H
#define L4D_RATE_H

#include "l4d/stream.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A rung of a stream's ladder: what is fetched and shown. Each rung contains the one below it, so
 * going up fetches what is missing, and going down throws nothing away. */
#define L4D_MAX_RUNGS 512
typedef struct l4d_rung {
  uint32_t max_tier;  /* as in l4d_plan_query and l4d_decoder_set_layers */
  uint32_t max_level; /* likewise */
  uint32_t detail;    /* L4D_DETAIL_* */
  uint32_t reserved;
} l4d_rung; /* frozen */
/* The ladder of an open stream, lowest rung first: its tiers one by one in base colours, then all
 * of it in full detail. All temporal levels are in each rung: without the fine ones, what moves is
 * missing. *count is the number of rungs, 1 or more; the first min(capacity, *count) go to `rungs`,
 * which may be NULL where capacity is 0. Fails as l4d_decoder_get_info does. */
L4D_API l4d_status l4d_decoder_get_rungs(const l4d_decoder* decoder, l4d_rung* rungs,
                                         uint32_t capacity, uint32_t* count);

/* What of a rung is here. */
typedef struct l4d_rung_state {
  double buffered; /* seconds from the instant on that lack nothing; infinity: to the end */
  uint64_t missing_bytes;
} l4d_rung_state; /* frozen */
/* The state of a rung for slices from `time` to `time` + `ahead` seconds, of a stream that is open
 * for supplies (stream.h). Fails as l4d_decoder_plan does, and with NEED_DATA before the headers
 * are here. */
L4D_API l4d_status l4d_decoder_get_rung_state(l4d_decoder* decoder, double time, double ahead,
                                              const l4d_rung* rung, l4d_rung_state* state);

typedef struct l4d_rate l4d_rate;

typedef struct l4d_rate_options {
  size_t struct_size;
  /* Seconds of playback that the caller plans ahead of the instant that is shown; 6. The states of
   * l4d_rate_choose are for as many. */
  double ahead;
  /* The choice goes up only while more seconds than this are buffered; 4. Below `ahead`. */
  double up_buffer;
  /* Bytes per second, before the first transfer; 0 = unknown, which allows the lowest rung only. */
  double start_throughput;
} l4d_rate_options;
L4D_API void l4d_rate_options_init_(l4d_rate_options* options, size_t struct_size);
#define l4d_rate_options_init(options) l4d_rate_options_init_((options), sizeof(*(options)))

/* Creates a controller of a ladder of `num_rungs` rungs, lowest first. It begins with rung 0.
 * options may be NULL: all defaults. Fails with INVALID_ARGUMENT if num_rungs is 0 or above
 * L4D_MAX_RUNGS or an option is out of range, with OUT_OF_MEMORY. */
L4D_API l4d_status l4d_rate_create(const l4d_rate_options* options, uint32_t num_rungs,
                                   l4d_rate** out);
L4D_API void l4d_rate_destroy(l4d_rate* rate); /* accepts NULL */

/* Adds a measurement: a request that was sent at `sent`, of which the first and the last of `bytes`
 * bytes arrived at `first_byte` and `last_byte`. A caller that does not know when the first byte
 * arrived passes `sent` for it; then the throughput is underestimated. Requests may be under way at
 * the same time; add them in the order in which they end. The throughput is the mean over the last
 * transfers of 8 KiB or more, the round trip the least of the last ones. Fails with
 * INVALID_ARGUMENT if the times are not finite or descend. */
L4D_API l4d_status l4d_rate_add_transfer(l4d_rate* rate, double sent, double first_byte,
                                         double last_byte, uint64_t bytes);

/* Which requests under way l4d_rate_choose asks to cancel: their bytes come too late. */
enum {
  L4D_RATE_CANCEL_NONE = 0,
  L4D_RATE_CANCEL_DETAIL = 1,      /* those of kind L4D_RANGE_DETAIL */
  L4D_RATE_CANCEL_ALL_BUT_BASE = 2 /* all but those that rung 0 needs */
};
typedef struct l4d_rate_choice {
  size_t struct_size;
  uint32_t rung;      /* to plan, to request and to show */
  uint32_t fill_rung; /* to request with what the link has left: `rung`, or the one above it */
  uint32_t cancel;    /* L4D_RATE_CANCEL_* */
  uint32_t reserved;
  uint64_t merge_gap;       /* for l4d_plan_query */
  uint64_t max_range_bytes; /* for l4d_plan_query */
  double throughput; /* bytes per second, as measured, 0 = unknown; the choice uses 0.8 of it */
  double round_trip; /* seconds; 0 = unknown */
} l4d_rate_choice;
L4D_API void l4d_rate_choice_init_(l4d_rate_choice* choice, size_t struct_size);
#define l4d_rate_choice_init(choice) l4d_rate_choice_init_((choice), sizeof(*(choice)))

/* Chooses a rung. states: [num_rungs], of one instant and `ahead` seconds after it. A rung fits if
 * 0.8 of the throughput brings its missing bytes within its buffered seconds less one, or within
 * one second if that is more; a rung that lacks nothing always fits.
 *  - If the present rung does not fit, the choice goes down at once to the highest one that does.
 *  - It goes up one rung if that fits within three quarters of its time and more than up_buffer
 *    seconds of the present one are buffered, and as far as rungs lack nothing.
 *  - If less than 1 second of the present rung is buffered, it asks to cancel detail. If less than
 *    0.3 seconds of rung 0 are, it goes down to rung 0 and asks to cancel all else.
 * Fails with INVALID_ARGUMENT if num_rungs is not that of the controller or a buffered time is not
 * a number. */
L4D_API l4d_status l4d_rate_choose(l4d_rate* rate, const l4d_rung_state* states, uint32_t num_rungs,
                                   l4d_rate_choice* choice);

#ifdef __cplusplus
}
#endif

#endif
