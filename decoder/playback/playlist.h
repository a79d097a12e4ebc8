// SPDX-License-Identifier: Apache-2.0
// Playlists of members (spec: section 20.5). What a playlist says decides on requests and memory,
// so all of it is checked.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "l4d/playback.h"

namespace l4d::playback {

// A member as its playlist has it.
struct Member {
  uint64_t offset = 0, bytes = 0;  // at its URI; bytes 0: all from there on
  double begin = 0, end = 0;       // seconds of the presentation
  double shift = 0;                // time of the presentation less time of the member
  uint32_t number = 0;             // ascends
  uint32_t uri = 0;                // in Playlist::uris
  uint32_t num_needs = 0;
  size_t first_need = 0;  // in Playlist::needs
  bool is_media = true;   // false: it is shown with those that need it
};

struct Playlist {
  std::vector<Member> members;
  std::vector<uint32_t> needs;  // numbers of standing members
  std::vector<std::string> uris;
  uint64_t stream = 0;       // what all members have in common; 0: not stated
  bool is_complete = false;  // nothing is appended any more
  double target_duration = 0;

  // Null where there is none.
  const Member* find(uint32_t number) const;
};

struct PlaylistError {
  uint32_t cause = L4D_CAUSE_NONE;  // PLAYLIST, FEATURE or LIMIT
  uint32_t line = 0;
};

// More than a recording of a day.
constexpr size_t kMaxPlaylistBytes = size_t{1} << 24;

// Without an error, *out is what the text says; else it is not of use.
PlaylistError parse_playlist(const char* text, size_t size, Playlist* out);

// What a later look at a playlist says (PLST-2).
enum class PlaylistChange {
  kNone,
  kGrown,  // it lists more, or is complete now, or has lost its front
  kOlder,  // as a cache may still have it
  kOther   // it is one of another presentation
};
PlaylistChange compare(const Playlist& before, const Playlist& after);

}  // namespace l4d::playback
