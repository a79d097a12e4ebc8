// SPDX-License-Identifier: Apache-2.0
// Profiles and conformance levels: what streams of a kind may use and ask for (spec: section 18).
#pragma once

#include <cstdint>
#include <string>

#include "libl4dcodec/container/scene_header.h"

namespace l4d {

// Registry values (spec/registry/profile.json).
enum class ProfileId : uint8_t { kNone = 0, kIndexed = 1, kMain = 2, kLossless = 3 };

constexpr unsigned kNumProfiles = 3;
constexpr unsigned kNumConformanceLevels = 6;

// Null if there is no such id.
const char* profile_name(unsigned profile);

// Why a stream does not keep to a profile, "" where it does.
std::string profile_violation(const SceneHeader& header, ProfileId profile);
// The narrowest profile that a stream keeps to.
ProfileId profile_of(const SceneHeader& header);
// Whether all attributes are held as binary16, scalar codes and codebook indices, which is what
// players can keep as it is: whether the stream keeps to the profile "indexed".
bool has_packed_form(const SceneHeader& header);

// What streams of a level may ask for at most.
struct LevelLimits {
  const char* name;
  uint64_t gaussians;         // of the pages of an instant
  uint64_t table_bytes;       // codebooks and entropy tables, decoded
  uint64_t instant_bytes;     // stored, of the pages of an instant
  uint64_t start_bytes;       // stored, of what is needed before the first instant
  uint64_t bytes_per_second;  // the leaky bucket: rate
  uint64_t burst_bytes;       // and size
  uint64_t memory_bytes;
  uint64_t instant_symbols;     // of rANS, of the pages of an instant
  uint64_t symbols_per_second;  // a leaky bucket of this rate, and as large as an instant
};

// Stored bytes of lossless streams are allowed to be this many times as large.
constexpr uint64_t kLosslessBytes = 8;

// level: 1..kNumConformanceLevels. lossless: whether the stream keeps to that profile.
LevelLimits level_limits(unsigned level, bool lossless);

}  // namespace l4d
