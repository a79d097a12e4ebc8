// SPDX-License-Identifier: Apache-2.0
#include "tests/numerics/formula.h"

#include <gtest/gtest.h>

#include <iostream>

namespace l4d::numerics {
namespace {

// A bound this much above what is observed would let real damage pass.
constexpr double kLoose = 8;

class FormulaTest : public testing::TestWithParam<Formula> {};

TEST_P(FormulaTest, HoldsItsBound) {
  const Formula& f = GetParam();
  const Observed o = f.run();
  std::cout << f.name << ": " << f.error << " at most " << o.worst << " of " << f.bound << ", "
            << o.cases << " cases";
  if (o.naive != kNoNaive) std::cout << "; " << f.naive << ": " << o.naive;
  std::cout << "\n";
  record(f, o);
  EXPECT_GT(o.cases, 0u);
  EXPECT_LE(o.worst, f.bound);
  EXPECT_LE(f.bound, kLoose * o.worst) << "the bound can be tightened";
  // What is no worse than ours is not naive, and the page would not be true.
  if (o.naive != kNoNaive) {
    EXPECT_GT(o.naive, o.worst) << f.naive;
    EXPECT_STRNE(f.naive, "");
  }
}

INSTANTIATE_TEST_SUITE_P(Table, FormulaTest, testing::ValuesIn(formulas()),
                         [](const testing::TestParamInfo<Formula>& f) {
                           return std::string(f.param.name);
                         });

}  // namespace
}  // namespace l4d::numerics
