// SPDX-License-Identifier: Apache-2.0
// What the verbs of the tool do with a stream from a stranger, through the functions that they
// call, under the limits of a session: info, validate, decode and slice (Session), repair, cut,
// concat, remux, compare and render.
#pragma once

#include <string>
#include <vector>

#include "l4d/l4d.hpp"
#include "libl4dcodec/base/bytes.h"

namespace l4d::test {

// What a verb made of a stream.
struct VerbOutcome {
  const char* verb;
  l4d_status status;
  std::string fault;  // "", or what no stream may bring about
};

// A status with which a verb may refuse a stream.
bool is_refusal(l4d_status status);

// All verbs that read a stream, over each member of `file`. first: of chain(), what `concat` puts
// before it. Copies that a verb makes of a sound member break no rule; what repair keeps never
// does, and decodes.
std::vector<VerbOutcome> try_verbs(const Bytes& file, const Bytes& first);

// Members that show one after the other, without an index. Throws Error.
Bytes chain(const std::vector<const Bytes*>& streams);

}  // namespace l4d::test
