// SPDX-License-Identifier: Apache-2.0
// Runs the checks, or with --bench [substring] times the same calls on every available target.
#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>

#include "tests/kernels/kernel_call.h"

namespace {

using Clock = std::chrono::steady_clock;

// Best of several runs of about two milliseconds, seconds per call.
double time_call(l4d::test::Call& call, const l4d::test::Kernels& kernels) {
  double best = 1e9;
  size_t repeat = 1;
  for (int round = 0; round < 8;) {
    const auto begin = Clock::now();
    for (size_t i = 0; i < repeat; ++i) call.run(kernels);
    const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    if (seconds < 0.002 && repeat < (size_t{1} << 24)) {
      repeat *= 2;
      continue;
    }
    best = std::min(best, seconds / static_cast<double>(repeat));
    ++round;
  }
  return best;
}

void bench(const std::vector<l4d::test::Operation>& operations, const char* filter) {
  for (const l4d::test::Operation& op : operations) {
    if (std::strstr(op.name, filter) == nullptr) continue;
    l4d::test::CallOptions options;
    options.n = 16384;
    options.seed = 1;
    const auto call = op.make(options);
    const double bytes = static_cast<double>(call->output_bytes());
    const double reference = time_call(*call, l4d::test::reference_kernels());
    std::printf("%-26s %-10s %8.2f GB/s\n", op.name, "reference", bytes / reference * 1e-9);
    for (int64_t rest = HWY_TARGETS; rest != 0; rest &= rest - 1) {
      const int64_t target = rest & -rest;
      hwy::SetSupportedTargetsForTest(0);
      if ((hwy::SupportedTargets() & target) == 0) {
        std::printf("%-26s %-10s  SKIPPED\n", "", hwy::TargetName(target));
        continue;
      }
      hwy::SetSupportedTargetsForTest(target);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      const double simd = time_call(*call, l4d::test::simd_kernels());
      std::printf("%-26s %-10s %8.2f GB/s %7.2f x\n", "", hwy::TargetName(target),
                  bytes / simd * 1e-9, reference / simd);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  if (argc > 1 && std::strcmp(argv[1], "--bench") == 0) {
    const char* filter = argc > 2 ? argv[2] : "";
    std::printf("bytes written per second; 16384 values, all in the cache\n");
    bench(l4d::test::stream_operations(), filter);
    bench(l4d::test::reconstruct_operations(), filter);
    bench(l4d::test::transform_operations(), filter);
    return 0;
  }
  return RUN_ALL_TESTS();
}
