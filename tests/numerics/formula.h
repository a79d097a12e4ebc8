// SPDX-License-Identifier: Apache-2.0
// The table of formulas: what the library computes, what it is compared with, and how far it may be
// off. One test checks every entry; docs/numerics.md is made of the same entries.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace l4d::numerics {

// Unit roundoff of binary32 and binary64.
constexpr double kU32 = 0x1p-24;
constexpr double kU64 = 0x1p-53;
constexpr double kNoNaive = -1;

struct Observed {
  double worst = 0;         // of ours
  double naive = kNoNaive;  // of the naive implementation, on the same cases
  uint64_t cases = 0;

  // NaN counts as infinitely wrong.
  void add(double error) {
    ++cases;
    worst = error <= worst ? worst : std::isnan(error) ? HUGE_VAL : error;
  }
  void add_naive(double error) {
    naive = error <= naive ? naive : std::isnan(error) ? HUGE_VAL : error;
  }
};

struct Formula {
  const char* name;
  const char* ours;
  const char* oracle;
  const char* domain;
  const char* error;   // what is measured, with its unit
  const char* origin;  // where the bound comes from
  const char* naive;   // what a naive implementation does; "" = nothing to compare with
  double bound;        // 0: the result is exact
  Observed (*run)();
};

// All formulas, by name.
std::vector<Formula> formulas();

// Files of formulas name themselves with one of these at namespace scope.
struct Register {
  explicit Register(std::vector<Formula> (*list)());
};

// --full: inputs of 32 bits are tried one by one instead of at a stride.
bool full();
void set_full(bool on);

// What goes into the JSON document beside the formulas, under its own name.
void record(const std::string& section, nlohmann::ordered_json value);
void record(const Formula& formula, const Observed& observed);
// Of all that was recorded; false where it cannot be written.
bool write_results(const std::string& path);

}  // namespace l4d::numerics
