/* SPDX-License-Identifier: Apache-2.0
 * A player over l4d/stream.h, for a link that a virtual clock simulates: it plays the first
 * seconds of a file, then seeks. It never waits in a callback and needs no thread. It prints what
 * the stream costs: rounds (requests that had to wait for the answer of others), requests, bytes
 * and seconds. Decoding takes no time on its clock, so all figures depend on the file alone.
 *
 *   player_async FILE [MBIT_PER_SECOND [ROUND_TRIP_SECONDS [PLAY_SECONDS [SEEKS]]]]
 *   cc player_async.c $(pkg-config --cflags --libs l4dcodec)
 */
#include <stdio.h>
#include <stdlib.h>

#include "l4d/stream.h"

enum { MAX_REQUESTS = 8, MAX_RANGES = 64 };
static const double kFrameSeconds = 1.0 / 30;
static const double kAheadSeconds = 2; /* what the player wants to have of the future */

/* A range of the file that is under way, and when its last byte is here. */
typedef struct request {
  uint64_t begin, end;
  double arrival;
} request;

typedef struct player {
  l4d_decoder* decoder;
  FILE* file;
  uint64_t file_bytes;
  double bytes_per_second, round_trip; /* of the link */
  double clock;                        /* seconds */
  double link_free;                    /* when the link has sent all that was requested */
  request requests[MAX_REQUESTS];      /* in the order in which they arrive */
  size_t num_requests;
  uint64_t rounds, total_requests, total_bytes; /* counted since the last report */
  l4d_status failure;
} player;

/* Requests a range. */
static void request_range(player* p, uint64_t begin, uint64_t end) {
  request* r = &p->requests[p->num_requests++];
  /* The answer starts a round trip later, or when the link has sent the answers before it. */
  const double start = p->clock + p->round_trip;
  r->begin = begin;
  r->end = end;
  r->arrival =
      (start > p->link_free ? start : p->link_free) + (double)(end - begin) / p->bytes_per_second;
  p->link_free = r->arrival;
  ++p->total_requests;
}

/* Requests what slices from `time` on lack and what is not under way, most urgent first. */
static void request_missing(player* p, double time, double ahead) {
  const int waited = p->num_requests == 0;
  l4d_planned_range ranges[MAX_RANGES];
  uint64_t count = 0, i;
  l4d_plan_query query;
  l4d_plan_query_init(&query);
  query.time = time;
  query.ahead = ahead;
  query.max_range_bytes = 256 << 10;
  if (p->failure == L4D_OK) {
    p->failure = l4d_decoder_plan(p->decoder, &query, ranges, MAX_RANGES, &count);
  }
  if (p->failure != L4D_OK) return;
  for (i = 0; i < count && i < MAX_RANGES && p->num_requests < MAX_REQUESTS; ++i) {
    uint64_t begin = ranges[i].offset, end = begin + ranges[i].size;
    size_t k;
    for (k = 0; k < p->num_requests; ++k) {
      const request* r = &p->requests[k];
      if (r->begin <= begin && begin < r->end) begin = r->end;
      if (r->begin < end && end <= r->end) end = r->begin;
    }
    if (begin < end) request_range(p, begin, end);
  }
  if (waited && p->num_requests > 0) ++p->rounds;
}

/* Lets time pass until the next answer is here, but not beyond `until`. Returns whether it is. */
static int wait_for_answer(player* p, double until) {
  const request r = p->requests[0];
  size_t i;
  void* data;
  if (p->num_requests == 0 || r.arrival > until) {
    if (until > p->clock) p->clock = until;
    return 0;
  }
  if (r.arrival > p->clock) p->clock = r.arrival;
  p->total_bytes += r.end - r.begin;
  for (i = 1; i < p->num_requests; ++i) p->requests[i - 1] = p->requests[i];
  --p->num_requests;
  data = malloc((size_t)(r.end - r.begin));
  if (data == NULL || fseek(p->file, (long)r.begin, SEEK_SET) != 0 ||
      fread(data, 1, (size_t)(r.end - r.begin), p->file) != r.end - r.begin) {
    p->failure = L4D_ERR_IO;
  } else if (p->failure == L4D_OK) {
    p->failure = l4d_decoder_supply(p->decoder, r.begin, data, (size_t)(r.end - r.begin));
  }
  free(data);
  return 1;
}

/* Whether the picture of `time` can be shown with this detail. A real player passes arrays. */
static int show(player* p, double time, uint32_t detail) {
  l4d_splat_buffers splats;
  l4d_status status;
  if (p->failure != L4D_OK) return 1; /* ends all waiting */
  l4d_splat_buffers_init(&splats);
  l4d_decoder_set_detail(p->decoder, detail);
  status = l4d_decoder_slice(p->decoder, time, &splats);
  if (status != L4D_OK && status != L4D_ERR_NEED_DATA) p->failure = status;
  return status != L4D_ERR_NEED_DATA;
}

/* Waits for the picture of `time`. Returns the seconds that it takes. */
static double wait_for_picture(player* p, double time, uint32_t detail) {
  const double start = p->clock;
  while (!show(p, time, detail)) {
    request_missing(p, time, 0);
    if (p->num_requests == 0 && p->failure == L4D_OK) p->failure = L4D_ERR_INTERNAL;
    wait_for_answer(p, 1e300);
  }
  return p->clock - start;
}

static void report(player* p, const char* what, double per, double seconds) {
  printf("%-24s %6.1f rounds %7.1f requests %9.1f kB %8.2f s\n", what, (double)p->rounds / per,
         (double)p->total_requests / per, (double)p->total_bytes / per / 1e3, seconds / per);
  p->rounds = p->total_requests = p->total_bytes = 0;
}

/* Plays from `begin` on. If a picture is not there when its time comes, the media clock stops. */
static void play(player* p, double begin, double seconds) {
  const double start = p->clock;
  double due = p->clock, stalled = 0, time = begin;
  int stalls = 0;
  for (; time < begin + seconds && p->failure == L4D_OK; time += kFrameSeconds) {
    do request_missing(p, time, kAheadSeconds);
    while (wait_for_answer(p, due));
    if (!show(p, time, L4D_DETAIL_FULL) && !show(p, time, L4D_DETAIL_BASE_COLOR)) {
      ++stalls;
      stalled += wait_for_picture(p, time, L4D_DETAIL_BASE_COLOR);
      due = p->clock;
    }
    due += kFrameSeconds;
  }
  report(p, "a second of playback", seconds, p->clock - start);
  printf("%-24s %6d stalls %34.2f s\n", "", stalls, stalled);
}

static void seek_around(player* p, double begin, double duration, int seeks) {
  double seconds = 0;
  int i;
  for (i = 0; i < seeks; ++i) {
    const double time = begin + duration * (((7 * i) % seeks) + 0.5) / seeks;
    p->num_requests = 0; /* what is under way is cancelled */
    p->link_free = p->clock;
    seconds += wait_for_picture(p, time, L4D_DETAIL_FULL);
  }
  if (seeks > 0) report(p, "a seek", seeks, seconds);
}

static void run(player* p, double play_seconds, int seeks) {
  l4d_info info;
  l4d_info_init(&info);
  p->failure = l4d_decoder_open_supplied(p->decoder, p->file_bytes);
  while (p->failure == L4D_OK) {
    const l4d_status status = l4d_decoder_get_info(p->decoder, &info);
    if (status != L4D_ERR_NEED_DATA) {
      p->failure = status;
      break;
    }
    request_missing(p, 0, 0); /* the headers, whatever the time */
    wait_for_answer(p, 1e300);
  }
  wait_for_picture(p, info.timeline.time_begin, L4D_DETAIL_BASE_COLOR);
  report(p, "first picture", 1, p->clock);
  wait_for_picture(p, info.timeline.time_begin, L4D_DETAIL_FULL);
  report(p, "first, in full detail", 1, p->clock);
  if (play_seconds > info.duration) play_seconds = info.duration;
  if (play_seconds > 0) play(p, info.timeline.time_begin, play_seconds);
  seek_around(p, info.timeline.time_begin, info.duration, seeks);
}

int main(int argc, char** argv) {
  player p = {0};
  long size = -1;
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
  p.failure = l4d_decoder_create(NULL, &p.decoder);
  if (p.failure == L4D_OK) run(&p, argc > 4 ? atof(argv[4]) : 20, argc > 5 ? atoi(argv[5]) : 20);
  if (p.failure != L4D_OK) {
    fprintf(stderr, "player_async: %s %s\n", l4d_status_name(p.failure), l4d_last_error_message());
  }
  l4d_decoder_destroy(p.decoder);
  fclose(p.file);
  return p.failure == L4D_OK ? 0 : 1;
}
