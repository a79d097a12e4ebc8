// SPDX-License-Identifier: Apache-2.0
// A server and the link to it, on a clock that the caller moves: slow, unreliable and sometimes
// wrong, as a seed says.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "decoder/playback/playback.h"
#include "tests/common/random.h"

namespace l4d::playback::test {

// What goes wrong, and until when.
struct Faults {
  double until = 0;        // of the clock; then all is well but for `damage`
  double loss = 0;         // share of requests that never get a byte
  double cut = 0;          // share of answers that end early
  double fail = 0;         // share of answers that break
  double garble = 0;       // share of pieces with a wrong byte: another one each time
  double stall = 0;        // share of answers that stop and never end
  double busy = 0;         // share answered by 429 or 503
  double wrong_range = 0;  // share answered by 206 of other bytes
  double wrong_total = 0;
  bool not_found = false;
  bool forbidden = false;
  double down_from = 1e300, down_until = 1e300;  // nothing is answered
  double sticky_until = 0;  // a cache gives out the same wrong bytes, but for FRESH requests
  uint64_t sticky_at = 0;
  std::vector<uint64_t> damage;  // bytes that are wrong in the file itself
};

struct LinkShape {
  double rate = 1e6;  // bytes a second
  double slow_from = 1e300, slow_until = 1e300, slow_rate = 1e4;
  double delay = 0.05, jitter = 0;
  uint64_t piece = 16 << 10;  // bytes that arrive together, at most
  double burst = 0;           // seconds between two bursts; 0: pieces come as they are sent
  bool ranges = true, totals = true;
};

// What a source is at some time; no bytes: 404.
struct Served {
  std::shared_ptr<const Bytes> bytes;
  uint64_t version = 0;
};

class Content {
 public:
  virtual ~Content() = default;
  virtual Served get(uint32_t source, double now) = 0;
};

// A file, and from some time on another version of it.
class OneFile : public Content {
 public:
  OneFile(const Bytes& file, const Bytes& next_version, double new_version_at)
      : file_(std::make_shared<Bytes>(file)),
        next_(std::make_shared<Bytes>(next_version)),
        new_version_at_(new_version_at) {}
  Served get(uint32_t, double now) override {
    if (now < new_version_at_) return {file_, 1};
    served_new_ = true;
    return {next_, 2};
  }
  bool has_new_version() const { return served_new_; }

 private:
  std::shared_ptr<const Bytes> file_, next_;
  double new_version_at_;
  bool served_new_ = false;
};

class FakeLink {
 public:
  FakeLink(Content& content, const LinkShape& shape, const Faults& faults, uint64_t seed)
      : content_(content), shape_(shape), faults_(faults), random_(seed) {}

  void request(double now, const l4d_playback_item& item);
  void cancel(uint32_t id);
  // All connections are gone.
  void forget() { transfers_.clear(); }
  // When something happens next; infinity: never.
  double next_time() const;
  // Does what is due at `now`: calls the engine once. Returns the id of a request that has ended by
  // that, or 0.
  uint32_t step(double now, Playback* engine);
  uint64_t bytes_sent() const { return bytes_sent_; }

 private:
  struct Transfer {
    uint32_t id = 0;
    uint32_t source = 0, flags = 0;
    Served file;
    uint64_t begin = 0, at = 0, end = 0;
    double when = 0;
    bool answered = false;
    uint32_t status = 206;
    enum { kWhole, kCut, kBreaks, kStalls, kSilent } fate = kWhole;
    uint64_t stop = 0;  // of kCut, kBreaks and kStalls
  };
  void look(double now, Transfer* t);
  double rate_at(double now) const;
  bool is_faulty(double now) const { return now < faults_.until; }
  void answer(double now, Transfer* t, Playback* engine);
  void send(double now, Transfer* t, Playback* engine);
  void schedule(double now, Transfer* t);
  void finish(size_t index, uint32_t outcome, double now, Playback* engine);

  Content& content_;
  LinkShape shape_;
  Faults faults_;
  l4d::test::Random random_;
  std::vector<Transfer> transfers_;
  double free_at_ = 0;
  uint64_t bytes_sent_ = 0;
  Bytes piece_;
};

}  // namespace l4d::playback::test
