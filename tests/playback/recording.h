// SPDX-License-Identifier: Apache-2.0
// A playlist and its members on a server: complete, or one that a producer appends to, who pauses,
// dies or begins anew.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "tests/playback/fake_link.h"

namespace l4d::playback::test {

struct RecordingShape {
  uint32_t members = 8;                            // media, in all
  uint32_t first = 8;                              // of them, those that are there at 0
  double jitter = 0;                               // seconds that a member may come late
  double pause_from = 1e300, pause_until = 1e300;  // nothing comes
  bool catches_up = false;                         // then what would have comes at once
  double restart_at = 1e300;                       // another recording, at the same place
  bool states_stream = true;
  bool ends = true;            // with its last member
  bool one_file = false;       // members are ranges of one file
  bool standing = false;       // every second member needs one
  uint32_t window = 0;         // media members that are listed at most; 0: all
  double cache_seconds = 0;    // until then, a look may find what was there before
  double gap = 0;              // seconds between two spans, here and there
  std::set<uint32_t> absent;   // media members that the server does not have
  std::set<uint32_t> damaged;  // of which some bytes are wrong
};

class Recording : public Content {
 public:
  // files: of members, by turns.
  Recording(const std::vector<const Bytes*>& files, const RecordingShape& shape, uint64_t seed);
  Served get(uint32_t source, double now) override;

  // From now on all members are listed, and the list is complete.
  void complete(double now) { completed_at_ = std::min(completed_at_, now); }
  // Of a media member, as it is in the presentation.
  struct Segment {
    uint32_t number;
    size_t file;
    double begin, end, shift;
    double at;  // when it is there
    uint64_t offset, bytes;
    bool needs;
  };
  const std::vector<Segment>& segments() const { return segments_; }
  const Bytes& file_of(uint32_t number, double now) const;
  double end(double now) const;
  double target() const { return target_; }
  bool is_complete(double now) const;
  uint64_t total_bytes() const { return whole_->size(); }
  bool has_restarted(double now) const { return now >= shape_.restart_at; }

 private:
  std::string list_at(double now) const;
  size_t num_listed(double now) const;
  const Bytes& content(size_t segment, bool again) const;

  std::vector<const Bytes*> files_;
  RecordingShape shape_;
  l4d::test::Random random_;
  std::vector<Segment> segments_;
  std::vector<std::shared_ptr<const Bytes>> served_;  // by segment, then the standing one
  std::shared_ptr<const Bytes> whole_;
  double target_ = 1, completed_at_ = 1e300;
};

}  // namespace l4d::playback::test
