// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/base/threads.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace l4d {
namespace {

// Every element once, in pieces whose ends do not depend on the number of threads.
TEST(ParallelFor, CutsWorkBySizeAlone) {
  for (const size_t count : {0u, 1u, 2u, 63u, 64u, 65u, 640u, 1000u}) {
    for (const size_t grain : {0u, 1u, 7u, 64u, 1000u, 4096u}) {
      for (const int threads : {1, 2, 3, 8}) {
        SCOPED_TRACE(std::to_string(count) + " by " + std::to_string(grain) + ", " +
                     std::to_string(threads) + " threads");
        const size_t piece = std::max<size_t>(grain, 1);
        std::vector<int> visits(count, 0);
        std::vector<size_t> ends((count + piece - 1) / piece, 0);
        parallel_for(threads, count, grain, [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) ++visits[i];
          ASSERT_EQ(begin % piece, 0u);
          ends[begin / piece] = end;
        });
        EXPECT_EQ(visits, std::vector<int>(count, 1));
        for (size_t p = 0; p < ends.size(); ++p) {
          EXPECT_EQ(ends[p], std::min(count, (p + 1) * piece));
        }
      }
    }
  }
}

// The first one in the order of the pieces, also where another thread was faster to fail.
TEST(ParallelFor, TheFirstFailureComesOutWhenAllHasEnded) {
  for (const int threads : {1, 2, 8}) {
    std::atomic<int> done{0};
    std::atomic<bool> has_failed{false};
    std::string what;
    try {
      parallel_for(threads, 100, 1, [&](size_t begin, size_t) {
        if (begin == 37) {
          for (int k = 0; k < 1000 && threads > 1 && !has_failed; ++k) {
            std::this_thread::sleep_for(std::chrono::milliseconds(2));
          }
          throw std::runtime_error("37");
        }
        if (begin == 38) {
          has_failed = true;
          throw std::runtime_error("38");
        }
        ++done;
      });
    } catch (const std::runtime_error& error) {
      what = error.what();
    }
    EXPECT_EQ(what, "37") << threads;
    if (threads > 1) {
      EXPECT_EQ(done, 98);
    }
  }
}

}  // namespace
}  // namespace l4d
