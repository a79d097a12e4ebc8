// SPDX-License-Identifier: Apache-2.0
// The text of comparisons of attributes.
#pragma once

#include <string>

#include "cli/text/json.h"
#include "eval/jod/jod.h"
#include "eval/pair/comparison.h"

namespace l4d::cli {

// What to do where a Gaussian's partner is not known.
constexpr char kHowToPair[] =
    "`encode --order FILE` writes it for `compare --order FILE`; `encode --verify` measures at "
    "once";

Json comparison_json(const eval::Comparison& comparison);
std::string comparison_text(const eval::Comparison& comparison);

// "position=0.001", as --max-error takes it. Usage errors: no number, and names that no comparison
// has.
struct ErrorBound {
  std::string name;
  double limit = 0;
};
ErrorBound parse_error_bound(const std::string& text);
// Of --display; "" is the usual one. Usage error: another name.
const eval::JodDisplay* parse_display(const std::string& name);

}  // namespace l4d::cli
