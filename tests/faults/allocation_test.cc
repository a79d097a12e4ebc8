// SPDX-License-Identifier: Apache-2.0
// Memory that runs out at any allocation: an error, nothing leaks, and the handle goes on working.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <functional>

#include "l4d/experimental/parameters.h"
#include "tests/faults/decoder_calls.h"
#include "tests/faults/failing_new.h"

namespace l4d {
namespace {

using namespace test;

l4d_counters counters(l4d_decoder* d) {
  l4d_counters c = L4D_INIT(l4d_counters);
  EXPECT_EQ(l4d_decoder_get_counters(d, &c), L4D_OK);
  return c;
}

// Which allocations fail: one, or all from one on, which leaves no memory to report the failure
// with.
enum class Fault { kOne, kAllFrom };
uint64_t last_of(Fault fault, uint64_t k) {
  return fault == Fault::kOne ? k : AllocationFaults::kNever;
}

struct Tally {
  uint64_t allocations = 0, refused = 0, survived = 0;
};

// Fails every allocation of one call, on a fresh decoder each time.
Tally fail_each_allocation(DecoderCalls& calls, Call call, uint32_t threads, Fault fault) {
  const l4d_reader reader = memory_reader(calls.file());
  Tally tally;
  uint64_t held = 0;
  {
    const DecoderHandle d = calls.opened(reader, threads);
    AllocationFaults count;
    EXPECT_EQ(calls.make(call, d.get(), reader), L4D_OK);
    count.stop();
    tally.allocations = count.count();
    EXPECT_EQ(calls.make(call, d.get(), reader), L4D_OK);
    held = counters(d.get()).memory_bytes;
  }
  for (uint64_t k = 1; k <= tally.allocations; ++k) {
    const int64_t live = live_allocations();
    {
      const DecoderHandle d = calls.opened(reader, threads);
      l4d_status status;
      uint64_t failed = 0;
      {
        AllocationFaults faults(k, last_of(fault, k));
        status = calls.make(call, d.get(), reader);
        faults.stop();
        failed = faults.failed();
      }
      // Threads share out work differently each time, so that a run may need fewer allocations.
      EXPECT_TRUE(failed > 0 || threads > 1) << "allocation " << k;
      if (status == L4D_OK) {
        EXPECT_TRUE(calls.right(call)) << "allocation " << k;
        tally.survived += failed > 0;
      } else {
        EXPECT_EQ(status, L4D_ERR_OUT_OF_MEMORY) << "allocation " << k;
        ++tally.refused;
      }
      EXPECT_EQ(calls.make(call, d.get(), reader), L4D_OK) << "allocation " << k;
      EXPECT_TRUE(calls.right(call)) << "allocation " << k;
      // Whatever was charged for the failed call has been given back.
      EXPECT_EQ(counters(d.get()).memory_bytes, held) << "allocation " << k;
    }
    EXPECT_EQ(live_allocations(), live) << "allocation " << k;
    if (testing::Test::HasFailure()) break;
  }
  return tally;
}

struct Case {
  const char* name;
  const Bytes& (*bytes)();
  uint32_t threads;
};

class DecoderAllocations : public testing::TestWithParam<Case> {};

TEST_P(DecoderAllocations, EachCallSurvivesEachFailure) {
  const Case& c = GetParam();
  DecoderCalls calls(c.bytes());
  for (const Call call : kCalls) {
    SCOPED_TRACE(name_of(call));
    const Tally one = fail_each_allocation(calls, call, c.threads, Fault::kOne);
    std::printf("%-12s %-12s %u threads: %llu allocations, %llu refused, %llu went on without\n",
                c.name, name_of(call), c.threads, static_cast<unsigned long long>(one.allocations),
                static_cast<unsigned long long>(one.refused),
                static_cast<unsigned long long>(one.survived));
    EXPECT_GT(one.refused, 0u);
    fail_each_allocation(calls, call, c.threads, Fault::kAllFrom);
    if (HasFailure()) return;
  }
}

// A stream of several pages, so that there is something for threads to share.
const Bytes& paged_file() {
  static const Bytes kBytes = [] {
    SceneOptions s;
    s.count = 400;
    s.sh_degree = 1;
    s.num_frames = 8;
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 8});
    o.settings.push_back({L4D_ENC_PAGE_SIZE, 64});
    return encode(make_scene(s), o).bytes;
  }();
  return kBytes;
}

INSTANTIATE_TEST_SUITE_P(Streams, DecoderAllocations,
                         testing::Values(Case{"tiny", tiny_file, 1}, Case{"paged", paged_file, 1},
                                         Case{"threads", paged_file, 3}),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(DecoderAllocation, CreatingFailsCleanly) {
  for (uint64_t k = 1;; ++k) {
    const int64_t live = live_allocations();
    l4d_decoder* d = nullptr;
    AllocationFaults faults(k, k);
    const l4d_status status = l4d_decoder_create(nullptr, &d);
    faults.stop();
    l4d_decoder_destroy(d);
    EXPECT_EQ(live_allocations(), live);
    if (faults.failed() == 0) {
      EXPECT_EQ(status, L4D_OK);
      EXPECT_GT(k, 1u);
      return;
    }
    EXPECT_EQ(status, L4D_ERR_OUT_OF_MEMORY);
    EXPECT_EQ(d, nullptr);
  }
}

TEST(DecoderAllocation, OpeningFilesFailsCleanly) {
  const std::string path = temporary_path(".l4d");
  std::FILE* f = std::fopen(path.c_str(), "wb");
  ASSERT_NE(f, nullptr);
  ASSERT_EQ(std::fwrite(tiny_file().data(), 1, tiny_file().size(), f), tiny_file().size());
  std::fclose(f);
  const DecoderHandle d;
  for (uint64_t k = 1;; ++k) {
    AllocationFaults faults(k, k);
    const l4d_status status = l4d_decoder_open_file(d.get(), path.c_str());
    faults.stop();
    if (faults.failed() == 0) {
      EXPECT_EQ(status, L4D_OK);
      break;
    }
    ASSERT_EQ(status, L4D_ERR_OUT_OF_MEMORY) << "allocation " << k;
    ASSERT_EQ(l4d_decoder_open_file(d.get(), path.c_str()), L4D_OK);
  }
  std::remove(path.c_str());
}

TEST(ValidateAllocation, EveryFailureIsReported) {
  for (const Bytes* bytes : {&tiny_file(), &paged_file()}) {
    const l4d_reader reader = memory_reader(*bytes);
    l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    uint64_t violations = 0, k = 1;
    for (;; ++k) {
      const int64_t live = live_allocations();
      AllocationFaults faults(k, k);
      const l4d_status status = l4d_validate(&reader, &o, nullptr, nullptr, &violations);
      faults.stop();
      ASSERT_EQ(live_allocations(), live) << "allocation " << k;
      EXPECT_EQ(violations, 0u) << "allocation " << k;
      if (faults.failed() == 0) {
        EXPECT_EQ(status, L4D_OK);
        break;
      }
      ASSERT_TRUE(status == L4D_OK || status == L4D_ERR_OUT_OF_MEMORY) << "allocation " << k;
    }
    std::printf("validate: %llu allocations\n", static_cast<unsigned long long>(k - 1));
  }
}

}  // namespace
}  // namespace l4d
