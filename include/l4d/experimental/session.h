/* SPDX-License-Identifier: Apache-2.0
 * experimental/session.h: encoding a scene, or a scene that is still captured, as a file of several
 * streams (members.h). Such a file is appended to; what was written never changes, and plays
 * meanwhile. Experimental: it may change with each version of the library.
 *
 *   l4d_session_create(encoder, NULL, &session);
 *   for each piece of the scene:
 *     l4d_encoder_set_scene(encoder, &gaussians, &timeline, NULL);   // and weights
 *     l4d_session_add(session);
 *     for (;;) {
 *       l4d_member member = L4D_INIT(l4d_member);
 *       status = l4d_session_encode(session, &writer, &member);
 *       if (status != L4D_OK || member.bytes == 0) break;
 *       fsync(file);               // the member is whole
 *     }
 *   l4d_write_member_index(members, &writer, NULL);   // once the scene has ended
 *   l4d_session_destroy(session);
 */
#ifndef L4D_EXPERIMENTAL_SESSION_H
#define L4D_EXPERIMENTAL_SESSION_H

#include "l4d/encode.h"
#include "l4d/experimental/copy.h"

#ifdef __cplusplus
extern "C" {
#endif

/* It belongs to one thread at a time. */
typedef struct l4d_session l4d_session;

typedef struct l4d_session_options {
  size_t struct_size;
  /* Of a media member; 0 = 2. Rounded to frames of the piece. The last one of a piece may be
   * shorter, and is longer where less than half a segment would be left over and its seconds still
   * round to those of a segment, or to one. */
  double segment_seconds;
  double end; /* if has_end: when the presentation ends. What a scene shows later is left out */
  uint64_t stream; /* what all members state to belong together; 0 = made from the first piece */
  /* Gaussians that are visible in this number of consecutive media members or more are in a
   * standing member; 0 = 3. UINT32_MAX: in each of them, there are no standing members. */
  uint32_t standing_segments;
  uint32_t has_end; /* 1: `end` is known */
  /* That the session takes at most for the Gaussians that it keeps from piece to piece; 0 = no
   * limit. What the encoder takes while it encodes a member does not count. */
  uint64_t max_memory_bytes;
} l4d_session_options;

/* Makes a session that codes with the parameters of `encoder`, which it borrows: the encoder
 * outlives it and must not be used for anything else in between. options may be NULL. Fails with
 * INVALID_ARGUMENT if segment_seconds is below 0 or not finite, or end is NaN. */
L4D_API l4d_status l4d_session_create(l4d_encoder* encoder, const l4d_session_options* options,
                                      l4d_session** out);
L4D_API void l4d_session_destroy(l4d_session* session); /* accepts NULL */

/* Takes the scene of the encoder, with its weights, as the next piece of the session. Copies it:
 * the arrays are free afterwards. A piece holds the Gaussians that became known with it, and its
 * timeline says what time it adds to the presentation. Gaussians that are visible after its end
 * live on in later pieces, and those that are visible before its begin are shown from there on.
 * A piece may repeat those that live on, as pieces do that `l4dcodec cut` makes: Gaussians that are
 * the same in both, bit for bit but for positions, which are rounded, are known already. Any other
 * Gaussian is one more.
 * Gaussians of which the opacity is below 1/255 in all of a member are left out of it.
 * Fails with INVALID_STATE if members of the piece before are not encoded yet or no scene is set,
 * with INVALID_ARGUMENT if the piece begins a frame or more before the one before it ends, or has
 * another placement, rendering, SH degree, flags or kinds of weights, with LIMIT_EXCEEDED if the
 * Gaussians of the piece and those that live on take more than max_memory_bytes, and as
 * l4d_encoder_encode does. A piece that begins less than a frame before or after the end of the one
 * before begins there: begins and ends of pieces are rounded to frames. */
L4D_API l4d_status l4d_session_add(l4d_session* session);

/* Adds a piece without Gaussians: the time of `timeline`, in which what became known before lives
 * on. placement may be NULL (identity). Fails as l4d_session_add does. */
L4D_API l4d_status l4d_session_add_empty(l4d_session* session, const l4d_timeline* timeline,
                                         const l4d_placement* placement);

/* Encodes the next member of the piece and passes it to `writer`: standing members before the
 * media members that need them, media members in the order of their spans. member->bytes is 0 if
 * none is left. member->offset counts from the first member of the session.
 * The quality (L4D_ENC_QUALITY) is that of what is shown at an instant, a media member with what it
 * needs: an error costs the same in all members. Its price follows from the first piece, and rises
 * in members that show more.
 * Fails as l4d_encoder_encode does. The member is then still the next. */
L4D_API l4d_status l4d_session_encode(l4d_session* session, const l4d_writer* writer,
                                      l4d_member* member);

#ifdef __cplusplus
}
#endif
#endif /* L4D_EXPERIMENTAL_SESSION_H */
