// SPDX-License-Identifier: Apache-2.0
#include "cli/input/sequence.h"

#include <cmath>
#include <cstring>

#include "cli/command/values.h"
#include "cli/input/scene_source.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr size_t kMaxFrames = L4D_MAX_FRAMES;

}  // namespace

std::optional<NumberedName> NumberedName::parse(const std::string& name) {
  try {
    return NumberedName(name, "");
  } catch (const Failure&) {
    return std::nullopt;
  }
}

void NumberedName::refuse(const std::string& name) {
  if (!parse(name)) return;
  throw usage_error("--time is one instant, and '" + name + "' the name of a sequence");
}

NumberedName::NumberedName(const std::string& pattern, const std::string& example) {
  std::string* part = &before_;
  size_t fields = 0;
  for (size_t i = 0; i < pattern.size(); ++i) {
    if (pattern[i] != '%') {
      *part += pattern[i];
      continue;
    }
    if (pattern.compare(i, 2, "%%") == 0) {
      *part += '%';
      ++i;
      continue;
    }
    size_t end = i + 1;
    while (end < pattern.size() && pattern[end] >= '0' && pattern[end] <= '9') ++end;
    const std::string digits = pattern.substr(i + 1, end - i - 1);
    if (end == pattern.size() || pattern[end] != 'd' || digits.size() > 2 || ++fields > 1) {
      fields = 0;
      break;
    }
    if (!digits.empty()) width_ = static_cast<size_t>(std::stoi(digits));
    part = &after_;
    i = end;
  }
  if (fields != 1) {
    throw usage_error("a sequence needs an output name with one %d in it, as " + example);
  }
}

std::string NumberedName::operator()(size_t number) const {
  std::string digits = std::to_string(number);
  if (digits.size() < width_) digits.insert(0, width_ - digits.size(), '0');
  return before_ + digits + after_;
}

std::string NumberedName::glob_pattern() const {
  std::string pattern;
  for (const std::string* part : {&before_, &after_}) {
    for (const char c : *part) {
      if (std::strchr("*?[]\\", c) != nullptr) pattern += '\\';
      pattern += c;
    }
    if (part == &before_) pattern += '*';
  }
  return pattern;
}

std::string NumberedName::digits_in(const std::string& name) const {
  if (name.size() <= before_.size() + after_.size()) return "";
  const std::string digits =
      name.substr(before_.size(), name.size() - before_.size() - after_.size());
  return digits.find_first_not_of("0123456789") == std::string::npos ? digits : "";
}

void add_sequence_options(Verb* verb, SequenceArguments& arguments) {
  auto* time = verb->add_option("--time", arguments.time, "One instant: 2.5, 1:30")->type_name("T");
  auto* from = verb->add_option("--from", arguments.from, "Sequence from here (default: start)")
                   ->type_name("T");
  auto* to =
      verb->add_option("--to", arguments.to, "... to before here (default: end)")->type_name("T");
  auto* fps = verb->add_option("--fps", arguments.fps, "Frames per second (default: the scene's)")
                  ->type_name("F");
  time->excludes(from)->excludes(to)->excludes(fps);
}

void check_order(const std::string& from, const std::string& to, bool may_be_equal) {
  if (from.empty() || to.empty()) return;
  const double begin = parse_seconds(from, "--from");
  const double end = parse_seconds(to, "--to");
  if (end < begin) throw usage_error("--to lies before --from");
  if (end == begin && !may_be_equal) throw usage_error("--to must lie after --from");
}

void SequenceArguments::check() const {
  if (!time.empty()) parse_seconds(time, "--time");
  if (!from.empty()) parse_seconds(from, "--from");
  if (!to.empty()) parse_seconds(to, "--to");
  check_order(from, to, false);
  if (!fps.empty()) parse_fps(fps, "--fps");
}

double sequence_fps(const SequenceArguments& arguments, const l4d_timeline& timeline) {
  return arguments.fps.empty() ? frames_per_second(timeline) : parse_fps(arguments.fps, "--fps");
}

std::vector<double> instants(Context& context, const SequenceArguments& arguments,
                             const l4d_timeline& timeline) {
  const auto seconds = [&](const std::string& text, const char* option, double otherwise) {
    return text.empty() ? otherwise
                        : clamp_to_sequence(context, timeline, parse_seconds(text, option), option);
  };
  if (!arguments.time.empty()) return {seconds(arguments.time, "--time", 0)};
  const double begin = timeline.time_begin;
  const double from = seconds(arguments.from, "--from", begin);
  const double to = seconds(arguments.to, "--to", begin + io::duration(timeline));
  const double fps = sequence_fps(arguments, timeline);
  if (!(to > from)) throw usage_error("--from and --to leave nothing of the sequence");
  // A frame that starts within rounding of the end is past it.
  const double count = std::ceil((to - from) * fps - 1e-6);
  if (count > static_cast<double>(kMaxFrames)) {
    throw usage_error(
        format("%.0f frames; a sequence has at most %zu: --from, --to and --fps choose", count,
               kMaxFrames));
  }
  std::vector<double> times;
  for (size_t k = 0; k < static_cast<size_t>(count); ++k) {
    times.push_back(from + static_cast<double>(k) / fps);
  }
  return times;
}

}  // namespace l4d::cli
