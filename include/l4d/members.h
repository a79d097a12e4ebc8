/* SPDX-License-Identifier: Apache-2.0
 * members.h: files that consist of several streams, one after the other (spec section "Members"):
 * what l4dcodec concat and cut write, and recordings that grow while they are played. A file of one
 * stream is a file of one member.
 *
 *   l4d_members_open(&reader, NULL, &members);
 *   uint32_t shown[16]; uint64_t count;
 *   l4d_members_get_shown(members, t, shown, 16, &count);    // the members that show t
 *   for each: l4d_members_get_reader(members, shown[i], &part);
 *             l4d_decoder_open(decoder, &part);              // with options.accept_needs = 1
 *             streams[i].decoder = decoder; streams[i].time = t - member.shift;
 *   l4d_slice_streams(streams, count, &buffers);
 */
#ifndef L4D_MEMBERS_H
#define L4D_MEMBERS_H

#include "l4d/decode.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The list of the members of a file. It belongs to one thread at a time. */
typedef struct l4d_members l4d_members;

/* What a member is; a later version may add others, which a player passes over. */
enum {
  L4D_MEMBER_MEDIA = 0,    /* what is visible in its span, with what it needs */
  L4D_MEMBER_STANDING = 1, /* Gaussians that media members need */
  L4D_MEMBER_INDEX = 2     /* a list of the others; no Gaussians */
};

typedef struct l4d_member {
  size_t struct_size;
  uint64_t offset;      /* of its first byte in the file */
  uint64_t bytes;       /* of the member */
  uint64_t header_hash; /* of its file header; another member has another one */
  double begin, end;    /* seconds of the presentation: it is for begin <= t < end */
  double shift;         /* time in its own sequence is time in the presentation less this */
  uint32_t number;      /* its name in the file; ascends */
  uint32_t role;        /* L4D_MEMBER_* */
  uint32_t num_needs;   /* see l4d_members_get_needs */
  uint32_t reserved;
  /* What it presents, in seconds of its own sequence: begin and end are these plus shift, rounded.
   * Of a list that is from an index they are begin and end less shift, rounded again. */
  double sequence_begin, sequence_end;
} l4d_member;

typedef struct l4d_members_options {
  size_t struct_size;
  uint64_t max_memory_bytes; /* of what is read of one member at a time; 0 = 16 GiB */
  /* 0: the list is that of the index, if the file ends with one, which takes two reads. 1: it is
   * made from the headers of all members, whether there is an index or not. */
  uint32_t ignore_index;
  uint32_t reserved;
} l4d_members_options;

/* Lists the members of the file that `reader` reads. The list is copied; `reader` is copied too and
 * is called as long as `*out` or a reader that it gave is in use. The list ends before the first
 * member that is not all there or breaks a rule: see l4d_members_info. options may be NULL.
 * Fails as l4d_decoder_open does if the first member is not whole; l4d_last_error_message returns
 * the reason. */
L4D_API l4d_status l4d_members_open(const l4d_reader* reader, const l4d_members_options* options,
                                    l4d_members** out);
L4D_API void l4d_members_destroy(l4d_members* members); /* accepts NULL */

typedef struct l4d_members_info {
  size_t struct_size;
  uint64_t count;      /* members in the list, 1 or more */
  uint64_t bytes;      /* of the file up to the end of the last one */
  uint64_t stream;     /* what all have in common; 0 = not stated */
  uint32_t from_index; /* 1: the list is that of the index; the members themselves were not read */
  l4d_status rest;     /* OK, or why the list ends before the file: TRUNCATED, CORRUPT .. */
  const char* rest_message; /* the same in words, "" if OK; lent until `members` is destroyed */
} l4d_members_info;
L4D_API l4d_status l4d_members_get_info(const l4d_members* members, l4d_members_info* info);

/* Member `index`, below l4d_members_info.count, in the order of the file. Fails with
 * INVALID_ARGUMENT if there is no such member. */
L4D_API l4d_status l4d_members_get(const l4d_members* members, uint64_t index, l4d_member* out);
/* The numbers of the standing members that member `index` needs, in ascending order. *count
 * receives how many there are; the first min(capacity, *count) are written to `numbers`, which may
 * be NULL if capacity is 0. */
L4D_API l4d_status l4d_members_get_needs(const l4d_members* members, uint64_t index,
                                         uint32_t* numbers, uint64_t capacity, uint64_t* count);
/* The indices of the members that show the time `time` of the presentation: the media member in
 * whose span it is, or the one whose span is nearest, then the standing members that it needs.
 * Output as that of l4d_members_get_needs. *count is 0 if the file has no media member. Fails with
 * INVALID_ARGUMENT if time is not finite, with TRUNCATED if a member that is needed is not in the
 * file. */
L4D_API l4d_status l4d_members_get_shown(const l4d_members* members, double time, uint32_t* indices,
                                         uint64_t capacity, uint64_t* count);
/* A reader of member `index` alone. Valid until `members` is destroyed. If the list is that of an
 * index, this reads the 40 bytes of the file header of the member, and fails with CHECKSUM if they
 * are not those that the index knows. */
L4D_API l4d_status l4d_members_get_reader(l4d_members* members, uint64_t index, l4d_reader* out);

/* A stream that is shown with others, such as the members of an instant, and the time that it
 * shows, in seconds of its own sequence. */
typedef struct l4d_shown_stream {
  l4d_decoder* decoder;
  double time;
} l4d_shown_stream; /* frozen */
/* Slice `count` streams as one: the Gaussians of stream after stream, each as l4d_decoder_slice
 * returns them. Rows of SH have the highest degree of the streams; in rows
 * of lower degree the other coefficients are 0. Of more than one stream, num_still and still_key
 * are 0, every call writes all Gaussians, and the arrays hold unspecified values if the call fails.
 * Fails with INVALID_ARGUMENT if `count` is 0 or a decoder is listed twice, with BUFFER_TOO_SMALL
 * if the capacity is below the count of all together, and otherwise as a slice of the first stream
 * that fails does. */
L4D_API l4d_status l4d_slice_streams(const l4d_shown_stream* streams, uint64_t count,
                                     l4d_splat_buffers* out);
#ifdef __cplusplus
}
#endif
#endif /* L4D_MEMBERS_H */
