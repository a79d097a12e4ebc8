// SPDX-License-Identifier: Apache-2.0
// The rate controller over simulated links, and what it says of single cases.
#include "decoder/playback/rate_control.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <vector>

#include "tests/common/random.h"

namespace l4d {
namespace {

using test::Random;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kAhead = 6;  // seconds that are planned

class Rate {
 public:
  explicit Rate(uint32_t num_rungs, double start_throughput = 0)
      : control_({kAhead, 2 * kAhead / 3, start_throughput}, num_rungs) {}

  void add(double sent, double first, double last, uint64_t bytes) {
    control_.add(sent, first, last, bytes);
  }
  RateChoice choose(const std::vector<RungState>& states) {
    RateChoice choice;
    EXPECT_EQ(states.size(), control_.num_rungs());
    control_.choose(states.data(), &choice);
    return choice;
  }

 private:
  RateControl control_;
};

// ---- simulated links ----------------------------------------------------------------------------

// What a rung adds to those below it.
struct RungCost {
  double once;        // bytes, before any of its pictures
  double per_second;  // bytes
};
// 0.5 MB at first and 100 kB/s in the lowest rung; 300 kB/s in the highest.
const std::vector<RungCost> kLadder = {{5e5, 1e5}, {5e5, 5e4}, {1e6, 5e4}, {5e5, 1e5}};
constexpr double kRoundTrip = 0.05;
constexpr double kPart = 0.5;  // seconds of playback in one request

// A player of an endless stream: it fetches one part of one rung at a time, the most urgent first.
class Simulation {
 public:
  // capacity: bytes per second at a time.
  explicit Simulation(std::function<double(double)> capacity)
      : capacity_(std::move(capacity)), once_(kLadder.size()), parts_(kLadder.size()) {}

  void run(double seconds) {
    for (; clock_ < seconds; clock_ += kStep) {
      std::vector<RungState> states;
      for (uint32_t r = 0; r < kLadder.size(); ++r) states.push_back(state(r));
      const RateChoice choice = rate_.choose(states);
      if (choice.rung != rung_) ++switches_;
      rung_ = choice.rung;
      if (busy_ && choice.cancel == RateCancel::kAllButBase && item_.rung > 0) busy_ = false;
      if (!busy_) fetch(choice);
      if (busy_) transfer();
      play(states);
    }
  }
  void forget() { switches_ = 0, stalled_ = 0; }
  uint32_t rung() const { return rung_; }
  int switches() const { return switches_; }
  double stalled() const { return stalled_; }
  double started() const { return started_; }

 private:
  static constexpr double kStep = 0.02;
  struct Item {
    uint32_t rung;
    int part;  // -1: what is needed once
  };

  RungState state(uint32_t rung) const {
    double missing = 0, until = kInfinity;
    const int first = static_cast<int>(media_ / kPart);
    const int end = static_cast<int>((media_ + kAhead) / kPart);
    for (uint32_t r = 0; r <= rung; ++r) {
      if (!once_[r]) missing += kLadder[r].once, until = media_;
      for (int p = first; p < end; ++p) {
        if (parts_[r].count(p) > 0) continue;
        missing += kLadder[r].per_second * kPart;
        until = std::min(until, std::max(p * kPart, media_));
      }
    }
    return {std::min(until, media_ + kAhead) - media_, static_cast<uint64_t>(missing)};
  }
  // What is most urgent of a rung.
  bool find(uint32_t rung, Item* item) const {
    for (uint32_t r = 0; r <= rung; ++r) {
      if (!once_[r]) return *item = {r, -1}, true;
    }
    const int first = static_cast<int>(media_ / kPart);
    for (int p = first; p < static_cast<int>((media_ + kAhead) / kPart); ++p) {
      for (uint32_t r = 0; r <= rung; ++r) {
        if (parts_[r].count(p) == 0) return *item = {r, p}, true;
      }
    }
    return false;
  }
  void fetch(const RateChoice& choice) {
    if (!find(choice.rung, &item_) && !find(choice.fill_rung, &item_)) return;
    const RungCost& cost = kLadder[item_.rung];
    // While one answer arrives the next request is under way.
    const bool follows = clock_ - ended_ < 1.5 * kStep;
    busy_ = true;
    sent_ = follows ? clock_ - kRoundTrip : clock_;
    left_ = total_ = item_.part < 0 ? cost.once : cost.per_second * kPart;
  }
  void transfer() {
    if (clock_ < sent_ + kRoundTrip) return;
    left_ -= capacity_(clock_) * kStep;
    if (left_ > 0) return;
    rate_.add(sent_, sent_ + kRoundTrip, clock_ + kStep, static_cast<uint64_t>(total_));
    busy_ = false;
    ended_ = clock_;
    if (item_.part < 0) {
      once_[item_.rung] = true;
    } else {
      parts_[item_.rung].insert(item_.part);
    }
  }
  void play(const std::vector<RungState>& states) {
    if (states[0].buffered > 0) {
      media_ += kStep;
      if (started_ < 0) started_ = clock_;
    } else if (started_ >= 0) {
      stalled_ += kStep;
    }
  }

  std::function<double(double)> capacity_;
  Rate rate_{static_cast<uint32_t>(kLadder.size())};
  double clock_ = 0, media_ = 0, started_ = -1, stalled_ = 0;
  uint32_t rung_ = 0;
  int switches_ = 0;
  std::vector<bool> once_;
  std::vector<std::set<int>> parts_;
  bool busy_ = false;
  Item item_{};
  double sent_ = 0, ended_ = -1, left_ = 0, total_ = 0;
};

TEST(RateOverLinks, SteadyAndFast) {
  Simulation s([](double) { return 6e5; });
  s.run(30);
  EXPECT_EQ(s.rung(), 3u);
  EXPECT_LT(s.started(), 1.2);
  EXPECT_EQ(s.stalled(), 0);
  EXPECT_EQ(s.switches(), 3);
  s.forget();
  s.run(120);
  EXPECT_EQ(s.switches(), 0);
  EXPECT_EQ(s.stalled(), 0);
}

// 200 kB/s carry 160 kB/s by the rule, so the second rung of 150 kB/s.
TEST(RateOverLinks, SteadyAndSlow) {
  Simulation s([](double) { return 2e5; });
  s.run(90);
  EXPECT_EQ(s.stalled(), 0);
  EXPECT_GE(s.rung(), 1u);
  s.forget();
  s.run(300);
  EXPECT_EQ(s.stalled(), 0);
  EXPECT_LE(s.switches(), 8);
}

TEST(RateOverLinks, StepDown) {
  Simulation s([](double t) { return t < 40 ? 6e5 : 1.6e5; });
  s.run(40);
  EXPECT_EQ(s.rung(), 3u);
  s.run(60);
  EXPECT_LT(s.rung(), 3u);
  s.run(120);
  EXPECT_EQ(s.stalled(), 0);
}

TEST(RateOverLinks, StepUp) {
  Simulation s([](double t) { return t < 40 ? 1.3e5 : 8e5; });
  s.run(40);
  EXPECT_LT(s.rung(), 3u);
  s.run(60);
  EXPECT_EQ(s.rung(), 3u);
  EXPECT_EQ(s.stalled(), 0);
}

// Half to one and a half of the throughput, anew each half second.
TEST(RateOverLinks, Jitter) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    Random random(seed);
    std::vector<double> factors(1000);
    for (double& f : factors) f = 0.5 + 0.01 * random.below(101);
    Simulation s([&](double t) { return 5e5 * factors[static_cast<size_t>(2 * t)]; });
    s.run(30);
    s.forget();
    s.run(200);
    EXPECT_EQ(s.stalled(), 0) << seed;
    EXPECT_GE(s.rung(), 2u) << seed;
    EXPECT_LE(s.switches(), 20) << seed;
  }
}

// Nothing arrives for four seconds: the buffer holds six.
TEST(RateOverLinks, Outage) {
  Simulation s([](double t) { return t > 30 && t < 34 ? 0.0 : 6e5; });
  s.run(60);
  EXPECT_EQ(s.stalled(), 0);
  EXPECT_EQ(s.rung(), 3u);
}

// ---- single cases -------------------------------------------------------------------------------

TEST(RateChoice, NothingIsKnownAtFirst) {
  Rate rate(3);
  const RateChoice c = rate.choose({{0, 1000}, {0, 2000}, {0, 3000}});
  EXPECT_EQ(c.rung, 0u);
  EXPECT_EQ(c.fill_rung, 0u);
  EXPECT_EQ(c.cancel, RateCancel::kAllButBase);
  EXPECT_EQ(c.throughput, 0);
  EXPECT_EQ(c.round_trip, 0);
  EXPECT_EQ(c.merge_gap, uint64_t{16} << 10);
  EXPECT_EQ(c.max_range_bytes, uint64_t{1} << 20);
}

TEST(RateChoice, UpOneByOneDownAtOnce) {
  Rate rate(4, 1e6);
  // 0.8 MB/s for 4 seconds are 3.2 MB, three quarters of it 2.4 MB.
  EXPECT_EQ(rate.choose({{5, 0}, {5, 100}, {5, 2300000}, {5, 2300000}}).rung, 1u);
  EXPECT_EQ(rate.choose({{5, 0}, {5, 100}, {5, 2500000}, {5, 2500000}}).rung, 1u);
  EXPECT_EQ(rate.choose({{5, 0}, {5, 100}, {5, 2300000}, {5, 3300000}}).rung, 2u);
  EXPECT_EQ(rate.choose({{5, 0}, {5, 100}, {5, 3100000}, {5, 3300000}}).rung, 2u);
  EXPECT_EQ(rate.choose({{5, 0}, {5, 0}, {5, 0}, {5, 2300000}}).rung, 3u);
  EXPECT_EQ(rate.choose({{2, 700000}, {2, 900000}, {2, 900000}, {2, 900000}}).rung, 0u);
  // Not with a short buffer, but at once to what is here.
  EXPECT_EQ(rate.choose({{4, 0}, {4, 1}, {4, 1}, {4, 1}}).rung, 0u);
  EXPECT_EQ(rate.choose({{6, 0}, {6, 0}, {6, 0}, {4, 1000}}).rung, 2u);
}

TEST(RateChoice, WhatIsLeftFillsTheNextRung) {
  Rate rate(2, 1e5);
  const RateChoice c = rate.choose({{6, 0}, {0, 5000000}});
  EXPECT_EQ(c.rung, 0u);
  EXPECT_EQ(c.fill_rung, 1u);
  EXPECT_EQ(c.cancel, RateCancel::kNone);
  EXPECT_EQ(rate.choose({{5, 100}, {0, 5000000}}).fill_rung, 0u);
  EXPECT_EQ(rate.choose({{kInfinity, 0}, {kInfinity, 0}}).fill_rung, 1u);
}

TEST(RateChoice, ShortBuffersCancel) {
  Rate rate(2, 1e6);
  EXPECT_EQ(rate.choose({{6, 0}, {6, 0}}).rung, 1u);
  EXPECT_EQ(rate.choose({{2, 0}, {0.9, 1000}}).cancel, RateCancel::kDetail);
  const RateChoice c = rate.choose({{0.2, 1000}, {0.2, 2000}});
  EXPECT_EQ(c.cancel, RateCancel::kAllButBase);
  EXPECT_EQ(c.rung, 0u);
  // At the end of the sequence little is left to play, and nothing lacks.
  EXPECT_EQ(rate.choose({{0.1, 0}, {0.1, 0}}).cancel, RateCancel::kNone);
}

TEST(RateChoice, MeasuresTheLink) {
  Rate rate(1);
  rate.add(0, 0.1, 1.1, 1000000);
  RateChoice c = rate.choose({{6, 0}});
  EXPECT_NEAR(c.throughput, 1e6, 1);
  EXPECT_NEAR(c.round_trip, 0.1, 1e-9);
  EXPECT_EQ(c.merge_gap, 25000u);
  EXPECT_EQ(c.max_range_bytes, 500000u);
  // Two at the same time share the link; small ones tell the round trip alone.
  rate.add(2, 2.1, 3.1, 500000);
  rate.add(2, 2.1, 3.1, 500000);
  rate.add(4, 4.02, 4.02, 100);
  c = rate.choose({{6, 0}});
  EXPECT_NEAR(c.throughput, 1e6, 100);
  EXPECT_NEAR(c.round_trip, 0.02, 1e-9);
  // The last ones count.
  for (int i = 10; i < 15; ++i) rate.add(i, i + 0.5, i + 1.0, 50000);
  c = rate.choose({{6, 0}});
  EXPECT_NEAR(c.throughput, 1e5, 1);
  EXPECT_EQ(c.max_range_bytes, uint64_t{64} << 10);
  EXPECT_EQ(c.merge_gap, uint64_t{4} << 10);
}

}  // namespace
}  // namespace l4d
