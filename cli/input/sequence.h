// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "cli/command/context.h"

namespace l4d::cli {

// A name with one %d or %0Nd in it: "out_%04d.ply". "%%" is a percent sign.
class NumberedName {
 public:
  // Throws a usage error that gives `example` where the pattern is none.
  NumberedName(const std::string& pattern, const std::string& example);
  // Nothing where the name is no such pattern.
  static std::optional<NumberedName> parse(const std::string& name);
  std::string operator()(size_t number) const;
  // A pattern as glob() takes it, of any name that begins and ends as these.
  std::string glob_pattern() const;
  // What such a name has in the place of the number: digits, else "".
  std::string digits_in(const std::string& name) const;
  // Usage error where `name` is such a pattern, since it is to name one file.
  static void refuse(const std::string& name);

 private:
  std::string before_, after_;
  size_t width_ = 0;
};

// Instants as text: one, or a sequence [from, to) at a rate.
struct SequenceArguments {
  std::string time, from, to, fps;
  // Usage errors that need no scene.
  void check() const;
  bool is_range() const { return !from.empty() || !to.empty() || !fps.empty(); }
};
void add_sequence_options(Verb* verb, SequenceArguments& arguments);

// Usage error where one time lies after the other, as they are given: limited to the sequence, both
// may be its end.
void check_order(const std::string& from, const std::string& to, bool may_be_equal);

double sequence_fps(const SequenceArguments& arguments, const l4d_timeline& timeline);
// The one instant where --time is given, else from + k / fps in [from, to); the end of a sequence
// is no frame of it.
std::vector<double> instants(Context& context, const SequenceArguments& arguments,
                             const l4d_timeline& timeline);

}  // namespace l4d::cli
