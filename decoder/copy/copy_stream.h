// SPDX-License-Identifier: Apache-2.0
// Copies of streams with other headers, in the streamable layout, and without the pages that an
// edit does not show. Pages are copied as they are; a tolerant copy decodes them to prove them, and
// codes SH chunks in place of damaged ones.
#pragma once

#include <functional>

#include "decoder/read/member_list.h"
#include "l4d/decode.h"
#include "libl4dcodec/container/member.h"

namespace l4d {

// Takes bytes of the copy, in order.
using WriteFn = std::function<Status(ByteSpan)>;

struct CopyRequest {
  bool is_member = false;  // of a file of several
  Member member;
  bool has_edit = false;
  Edit edit;
  uint32_t levels = 0;  // layers of other levels and tiers are left out; 0 = none
  uint32_t tiers = 0;
};

// reader: of the one stream. options: a tolerant copy leaves out damaged pages, or their SH detail.
// Fails with INVALID_ARGUMENT where the request breaks a rule.
Status copy_stream(const l4d_reader& reader, const l4d_decoder_options& options,
                   const CopyRequest& request, const WriteFn& write, uint64_t* bytes);

// An index of the members of a list, which does not end with one, and its footer.
Status make_index(const MemberList& list, Bytes* out);
// A member of a file that shows nothing but what it needs. like: the header of a member that shows
// more, with no layer, or with one that has no Gaussians.
void make_empty_member(const SceneHeader& like, const Member& member, Bytes* out);

}  // namespace l4d
