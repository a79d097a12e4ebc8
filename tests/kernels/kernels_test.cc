// SPDX-License-Identifier: Apache-2.0
// Reference against SIMD loops, for every SIMD target that is compiled in and that this machine
// has.
#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <iostream>

#include "tests/common/flush_to_zero.h"
#include "tests/kernels/kernel_call.h"

namespace l4d {
namespace {

using test::CallOptions;
using test::Fill;
using test::Operation;

std::vector<int64_t> compiled_targets() {
  std::vector<int64_t> targets;
  for (int64_t rest = HWY_TARGETS; rest != 0; rest &= rest - 1) targets.push_back(rest & -rest);
  return targets;
}

std::vector<Operation> float_operations() {
  std::vector<Operation> all = test::reconstruct_operations();
  const auto& more = test::transform_operations();
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

std::vector<Operation> all_operations() {
  std::vector<Operation> all = test::stream_operations();
  const auto more = float_operations();
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

// Loops of all targets get the same calls: making a call, and what the reference makes of it, takes
// longer than the loops do.
class KernelTest : public testing::Test {
 protected:
  void SetUp() override {
    for (const int64_t target : compiled_targets()) {
      const bool is_here = (hwy::SupportedTargets() & target) != 0;
      if (is_here) targets_.push_back(target);
      std::cout << hwy::TargetName(target) << (is_here ? "" : " is not available on this machine")
                << "\n";
    }
    ASSERT_FALSE(targets_.empty());
  }
  void TearDown() override { choose(0); }

  static void choose(int64_t target) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }

  void compare(const Operation& op, const CallOptions& options) const {
    const auto call = op.make(options);
    const auto want = call->check(test::reference_kernels());
    for (const int64_t target : targets_) {
      choose(target);
      const auto got = call->check(test::simd_kernels());
      ASSERT_EQ(want.size(), got.size());
      if (want == got) continue;
      size_t at = 0;
      while (want[at] == got[at]) ++at;
      FAIL() << hwy::TargetName(target) << ", " << op.name << " (" << options.text() << "): byte "
             << at << " of " << want.size() << ", canaries included";
    }
  }

  std::vector<int64_t> targets_;  // that this machine has
};

// 0, 1, and everything about one and two vectors of up to 64 bytes.
TEST_F(KernelTest, EveryShortLength) {
  for (const Operation& op : all_operations()) {
    for (size_t n = 0; n <= 70; ++n) {
      for (const Fill fill : test::kFills) {
        CallOptions options;
        options.n = n;
        options.fill = fill;
        options.offset = n % 5;
        options.past_cache = n % 2 == 0;
        options.seed = n;
        compare(op, options);
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST_F(KernelTest, EveryOffset) {
  for (const Operation& op : all_operations()) {
    for (size_t offset = 0; offset < 20; ++offset) {
      for (const bool past_cache : {false, true}) {
        CallOptions options;
        options.n = 131;
        options.offset = offset;
        options.past_cache = past_cache;
        options.seed = 1000 + offset;
        compare(op, options);
        if (HasFatalFailure()) return;
      }
    }
  }
}

TEST_F(KernelTest, LongInputs) {
  for (const Operation& op : all_operations()) {
    for (const Fill fill : test::kFills) {
      for (const size_t n : {size_t{4095}, size_t{10000}}) {
        CallOptions options;
        options.n = n;
        options.fill = fill;
        options.past_cache = true;
        options.seed = n;
        compare(op, options);
        if (HasFatalFailure()) return;
      }
    }
  }
}

// A host may run with subnormals flushed: what a stream can hold must not care.
TEST_F(KernelTest, FlushToZeroChangesNothing) {
  if (!test::FlushToZero::kAvailable) GTEST_SKIP() << "no flush-to-zero on this architecture";
  for (const Operation& op : float_operations()) {
    for (const Fill fill : test::kFills) {
      CallOptions options;
      options.n = 3000;
      options.fill = fill;
      options.seed = 77;
      const auto call = op.make(options);
      const auto want = call->check(test::reference_kernels());
      std::vector<unsigned char> reference;
      {
        [[maybe_unused]] const test::FlushToZero flush;
        reference = call->check(test::reference_kernels());
      }
      ASSERT_EQ(want, reference) << op.name << " (" << options.text() << "), reference";
      for (const int64_t target : targets_) {
        choose(target);
        std::vector<unsigned char> simd;
        {
          [[maybe_unused]] const test::FlushToZero flush;
          simd = call->check(test::simd_kernels());
        }
        ASSERT_EQ(want, simd) << op.name << " (" << options.text() << "), "
                              << hwy::TargetName(target);
      }
    }
  }
}

// The checks above mean something only if a wrong result is seen: a call on damaged input differs.
TEST(KernelCall, ChecksSeeCanariesAndResults) {
  test::Guarded<uint16_t> out(5, 3);
  const uint16_t content[5] = {1, 2, 3, 4, 5};
  out.reset(content);
  const auto before = out.all();
  EXPECT_EQ(reinterpret_cast<uintptr_t>(out.data()) % 64, 6u);
  out.data()[5] = static_cast<uint16_t>(out.data()[5] + 1);  // one past the end
  EXPECT_NE(out.all(), before);
  out.reset(content);
  EXPECT_EQ(out.all(), before);
  for (const Operation& op : all_operations()) {
    CallOptions a;
    a.n = 64;
    a.seed = 1;
    CallOptions b = a;
    b.seed = 2;
    EXPECT_NE(op.make(a)->check(test::reference_kernels()),
              op.make(b)->check(test::reference_kernels()))
        << op.name;
  }
}

}  // namespace
}  // namespace l4d
