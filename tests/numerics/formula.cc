// SPDX-License-Identifier: Apache-2.0
#include "tests/numerics/formula.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

namespace l4d::numerics {
namespace {

using Lists = std::vector<std::vector<Formula> (*)()>;

Lists& lists() {
  static Lists all;
  return all;
}

bool& full_flag() {
  static bool on = false;
  return on;
}

nlohmann::ordered_json& document() {
  static nlohmann::ordered_json all = {{"formulas", nlohmann::ordered_json::object()}};
  return all;
}

// JSON has no infinity.
nlohmann::ordered_json number(double v) {
  if (std::isfinite(v)) return v;
  return "inf";
}

}  // namespace

Register::Register(std::vector<Formula> (*list)()) { lists().push_back(list); }

std::vector<Formula> formulas() {
  std::vector<Formula> all;
  for (const auto list : lists()) {
    const std::vector<Formula> some = list();
    all.insert(all.end(), some.begin(), some.end());
  }
  std::sort(all.begin(), all.end(),
            [](const Formula& a, const Formula& b) { return std::string(a.name) < b.name; });
  return all;
}

bool full() { return full_flag(); }
void set_full(bool on) { full_flag() = on; }

void record(const std::string& section, nlohmann::ordered_json value) {
  document()[section] = std::move(value);
}

void record(const Formula& f, const Observed& o) {
  nlohmann::ordered_json entry = {
      {"ours", f.ours},   {"oracle", f.oracle},          {"domain", f.domain},
      {"error", f.error}, {"origin", f.origin},          {"naive", f.naive},
      {"bound", f.bound}, {"observed", number(o.worst)}, {"cases", o.cases}};
  if (o.naive != kNoNaive) entry["observed_naive"] = number(o.naive);
  document()["formulas"][f.name] = std::move(entry);
}

bool write_results(const std::string& path) {
  std::ofstream file(path);
  file << document().dump(1) << "\n";
  file.close();
  return !file.fail();
}

}  // namespace l4d::numerics
