// SPDX-License-Identifier: Apache-2.0
// One session of a player: an engine, a link that a seed makes, and a user. After every call, what
// must always hold is checked.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "l4d/l4d.hpp"
#include "tests/playback/fake_link.h"

namespace l4d::playback::test {

struct SessionResult {
  std::string error;        // what did not hold; empty: all did
  uint64_t items_hash = 0;  // of everything that the engine asked for
  uint64_t shown = 0, replaced = 0, failed = 0;
  uint64_t opened = 0, jumps = 0, restarts = 0;  // of members and playlists
  uint64_t waits = 0, requests = 0, retries = 0, lost = 0, found = 0, downs = 0, slices = 0;
  double received = 0, wasted = 0;
};

struct SessionFiles {
  std::vector<const Bytes*> files;  // any number; one is chosen, another one is its next version
};

// The session of a seed.
SessionResult run_session(const SessionFiles& files, uint64_t seed);

}  // namespace l4d::playback::test
