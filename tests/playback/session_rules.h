// SPDX-License-Identifier: Apache-2.0
// What must hold of an engine after every call, whatever its link and its user do.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "decoder/playback/playback.h"
#include "tests/playback/session.h"

namespace l4d::playback::test {

class SessionRules {
 public:
  SessionRules(const Playback& engine, const l4d_playback_options& options)
      : engine_(engine), options_(options) {}

  bool ok() const { return result_.error.empty(); }
  void require(bool holds, const std::string& what) {
    if (!holds && ok()) result_.error = what;
  }
  const SessionResult& result() const { return result_; }

  void after_call(double now);
  // something: a byte, a load or an item came with it.
  void after_update(double now, bool something);
  void take(const l4d_playback_item& item);
  // The user has moved the time.
  void set_moved() { moved_ = true; }
  void request_ended(uint32_t id);
  uint32_t an_ended_request() const { return ended_.empty() ? 0 : *ended_.begin(); }
  uint32_t new_seek();
  // Whether the engine may request what it wants: while it may not, things stay as they are.
  void set_network(bool all) { has_network_ = all; }
  // seeks_end: each of them must have had its event.
  void end(bool seeks_end);

 private:
  void check_time(double now);
  void check_speed();
  void check_memory();
  void check_instant(double now);
  void check_chunk(const Part& part, const Chunk& chunk, double now, double wake_at);
  void take_request(const l4d_playback_item& item);
  const Part* part_of(uint32_t source) const;
  void take_event(const l4d_playback_item& item);
  void mix(uint64_t value) { result_.items_hash = (result_.items_hash ^ value) * 0x100000001b3u; }

  const Playback& engine_;
  l4d_playback_options options_;
  SessionResult result_;
  std::set<uint32_t> open_requests_, ended_;
  uint32_t last_request_ = 0, last_load_ = 0, last_seek_ = 0;
  std::set<uint32_t> open_seeks_;
  // By stream, offset and size: 1 after LOST, 0 after FOUND.
  std::map<std::array<uint64_t, 3>, int> lost_;
  std::set<uint32_t> open_streams_;
  l4d_playback_state last_{};
  bool has_last_ = false, moved_ = false;
  bool has_network_ = true;
  uint64_t idle_updates_ = 0;
  bool is_down_ = false;
};

}  // namespace l4d::playback::test
