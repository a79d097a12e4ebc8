// SPDX-License-Identifier: Apache-2.0
// What playing a file asks for, held against profiles and levels.
#pragma once

#include <string>

#include "cli/command/context.h"
#include "cli/input/member_file.h"

namespace l4d::cli {

// What a stream is compared with besides the rules of the format; 0 = nothing.
struct Claim {
  uint32_t profile = 0;
  uint32_t level = 0;
};

// Violations as l4d_validate and others report them.
struct Found {
  Json errors = Json::array();
  std::string text;
  uint64_t max_errors;
  uint64_t base = 0;  // added to offsets: where the stream is in its file
  // Set where this build cannot read the stream, so that there is no telling what else is wrong.
  l4d_status unreadable = L4D_OK;
};
void collect(void* user, const l4d_violation* violation);

// What a stream asks of a player, and whether that is what was claimed.
struct Judgement {
  Json json;
  std::string text;
  bool holds = true;
  uint32_t profile = 0, level = 0;  // that it keeps to; 0 = none
};

// Of one stream. base: where it is in its file.
Judgement judge(const DecoderHandle& decoder, const Claim& claim, uint64_t base = 0);
// Of a file of several: each member alone, and each media member with those that it needs.
Judgement judge_members(const MemberFile& file, const l4d_decoder_options& options,
                        const Claim& claim);

}  // namespace l4d::cli
