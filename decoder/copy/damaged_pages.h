// SPDX-License-Identifier: Apache-2.0
// What a copy of a damaged stream leaves out.
#pragma once

#include <map>

#include "decoder/expand/page_decoder.h"
#include "decoder/read/plan.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d {

// Calls f(chunk) for each codebook or basis of a component that is coded with some.
template <typename Coding, typename F>
void for_each_table(Coding& coding, const F& f) {
  if (!coding.vq() && !coding.transform()) return;
  for (size_t s = 0; s < coding.num_codebooks(); ++s) f(coding.codebook(s).codebook);
  // A residual codebook is of vq, whose stages are codebooks.
  if (coding.has_rcq) f(coding.rcq.codebook);
}

// Drops the pages that cannot be copied, or whose copies would break a rule: those that do not
// decode, of which a chunk, the codebooks of their block or the tables of their layer are damaged
// or cannot be read, and those whose Gaussians break the rules of check_page_rules. num_gaussians
// of the plan counts the rest; its spans stay. Where the SH chunk alone is wrong, `blanks` gets
// another one for the task with this index, which the record describes, at offset 0. Its page is
// dropped if there is none. Fails as the first of these does if no page is left.
Status drop_damaged(SceneFile& file, PageDecoder& pages, Plan* plan,
                    std::map<size_t, Bytes>* blanks);

// Reads a chunk as it is stored and checks its hash. *bytes aliases the source or `storage`, which
// `charge` counts.
Status read_stored(SceneFile& file, const ChunkRef& chunk, MemoryCharge* charge, Bytes& storage,
                   ByteSpan* bytes);

}  // namespace l4d
