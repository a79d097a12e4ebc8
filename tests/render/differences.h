// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

// Numerical derivatives, and what they are compared by.
namespace l4d::render::differences {

// Central differences of sixth order of a function of one number that returns a vector.
template <typename Real, typename Function>
std::vector<Real> derivative(Function f, Real x, Real step) {
  static constexpr int kFactor[3] = {45, -9, 1};
  std::vector<Real> out;
  for (int k = 1; k <= 3; ++k) {
    const std::vector<Real> above = f(x + static_cast<Real>(k) * step);
    const std::vector<Real> below = f(x - static_cast<Real>(k) * step);
    out.resize(above.size(), 0);
    for (size_t i = 0; i < out.size(); ++i) {
      out[i] += static_cast<Real>(kFactor[k - 1]) * (above[i] - below[i]) / (60 * step);
    }
  }
  return out;
}

// The largest relative error per attribute. An attribute of one Gaussian counts as one vector: the
// largest difference is divided by the largest entry.
class Errors {
 public:
  // `noise`: what rounding leaves in the two. Derivatives that stand far above it count as they
  // are; from the difference of others it is taken off.
  void add(const std::string& attribute, const std::vector<double>& analytic,
           const std::vector<double>& numeric, double noise = 0) {
    ASSERT_EQ(analytic.size(), numeric.size());
    double difference = 0, size = 0;
    for (size_t k = 0; k < analytic.size(); ++k) {
      ASSERT_TRUE(std::isfinite(analytic[k]) && std::isfinite(numeric[k])) << attribute;
      difference = std::max(difference, std::fabs(analytic[k] - numeric[k]));
      size = std::max(size, std::max(std::fabs(analytic[k]), std::fabs(numeric[k])));
    }
    Entry& e = entries_[attribute];
    ++e.count;
    if (size <= noise) return;
    const bool telling = 1e-7 * size > noise;
    e.telling += telling;
    e.worst = std::max(e.worst, (telling ? difference : std::max(difference - noise, 0.0)) / size);
  }

  // Prints and records what was found, and holds it against the bound. In brackets: how many
  // derivatives stood far above the noise; every attribute must have some.
  void report(const std::string& name, double bound) const {
    std::ostringstream line;
    line.precision(3);
    for (const auto& [attribute, e] : entries_) {
      line << (line.tellp() > 0 ? ", " : "") << attribute << " " << e.worst << " (" << e.telling
           << ")";
      EXPECT_GT(e.telling, 0u) << name << ", " << attribute;
      EXPECT_LT(e.worst, bound) << name << ", " << attribute;
    }
    std::cout << name << ": largest relative error: " << line.str() << "\n";
    ::testing::Test::RecordProperty("max_relative_error", line.str());
  }

 private:
  struct Entry {
    size_t count = 0, telling = 0;
    double worst = 0;
  };
  std::map<std::string, Entry> entries_;
};

}  // namespace l4d::render::differences
