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
 *             l4d_decoder_slice(decoder, t - member.shift, ..);
 *
 * The functions at the end copy streams into files of several; they decode and encode nothing.
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
L4D_API void l4d_member_init_(l4d_member* member, size_t struct_size);
#define l4d_member_init(member) l4d_member_init_((member), sizeof(*(member)))

typedef struct l4d_members_options {
  size_t struct_size;
  uint64_t max_memory_bytes; /* of what is read of one member at a time; 0 = 16 GiB */
  /* 0: the list is that of the index, if the file ends with one, which takes two reads. 1: it is
   * made from the headers of all members, whether there is an index or not. */
  uint32_t ignore_index;
  uint32_t reserved;
} l4d_members_options;
L4D_API void l4d_members_options_init_(l4d_members_options* options, size_t struct_size);
#define l4d_members_options_init(options) l4d_members_options_init_((options), sizeof(*(options)))

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
} l4d_members_info;
L4D_API void l4d_members_info_init_(l4d_members_info* info, size_t struct_size);
#define l4d_members_info_init(info) l4d_members_info_init_((info), sizeof(*(info)))
L4D_API l4d_status l4d_members_get_info(const l4d_members* members, l4d_members_info* info);
/* Returns what l4d_members_info.rest says in words, "" if that is OK. Owned by `members`. */
L4D_API const char* l4d_members_rest_message(const l4d_members* members);

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

/* ---- writing ----------------------------------------------------------------------------------*/

/* What a copied stream says of itself. */
typedef struct l4d_member_parameters {
  size_t struct_size;
  /* 1: it is a member of a file, with the fields up to num_needs. 0: a file of its own. */
  uint32_t is_member;
  uint32_t number; /* above that of the member before it */
  uint32_t role;   /* L4D_MEMBER_MEDIA or _STANDING */
  uint32_t num_needs;
  const uint32_t* needs; /* [num_needs] in ascending order, all below `number`; for MEDIA only */
  double shift;          /* seconds of the presentation less seconds of the sequence */
  uint64_t stream;
  /* 1: of what the stream presents, the copy presents the times from edit_begin to edit_end, in
   * seconds of its sequence. Pages of which nothing is visible then are left out. 0: the copy
   * presents what the stream does. */
  uint32_t has_edit;
  uint32_t reserved;
  double edit_begin;
  double edit_end;
  /* Gaussians of finer temporal levels, and of tiers above this, are left out; UINT32_MAX (the
   * default) = all are copied. */
  uint32_t max_level;
  uint32_t max_tier;
} l4d_member_parameters;
L4D_API void l4d_member_parameters_init_(l4d_member_parameters* parameters, size_t struct_size);
#define l4d_member_parameters_init(parameters) \
  l4d_member_parameters_init_((parameters), sizeof(*(parameters)))

/* Copies a stream to `writer`, in the streamable layout, with what `parameters` say. Pages stay as
 * they are bit by bit, so that slices of the copy are those of the stream; none is decoded.
 * Extensions other than those of members are copied; signatures are not. *bytes, unless NULL,
 * receives the bytes that were written.
 * Fails with INVALID_ARGUMENT if a parameter breaks a rule of the
 * format, with FEATURE_UNSUPPORTED if the stream is of a later minor version (what it adds is
 * lost), IO, and as l4d_decoder_open and l4d_decoder_select do. options may be NULL; only its
 * limits and `tolerant` count. With tolerant = 1, each page is decoded. Pages and directory pages
 * that are damaged or cannot be read, and pages whose Gaussians break a rule, are left out. If only
 * the SH detail of a page is damaged, the copy has another SH chunk for it: its Gaussians show base
 * colours, as near as the tables of the layer can say that. Of streams without base coefficients of
 * SH, such pages are left out. Fails if no page is left, or if headers or SH tables are damaged. */
L4D_API l4d_status l4d_copy_member(const l4d_reader* stream, const l4d_decoder_options* options,
                                   const l4d_member_parameters* parameters,
                                   const l4d_writer* writer, uint64_t* bytes);

/* Writes an index of all members of the list, to be appended to the file. Fails with
 * INVALID_ARGUMENT if the list ends with an index. */
L4D_API l4d_status l4d_write_member_index(const l4d_members* members, const l4d_writer* writer,
                                          uint64_t* bytes);

#ifdef __cplusplus
}
#endif
#endif /* L4D_MEMBERS_H */
