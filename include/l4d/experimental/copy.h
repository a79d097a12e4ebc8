/* SPDX-License-Identifier: Apache-2.0
 * experimental/copy.h: copies of streams, and files of several made of them. Nothing is decoded or
 * encoded. Experimental: it may change with each version of the library.
 */
#ifndef L4D_EXPERIMENTAL_COPY_H
#define L4D_EXPERIMENTAL_COPY_H

#include "l4d/members.h"

#ifdef __cplusplus
extern "C" {
#endif

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
  /* How many temporal levels and tiers are copied, as in l4d_query; 0 = all. Others are left out.
   */
  uint32_t levels;
  uint32_t tiers;
} l4d_member_parameters;

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
#endif /* L4D_EXPERIMENTAL_COPY_H */
