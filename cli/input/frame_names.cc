// SPDX-License-Identifier: Apache-2.0
#include "cli/input/frame_names.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>

#include "cli/command/values.h"
#include "cli/text/name_order.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

namespace fs = std::filesystem;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

size_t begin_of_digits(const std::string& text, size_t end) {
  while (end > 0 && is_digit(text[end - 1])) --end;
  return end;
}

// How the numbers of names are read.
struct Form {
  bool fractions = false, signs = false;
};

// The last number in a name, but for its extension, and what stands around it.
struct Numbered {
  std::string before, after, fraction;
  bool has_minus = false;
  double number = 0;
};
std::optional<Numbered> numbered(const std::string& path, Form form) {
  constexpr size_t kMostDigits = 9;
  std::string stem = path;
  const std::string extension = fs::path(path).extension().string();
  if (extension.find_first_not_of(".0123456789") != std::string::npos) {
    stem.resize(stem.size() - extension.size());
  }
  size_t end = stem.size();
  while (end > 0 && !is_digit(stem[end - 1])) --end;
  size_t begin = begin_of_digits(stem, end), point = end;
  if (form.fractions && begin > 1 && stem[begin - 1] == '.' && is_digit(stem[begin - 2])) {
    const size_t whole = begin_of_digits(stem, begin - 1);
    // Of "1.2.3", which is no decimal fraction, the last part alone.
    const bool is_part = whole > 1 && stem[whole - 1] == '.' && is_digit(stem[whole - 2]);
    if (!is_part) point = begin - 1, begin = whole;
  }
  if (begin == end || end - begin > 2 * kMostDigits || point - begin > kMostDigits) {
    return std::nullopt;
  }
  Numbered name;
  name.number = parse_number(stem.substr(begin, end - begin), path);
  if (point < end) name.fraction = stem.substr(point + 1, end - point - 1);
  name.after = path.substr(end);
  if (form.signs && begin > 0 && stem[begin - 1] == '-') {
    name.has_minus = true;
    name.number = -name.number;
    --begin;
  }
  name.before = stem.substr(0, begin);
  return name;
}

// The numbers of names that differ in nothing else; empty if they do.
std::vector<Numbered> numbers_of(const std::vector<std::string>& files, Form form) {
  std::vector<Numbered> names;
  for (const std::string& file : files) {
    std::optional<Numbered> name = numbered(file, form);
    if (!name) return {};
    const bool is_alike = names.empty() || (name->before == names.front().before &&
                                            name->after == names.front().after);
    if (!is_alike) return {};
    names.push_back(std::move(*name));
  }
  return names;
}

// Whether what stands behind points are fractions. Numbers that count, as in v2.9 and v2.10, grow
// by a digit and end in 0; fractions have one length, or no 0 at their end.
bool are_fractions(const std::vector<Numbered>& names) {
  size_t least = SIZE_MAX, most = 0;
  bool has_last_zero = false;
  for (const Numbered& name : names) {
    least = std::min(least, name.fraction.size());
    most = std::max(most, name.fraction.size());
    has_last_zero |= name.fraction.size() > 1 && name.fraction.back() == '0';
  }
  return most > 0 && (least == most || !has_last_zero);
}

// Whether '-' before numbers is a sign. In frame-1 and frame-2 it separates words: it is a sign if
// other names have none in its place, or if another separator is before it.
bool are_signs(const std::vector<Numbered>& names) {
  const auto has_minus = [](const Numbered& name) { return name.has_minus; };
  if (std::none_of(names.begin(), names.end(), has_minus)) return false;
  const std::string& before = names.front().before;
  return !std::all_of(names.begin(), names.end(), has_minus) || before.empty() ||
         std::string("_=/").find(before.back()) != std::string::npos;
}

Form form_of(const std::vector<std::string>& files) {
  Form form;
  form.fractions = are_fractions(numbers_of(files, {true, true}));
  form.signs = are_signs(numbers_of(files, {form.fractions, true}));
  return form;
}

// A name with a # for each number in it.
std::string kind_of(const std::string& path) {
  std::string kind;
  for (const char c : fs::path(path).filename().string()) {
    if (!is_digit(c) || kind.empty() || kind.back() != '#') kind += is_digit(c) ? '#' : c;
  }
  return kind;
}

// Files that may be of another sequence, or of none.
void note_kinds(Context& context, const std::string& where, const std::vector<std::string>& files) {
  std::map<std::string, std::string> kinds;
  for (const std::string& file : files) kinds.emplace(kind_of(file), file);
  const bool have_numbers = std::any_of(kinds.begin(), kinds.end(), [](const auto& kind) {
    return numbered(fs::path(kind.second).filename().string(), {}).has_value();
  });
  if (kinds.size() < 2 || !have_numbers) return;
  context.note(where + ": its files have names of " + format_count(kinds.size()) + " kinds, as " +
               kinds.begin()->second + " and " + std::next(kinds.begin())->second +
               "; all are taken as frames of one sequence, in the order of their names");
}

// Names need no numbers; where they have them, frames may be missing.
void note_gaps(Context& context, const std::string& where, const std::vector<std::string>& files,
               Form form) {
  double missing = 0;
  std::string first;
  for (size_t k = 1; k < files.size(); ++k) {
    const auto a = numbered(files[k - 1], form), b = numbered(files[k], form);
    if (!a || !b || a->before != b->before || a->after != b->after) return;
    if (b->number == a->number) {
      context.note(where + ": " + files[k - 1] + " and " + files[k] +
                   " have the same number; both are taken as frames");
    }
    if (form.fractions || b->number <= a->number + 1) continue;
    if (missing == 0) first = files[k - 1];
    missing += b->number - a->number - 1;
  }
  if (missing == 0) return;
  context.note(where + ": the numbers of its files leave out " +
               format_count(static_cast<uint64_t>(missing)) + ", first behind " + first +
               "; the frames follow each other as if they did not");
}

// Times that are rounded to few digits differ a little in their steps.
void note_uneven(Context& context, const std::string& where, const std::vector<std::string>& files,
                 Form form) {
  constexpr double kEven = 1.5;
  const std::vector<Numbered> names = numbers_of(files, form);
  double least = HUGE_VAL;
  for (size_t k = 1; k < names.size(); ++k) {
    const double step = names[k].number - names[k - 1].number;
    if (step > 0) least = std::min(least, step);
  }
  for (size_t k = 1; k < names.size(); ++k) {
    if (names[k].number - names[k - 1].number <= kEven * least) continue;
    context.note(where + ": the numbers of its files are not evenly spaced, first behind " +
                 files[k - 1] + "; the frames follow each other as if they were");
    return;
  }
}

}  // namespace

void order_frames(std::vector<std::string>* files) {
  const Form form = form_of(*files);
  std::map<std::string, double> numbers;
  if (form.fractions || form.signs) {
    for (const std::string& file : *files) numbers[file] = numbered(file, form)->number;
  }
  std::sort(files->begin(), files->end(), [&](const std::string& a, const std::string& b) {
    if (numbers.empty() || numbers[a] == numbers[b]) return name_is_before(a, b);
    return numbers[a] < numbers[b];
  });
}

void note_frame_names(Context& context, const std::string& where,
                      const std::vector<std::string>& files) {
  const Form form = form_of(files);
  if (!form.fractions && !form.signs) note_kinds(context, where, files);
  note_gaps(context, where, files, form);
  if (form.fractions) note_uneven(context, where, files, form);
}

void note_listed_order(Context& context, const std::vector<std::string>& files) {
  const std::vector<Numbered> names = numbers_of(files, form_of(files));
  for (size_t k = 1; k < names.size(); ++k) {
    if (names[k].number >= names[k - 1].number) continue;
    context.note("frames follow each other as they are listed, " + files[k - 1] + " before " +
                 files[k] + "; their folder, or the pattern '" + names[k].before + "*" +
                 names[k].after + "' in quotes, gives them in the order of their numbers");
    return;
  }
}

}  // namespace l4d::cli
