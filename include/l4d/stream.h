/* SPDX-License-Identifier: Apache-2.0
 * stream.h: playing a stream whose bytes arrive while it plays, without threads and callbacks. The
 * caller asks which bytes are wanted next (plan), gets them as it likes, and hands them over
 * (supply). All calls return at once; those that need bytes that are not here fail with NEED_DATA.
 *
 *   l4d_decoder_open_supplied(decoder, size);
 *   for each frame: l4d_decoder_plan(...), request the ranges that are not under way;
 *                   for each answer: l4d_decoder_supply(...);
 *                   l4d_decoder_slice(...): NEED_DATA, or the picture.
 *
 * Slices in base colours (l4d_decoder_set_detail) show the buckets that are cached in full detail
 * in full detail, so that no byte is needed twice.
 *
 * A tolerant decoder does not fail with NEED_DATA once the headers are here: slices hold what is
 * there, and l4d_decoder_get_losses lists the rest with that status.
 */
#ifndef L4D_STREAM_H
#define L4D_STREAM_H

#include "l4d/decode.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Opens a file of `size` bytes, 0 if that is not known, of which no byte is here. Functions that
 * need an open stream fail with NEED_DATA until its headers are supplied. */
L4D_API l4d_status l4d_decoder_open_supplied(l4d_decoder* decoder, uint64_t size);

/* Copies `n` bytes of the file, from `offset` on. Any order and any pieces do; bytes that are here
 * already are skipped. Bytes count against max_memory_bytes until their bucket is in the cache of
 * slices.
 * Bytes are checked where they are used. A chunk that does not match its hash is dropped and
 * planned once more; if it does not match again, it is lost: calls fail with CHECKSUM. Fails with
 * INVALID_ARGUMENT if the bytes lie behind the end of the file, with LIMIT_EXCEEDED if memory does
 * not hold them (some of them may be kept), with INVALID_STATE if the decoder is not open for
 * supplies, and as l4d_decoder_open does as soon as the headers are here and bad. */
L4D_API l4d_status l4d_decoder_supply(l4d_decoder* decoder, uint64_t offset, const void* data,
                                      size_t n);

/* What a planned range holds. */
enum {
  L4D_RANGE_INDEX = 0,  /* headers and directory */
  L4D_RANGE_TABLES = 1, /* codebooks and entropy tables */
  L4D_RANGE_BASE = 2,   /* pages, without their SH chunks */
  L4D_RANGE_DETAIL = 3  /* SH chunks */
};
typedef struct l4d_planned_range {
  uint64_t offset;
  uint64_t size;
  uint64_t useful_bytes; /* what of them is wanted; the rest lies between */
  double needed_at;      /* seconds of the sequence; -infinity: before any picture */
  uint32_t kind;         /* L4D_RANGE_* */
  uint32_t reserved;
} l4d_planned_range; /* frozen */

typedef struct l4d_plan_query {
  size_t struct_size;
  double time;        /* seconds; the instant that is shown, or is shown next */
  double ahead;       /* seconds of playback after it; 0: that instant alone; below 0: backwards */
  uint32_t max_level; /* as in l4d_query; UINT32_MAX (the default) = all */
  uint32_t detail;    /* L4D_DETAIL_*; FULL is the default */
  uint64_t max_bytes; /* the plan ends with the range that reaches this; 0 = no limit */
  uint64_t
      max_range_bytes; /* longer ranges are cut, so that a request can be cancelled; 0 = 1 MiB */
  uint64_t merge_gap;  /* ranges this close become one; the default is 16 KiB */
  uint32_t max_tier;   /* as in l4d_query; UINT32_MAX (the default) = all */
  uint32_t reserved;
} l4d_plan_query;
L4D_API void l4d_plan_query_init_(l4d_plan_query* query, size_t struct_size);
#define l4d_plan_query_init(query) l4d_plan_query_init_((query), sizeof(*(query)))

/* The bytes that slices from `time` on lack, most urgent first: what comes before any picture, then
 * pages of the instant and of the seconds ahead, then their SH chunks. It depends on the query, on
 * what was supplied and on what is cached alone, and waits for nothing. What it cannot know yet it
 * leaves out: call it again after each supply. The first picture takes at most four rounds, a seek
 * one or two. No range left means that all slices of the window succeed.
 * *count is the number of ranges; the first min(capacity, *count) go to `ranges`, which may be NULL
 * where capacity is 0.
 * Fails with INVALID_ARGUMENT if a time is not finite, with INVALID_STATE if the decoder is not
 * open for supplies, and with CHECKSUM if the headers arrived wrong twice. */
L4D_API l4d_status l4d_decoder_plan(l4d_decoder* decoder, const l4d_plan_query* query,
                                    l4d_planned_range* ranges, uint64_t capacity, uint64_t* count);

/* A part of the sequence, [begin, end] in seconds. */
typedef struct l4d_time_span {
  double begin;
  double end;
} l4d_time_span; /* frozen */
/* The parts of the window [time, time + ahead] whose slices lack nothing, in ascending order, as a
 * player shows them on its timeline. max_bytes, max_range_bytes and merge_gap do not count. Output
 * and failures are as those of l4d_decoder_plan. */
L4D_API l4d_status l4d_decoder_get_buffered(l4d_decoder* decoder, const l4d_plan_query* query,
                                            l4d_time_span* spans, uint64_t capacity,
                                            uint64_t* count);

#ifdef __cplusplus
}
#endif

#endif
