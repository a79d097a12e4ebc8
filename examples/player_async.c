/* SPDX-License-Identifier: Apache-2.0
 * A player over l4d/stream.h and l4d/rate.h, for a link that a virtual clock simulates: it plays
 * the first seconds of a file, then seeks. It never waits in a callback and needs no thread. It
 * prints what the stream costs: rounds (requests that had to wait for the answer of others),
 * requests, bytes and seconds. Decoding takes no time on its clock, so all figures depend on the
 * file alone.
 *
 *   player_async FILE [MBIT_PER_SECOND [ROUND_TRIP_SECONDS [PLAY_SECONDS [SEEKS]]]]
 *   cc player_async.c $(pkg-config --cflags --libs l4dcodec)
 */
#include <stdio.h>
#include <stdlib.h>

#include "l4d/rate.h"

enum { MAX_REQUESTS = 8, MAX_RANGES = 64, MAX_RUNGS = 16 };
static const double kFrameSeconds = 1.0 / 30;
static const double kAheadSeconds = 6; /* what the player wants to have of the future */
static const double kStartSeconds = 0.5;
static const int kFramesPerChoice = 6; /* how often it asks for another rung */

/* A range of the file that is under way, and when its first and its last byte are here. */
typedef struct request {
  uint64_t begin, end;
  double sent, first_byte, last_byte;
  uint32_t rung, kind; /* what asked for it */
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
  l4d_rate* rate;
  l4d_rung rungs[MAX_RUNGS];
  uint32_t num_rungs, switches;
  l4d_rate_choice choice; /* the rungs that are shown and fetched */
  l4d_status failure;
} player;

static void request_range(player* p, uint64_t begin, uint64_t end, uint32_t rung, uint32_t kind) {
  request* r = &p->requests[p->num_requests++];
  /* The answer starts a round trip later, or when the link has sent the answers before it. */
  r->begin = begin;
  r->end = end;
  r->sent = p->clock;
  r->first_byte = p->clock + p->round_trip;
  if (r->first_byte < p->link_free) r->first_byte = p->link_free;
  r->last_byte = r->first_byte + (double)(end - begin) / p->bytes_per_second;
  r->rung = rung;
  r->kind = kind;
  p->link_free = r->last_byte;
  ++p->total_requests;
}

/* Cancels requests of higher rungs than `rung`, and those of `kind`. */
static void cancel(player* p, uint32_t rung, uint32_t kind) {
  size_t i, kept = 0;
  for (i = 0; i < p->num_requests; ++i) {
    if (p->requests[i].rung <= rung && p->requests[i].kind != kind) {
      p->requests[kept++] = p->requests[i];
    }
  }
  if (kept < p->num_requests) {
    p->link_free = kept > 0 ? p->requests[kept - 1].last_byte : p->clock;
  }
  p->num_requests = kept;
}

/* Requests what slices of a rung from `time` on lack and what is not under way, most urgent first.
 * Returns how many ranges lack. */
static uint64_t request_rung(player* p, uint32_t rung, double time, double ahead) {
  l4d_planned_range ranges[MAX_RANGES];
  uint64_t count = 0, i;
  l4d_plan_query query;
  l4d_plan_query_init(&query);
  query.time = time;
  query.ahead = ahead;
  query.max_tier = p->rungs[rung].max_tier;
  query.max_level = p->rungs[rung].max_level;
  query.detail = p->rungs[rung].detail;
  query.merge_gap = p->choice.merge_gap;
  query.max_range_bytes = p->choice.max_range_bytes;
  if (p->failure == L4D_OK) {
    p->failure = l4d_decoder_plan(p->decoder, &query, ranges, MAX_RANGES, &count);
  }
  if (p->failure != L4D_OK) return 0;
  for (i = 0; i < count && i < MAX_RANGES && p->num_requests < MAX_REQUESTS; ++i) {
    uint64_t begin = ranges[i].offset, end = begin + ranges[i].size;
    size_t k;
    for (k = 0; k < p->num_requests; ++k) {
      const request* r = &p->requests[k];
      if (r->begin <= begin && begin < r->end) begin = r->end;
      if (r->begin < end && end <= r->end) end = r->begin;
    }
    if (begin < end) request_range(p, begin, end, rung, ranges[i].kind);
  }
  return count;
}

static void request_missing(player* p, double time, double ahead) {
  const int waited = p->num_requests == 0;
  if (request_rung(p, p->choice.rung, time, ahead) == 0 && p->choice.fill_rung > p->choice.rung) {
    request_rung(p, p->choice.fill_rung, time, ahead);
  }
  if (waited && p->num_requests > 0) ++p->rounds;
}

/* Asks the controller which rung to show and to fetch. */
static void choose_rung(player* p, double time) {
  l4d_rung_state states[MAX_RUNGS];
  const uint32_t before = p->choice.rung;
  uint32_t r;
  for (r = 0; r < p->num_rungs && p->failure == L4D_OK; ++r) {
    p->failure =
        l4d_decoder_get_rung_state(p->decoder, time, kAheadSeconds, &p->rungs[r], &states[r]);
  }
  if (p->failure != L4D_OK) return;
  p->failure = l4d_rate_choose(p->rate, states, p->num_rungs, &p->choice);
  if (p->choice.cancel == L4D_RATE_CANCEL_DETAIL) cancel(p, MAX_RUNGS, L4D_RANGE_DETAIL);
  if (p->choice.cancel == L4D_RATE_CANCEL_ALL_BUT_BASE) cancel(p, 0, L4D_RANGE_DETAIL);
  p->switches += p->choice.rung != before;
}

/* Lets time pass until the next answer is here, but not beyond `until`. Returns whether it is. */
static int wait_for_answer(player* p, double until) {
  const request r = p->requests[0];
  size_t i;
  void* data;
  if (p->num_requests == 0 || r.last_byte > until) {
    if (until > p->clock) p->clock = until;
    return 0;
  }
  if (r.last_byte > p->clock) p->clock = r.last_byte;
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
  if (p->failure == L4D_OK && p->rate != NULL) {
    p->failure = l4d_rate_add_transfer(p->rate, r.sent, r.first_byte, r.last_byte, r.end - r.begin);
  }
  return 1;
}

/* Whether the picture of `time` can be shown as a rung has it. A real player passes arrays. */
static int show(player* p, double time, uint32_t rung) {
  l4d_splat_buffers splats;
  l4d_status status;
  if (p->failure != L4D_OK) return 1; /* ends all waiting */
  l4d_splat_buffers_init(&splats);
  l4d_decoder_set_layers(p->decoder, p->rungs[rung].max_level, p->rungs[rung].max_tier);
  l4d_decoder_set_detail(p->decoder, p->rungs[rung].detail);
  status = l4d_decoder_slice(p->decoder, time, &splats);
  if (status != L4D_OK && status != L4D_ERR_NEED_DATA) p->failure = status;
  return status != L4D_ERR_NEED_DATA;
}

/* Waits for the picture of `time` as a rung has it. Returns the seconds that it takes. */
static double wait_for_picture(player* p, double time, uint32_t rung) {
  const double start = p->clock;
  p->choice.rung = p->choice.fill_rung = rung;
  while (!show(p, time, rung)) {
    request_missing(p, time, 0);
    if (p->num_requests == 0 && p->failure == L4D_OK) p->failure = L4D_ERR_INTERNAL;
    wait_for_answer(p, 1e300);
  }
  return p->clock - start;
}

/* Waits until the lowest rung is here from `time` on for long enough to start. */
static double wait_for_buffer(player* p, double time) {
  const double start = p->clock;
  l4d_rung_state state = {0, 0};
  p->choice.rung = p->choice.fill_rung = 0;
  cancel(p, 0, L4D_RANGE_DETAIL);
  while (p->failure == L4D_OK && state.buffered < kStartSeconds) {
    request_missing(p, time, kStartSeconds);
    wait_for_answer(p, 1e300);
    if (p->failure == L4D_OK) {
      p->failure =
          l4d_decoder_get_rung_state(p->decoder, time, kStartSeconds, &p->rungs[0], &state);
    }
    if (state.missing_bytes == 0) break;
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
  double due, stalled = 0, time = begin;
  int stalls = 0, frame;
  p->switches = 0;
  wait_for_buffer(p, time);
  due = p->clock;
  for (frame = 0; time < begin + seconds && p->failure == L4D_OK; ++frame) {
    if (frame % kFramesPerChoice == 0) choose_rung(p, time);
    do request_missing(p, time, kAheadSeconds);
    while (wait_for_answer(p, due));
    if (!show(p, time, p->choice.rung) && !show(p, time, 0)) {
      ++stalls;
      stalled += wait_for_buffer(p, time);
      due = p->clock;
    }
    due += kFrameSeconds;
    time += kFrameSeconds;
  }
  report(p, "a second of playback", seconds, p->clock - start);
  printf("%-24s %6d stalls %34.2f s\n", "", stalls, stalled);
  printf("%-24s %6lu, at the end rung %lu of %lu\n", "changes of the rung",
         (unsigned long)p->switches, (unsigned long)p->choice.rung + 1,
         (unsigned long)p->num_rungs);
}

static void seek_around(player* p, double begin, double duration, int seeks) {
  double seconds = 0;
  int i;
  for (i = 0; i < seeks; ++i) {
    const double time = begin + duration * (((7 * i) % seeks) + 0.5) / seeks;
    p->num_requests = 0; /* what is under way is cancelled */
    p->link_free = p->clock;
    seconds += wait_for_picture(p, time, 0);
  }
  if (seeks > 0) report(p, "a seek", seeks, seconds);
}

/* Waits for the headers, which say what rungs there are. */
static void open_stream(player* p, l4d_info* info) {
  p->num_rungs = 1;
  p->rungs[0].max_tier = p->rungs[0].max_level = UINT32_MAX;
  l4d_rate_choice_init(&p->choice);
  p->choice.merge_gap = 16 << 10;
  p->failure = l4d_decoder_open_supplied(p->decoder, p->file_bytes);
  while (p->failure == L4D_OK) {
    p->failure = l4d_decoder_get_info(p->decoder, info);
    if (p->failure != L4D_ERR_NEED_DATA) break;
    p->failure = L4D_OK;
    request_missing(p, 0, 0); /* the headers, whatever the time */
    wait_for_answer(p, 1e300);
  }
  if (p->failure == L4D_OK) {
    p->failure = l4d_decoder_get_rungs(p->decoder, p->rungs, MAX_RUNGS, &p->num_rungs);
  }
  if (p->num_rungs > MAX_RUNGS) p->num_rungs = MAX_RUNGS; /* the encoder makes 9 at most */
  if (p->failure == L4D_OK) p->failure = l4d_rate_create(NULL, p->num_rungs, &p->rate);
}

static void run(player* p, double play_seconds, int seeks) {
  l4d_info info;
  l4d_info_init(&info);
  open_stream(p, &info);
  wait_for_picture(p, info.timeline.time_begin, 0);
  report(p, "first picture, rung 1", 1, p->clock);
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
  l4d_rate_destroy(p.rate);
  l4d_decoder_destroy(p.decoder);
  fclose(p.file);
  return p.failure == L4D_OK ? 0 : 1;
}
