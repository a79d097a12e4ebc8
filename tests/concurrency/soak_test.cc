// SPDX-License-Identifier: Apache-2.0
// A long time of random seeks by several threads: what they show stays right, and neither memory
// nor open handles grow. L4D_SOAK_SECONDS says how long; 5 s unless told.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tests/common/random.h"
#include "tests/concurrency/seeks.h"

namespace l4d {
namespace {

using namespace test;
using Clock = std::chrono::steady_clock;

// Resident bytes of this process, 0 where the system does not tell.
uint64_t resident_bytes() {
  std::ifstream file("/proc/self/statm");
  uint64_t total = 0, resident = 0;
  file >> total >> resident;
  return resident * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
}

size_t open_handles() {
  std::error_code error;
  const std::filesystem::directory_iterator begin("/proc/self/fd", error), end;
  return error ? 0 : static_cast<size_t>(std::distance(begin, end));
}

class Soak {
 public:
  explicit Soak(double seconds)
      : seconds_(seconds),
        file_(dynamic_file()),
        shared_(file_.path()),
        seeks_(dynamic_file(), 16) {}

  void run() {
    const Clock::time_point begin = Clock::now();
    std::vector<std::thread> threads;
    for (uint64_t i = 0; i < 3; ++i) threads.emplace_back([this, i] { seek(i); });
    const auto since = [&] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
    // A third of the time, 30 s at most, lets caches and the allocator's pools fill.
    const double warm_up = std::min(30.0, seconds_ / 3);
    while (since() < seconds_) {
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      uint64_t& most = since() < warm_up ? warm_bytes_ : most_bytes_;
      most = std::max(most, resident_bytes());
      size_t& handles = since() < warm_up ? warm_handles_ : most_handles_;
      handles = std::max(handles, open_handles());
    }
    stop_ = true;
    for (std::thread& t : threads) t.join();
  }

  uint64_t made() const { return made_; }
  uint64_t wrong() const { return wrong_; }
  uint64_t warm_bytes() const { return warm_bytes_; }
  uint64_t most_bytes() const { return most_bytes_; }
  size_t warm_handles() const { return warm_handles_; }
  size_t most_handles() const { return most_handles_; }

 private:
  // Now and then a new decoder, of any kind; seeks in between.
  void seek(uint64_t seed) {
    Random random(seed);
    while (!stop_) {
      l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1 + random.below(2));
      o.cache_bytes = random.below(2) == 0 ? 0 : 100000;
      o.tolerant = random.below(2);
      DecoderHandle d(&o);
      if (random.below(2) == 0) {
        d.open_file(file_.path());
      } else {
        d.open(shared_.reader());
      }
      const uint32_t seeks = 1 + random.below(40);
      for (uint32_t k = 0; k < seeks && !stop_; ++k) {
        wrong_ += !seeks_.matches(d, random.below(static_cast<uint32_t>(seeks_.size())));
        ++made_;
      }
    }
  }

  double seconds_;
  TemporaryFile file_;
  SharedReader shared_;
  Seeks seeks_;
  std::atomic<bool> stop_{false};
  std::atomic<uint64_t> made_{0}, wrong_{0};
  uint64_t warm_bytes_ = 0, most_bytes_ = 0;
  size_t warm_handles_ = 0, most_handles_ = 0;
};

TEST(Soak, NeitherMemoryNorHandlesGrow) {
  const char* wanted = std::getenv("L4D_SOAK_SECONDS");
  const double seconds = wanted == nullptr ? 5 : std::strtod(wanted, nullptr);
  ASSERT_GT(seconds, 0.5) << "L4D_SOAK_SECONDS";
  Soak soak(seconds);
  soak.run();
  std::printf(
      "%.0f s, %llu seeks; resident %.1f MB after warming up, then %.1f MB at most; %zu and "
      "%zu open handles\n",
      seconds, static_cast<unsigned long long>(soak.made()),
      static_cast<double>(soak.warm_bytes()) / 1e6, static_cast<double>(soak.most_bytes()) / 1e6,
      soak.warm_handles(), soak.most_handles());
  EXPECT_GT(soak.made(), 0u);
  EXPECT_EQ(soak.wrong(), 0u);
  if (soak.warm_bytes() == 0 || soak.warm_handles() == 0) GTEST_SKIP() << "no /proc/self";
  // Each thread may have one file open at a time, and the sampling itself another.
  EXPECT_LE(soak.most_handles(), soak.warm_handles() + 3);
#ifndef L4D_SANITIZED
  // The pools of the allocator breathe; a leak of one page for each seek would soon be beyond this.
  EXPECT_LE(soak.most_bytes(), soak.warm_bytes() + (uint64_t{4} << 20) + soak.warm_bytes() / 10);
#endif
}

}  // namespace
}  // namespace l4d
