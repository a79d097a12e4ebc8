/* SPDX-License-Identifier: Apache-2.0
 * A player over l4d/playback.h, for a link that a virtual clock simulates: it shows the first
 * picture of a file, plays some seconds, then seeks. It needs no thread and never waits in a
 * callback. It prints what the stream costs: rounds (requests that are made when no other is under
 * way), requests, bytes and seconds. Decoding takes no time on its clock, so all figures depend on
 * the file alone.
 *
 *   player_async FILE [MBIT_PER_SECOND [ROUND_TRIP_SECONDS [PLAY_SECONDS [SEEKS]]]]
 *   cc player_async.c $(pkg-config --cflags --libs l4dcodec)
 *
 * A player over sockets has the same parts: `start` sends a request, `deliver` is what a socket
 * does when bytes arrive, and `wait` sleeps until state.wake_at or until a socket can be read.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "l4d/playback.h"

enum { MAX_REQUESTS = 8, PIECE_BYTES = 1 << 10, NUM_ITEMS = 64 };
static const double kFrameSeconds = 1.0 / 30;

/* An answer that is under way. The link sends answers one after the other. */
typedef struct request {
  uint32_t id;
  uint64_t at, end;    /* bytes of the file that are still to come */
  double head_arrives; /* a round trip after the request */
  int has_head;
} request;

typedef struct player {
  l4d_playback* playback;
  FILE* file;
  uint64_t file_bytes;
  double bytes_per_second, round_trip; /* of the link */
  double clock;                        /* seconds */
  double link_free;                    /* when the link has sent the last piece */
  request requests[MAX_REQUESTS];
  size_t num_requests;
  uint64_t rounds, total_requests, total_bytes; /* since the last report */
  uint64_t switches;                            /* of the rung */
  uint32_t shown;                               /* id of the last seek that is shown */
  l4d_playback_state state;
  l4d_status failure;
} player;

static void check(player* p, l4d_status status) {
  if (p->failure == L4D_OK) p->failure = status;
}

/* ---- the link -------------------------------------------------------------------------------- */

static void start(player* p, const l4d_playback_item* item) {
  request* r = &p->requests[p->num_requests];
  if (p->num_requests == MAX_REQUESTS) return; /* max_requests is less */
  r->id = item->id;
  r->at = item->offset;
  r->end = item->size == 0 ? p->file_bytes : item->offset + item->size;
  r->head_arrives = p->clock + p->round_trip;
  r->has_head = 0;
  if (p->num_requests == 0) ++p->rounds;
  ++p->num_requests;
  ++p->total_requests;
}

static void drop(player* p, uint32_t id) {
  size_t i, kept = 0;
  for (i = 0; i < p->num_requests; ++i) {
    if (p->requests[i].id != id) p->requests[kept++] = p->requests[i];
  }
  p->num_requests = kept;
}

static uint64_t piece_of(const request* r) {
  const uint64_t left = r->end - r->at;
  return left < PIECE_BYTES ? left : PIECE_BYTES;
}

/* When the next head or piece of an answer is here. */
static double next_arrival(const player* p) {
  const request* r = &p->requests[0];
  double begins;
  if (p->num_requests == 0) return HUGE_VAL;
  begins = r->head_arrives > p->link_free ? r->head_arrives : p->link_free;
  return r->has_head ? begins + (double)piece_of(r) / p->bytes_per_second : begins;
}

static void deliver(player* p) {
  request* r = &p->requests[0];
  static unsigned char bytes[PIECE_BYTES];
  const size_t n = (size_t)piece_of(r);
  const uint32_t id = r->id;
  if (!r->has_head) {
    l4d_answer answer = L4D_INIT(l4d_answer);
    answer.status = 206;
    answer.offset = r->at;
    answer.total_bytes = p->file_bytes;
    r->has_head = 1;
    check(p, l4d_playback_answered(p->playback, p->clock, id, &answer));
    return;
  }
  p->link_free = p->clock;
  if (fseek(p->file, (long)r->at, SEEK_SET) != 0 || fread(bytes, 1, n, p->file) != n) {
    check(p, L4D_ERR_IO);
  }
  r->at += n;
  p->total_bytes += n;
  check(p, l4d_playback_received(p->playback, p->clock, id, bytes, n));
  if (r->at < r->end) return;
  drop(p, id);
  check(p, l4d_playback_finished(p->playback, p->clock, id, L4D_TRANSFER_ENDED));
}

/* ---- the player ------------------------------------------------------------------------------ */

static void take_items(player* p) {
  l4d_playback_item items[NUM_ITEMS];
  uint32_t count = NUM_ITEMS, i;
  while (count == NUM_ITEMS && p->failure == L4D_OK) {
    check(p, l4d_playback_take(p->playback, items, NUM_ITEMS, &count));
    for (i = 0; i < count && p->failure == L4D_OK; ++i) {
      if (items[i].kind == L4D_ITEM_REQUEST) start(p, &items[i]);
      if (items[i].kind == L4D_ITEM_CANCEL) drop(p, items[i].id);
      if (items[i].kind != L4D_ITEM_EVENT) continue;
      if (items[i].event == L4D_EVENT_SHOWN) p->shown = items[i].id;
      if (items[i].event == L4D_EVENT_RUNG) ++p->switches;
    }
  }
}

/* Lets the engine decide. Returns whether the player goes on: not if the stream has failed. */
static int update(player* p) {
  check(p, l4d_playback_update(p->playback, p->clock));
  take_items(p);
  check(p, l4d_playback_get_state(p->playback, &p->state));
  return p->failure == L4D_OK && p->state.stream != L4D_STREAM_FAILED;
}

/* Lets time pass until something happens, but not beyond `until`. */
static void wait(player* p, double until) {
  double next = next_arrival(p);
  if (next > p->state.wake_at) next = p->state.wake_at;
  if (next > until) next = until;
  if (next == HUGE_VAL) check(p, L4D_ERR_INTERNAL); /* nothing can happen any more */
  if (next > p->clock && next < HUGE_VAL) p->clock = next;
  if (next_arrival(p) <= p->clock) deliver(p);
}

/* The picture of a frame. A real player passes arrays, and draws. */
static void show(player* p) {
  const l4d_playback_state* s = &p->state;
  double time = s->anchor_time + (p->clock - s->anchor_now) * s->velocity;
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  if (time < s->ready_from) time = s->ready_from;
  if (time > s->ready_until) time = s->ready_until;
  if (s->ready) check(p, l4d_playback_slice(p->playback, time, &splats));
}

static void report(player* p, const char* what, double per, double seconds) {
  printf("%-24s %6.1f rounds %7.1f requests %9.1f kB %8.2f s\n", what, (double)p->rounds / per,
         (double)p->total_requests / per, (double)p->total_bytes / per / 1e3, seconds / per);
  p->rounds = p->total_requests = p->total_bytes = 0;
}

static void play(player* p, double seconds) {
  const double start = p->clock, from = p->state.anchor_time, waited = p->state.waited_seconds;
  const uint64_t waits = p->state.waits;
  double due;
  p->switches = 0;
  check(p, l4d_playback_play(p->playback, p->clock));
  for (due = p->clock; update(p) && p->state.motion != L4D_MOTION_ENDED; wait(p, due)) {
    if (p->state.anchor_time >= from + seconds) break;
    if (p->clock < due) continue;
    show(p);
    due += kFrameSeconds;
  }
  check(p, l4d_playback_pause(p->playback, p->clock));
  report(p, "a second of playback", seconds, p->clock - start);
  printf("%-24s %6lu stalls %34.2f s\n", "", (unsigned long)(p->state.waits - waits),
         p->state.waited_seconds - waited);
  printf("%-24s %6lu, at the end rung %lu of %lu\n", "changes of the rung",
         (unsigned long)p->switches, (unsigned long)p->state.rung + 1,
         (unsigned long)p->state.num_rungs);
}

static void seek_around(player* p, double begin, double duration, int seeks) {
  const double start = p->clock;
  l4d_quality quality = L4D_INIT(l4d_quality);
  int i;
  quality.network = L4D_NETWORK_INSTANT; /* what a seek costs, without what it fetches ahead */
  check(p, l4d_playback_set_quality(p->playback, p->clock, &quality));
  for (i = 0; i < seeks && p->failure == L4D_OK; ++i) {
    const double time = begin + duration * (((7 * i) % seeks) + 0.5) / seeks;
    const uint32_t id = (uint32_t)i + 1;
    check(p, l4d_playback_seek(p->playback, p->clock, time, 0, id));
    for (; update(p) && p->shown != id; wait(p, HUGE_VAL)) {
    }
    show(p);
  }
  if (seeks > 0) report(p, "a seek", seeks, p->clock - start);
}

static void run(player* p, double play_seconds, int seeks) {
  check(p, l4d_playback_open(p->playback, p->clock, "the file", L4D_OPEN_STREAM, p->file_bytes));
  for (; update(p) && !p->state.ready; wait(p, HUGE_VAL)) {
  }
  if (!p->state.ready) return;
  show(p);
  report(p, "first picture, rung 1", 1, p->clock);
  if (play_seconds > p->state.end - p->state.begin) play_seconds = p->state.end - p->state.begin;
  if (play_seconds > 0) play(p, play_seconds);
  seek_around(p, p->state.begin, p->state.end - p->state.begin, seeks);
}

int main(int argc, char** argv) {
  static player p;
  long size = -1;
  int failed;
  p.state.struct_size = sizeof p.state;
  p.bytes_per_second = (argc > 2 ? atof(argv[2]) : 25) * 1e6 / 8;
  p.round_trip = argc > 3 ? atof(argv[3]) : 0.05;
  if (argc > 1) p.file = fopen(argv[1], "rb");
  if (p.file != NULL && fseek(p.file, 0, SEEK_END) == 0) size = ftell(p.file);
  if (size <= 0 || !(p.bytes_per_second > 0) || !(p.round_trip >= 0)) {
    fprintf(stderr,
            "usage: player_async FILE [MBIT_PER_SECOND [ROUND_TRIP_SECONDS "
            "[PLAY_SECONDS [SEEKS]]]]\n");
    return 2;
  }
  p.file_bytes = (uint64_t)size;
  check(&p, l4d_playback_create(NULL, &p.playback));
  if (p.failure == L4D_OK) run(&p, argc > 4 ? atof(argv[4]) : 20, argc > 5 ? atoi(argv[5]) : 20);
  failed = p.failure != L4D_OK || p.state.stream == L4D_STREAM_FAILED;
  if (p.failure != L4D_OK) {
    fprintf(stderr, "player_async: %s %s\n", l4d_status_name(p.failure), l4d_last_error_message());
  } else if (failed) {
    fprintf(stderr, "player_async: the stream cannot be played: %s\n",
            l4d_playback_cause_name(p.state.cause));
  }
  l4d_playback_destroy(p.playback);
  fclose(p.file);
  return failed;
}
