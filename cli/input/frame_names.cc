// SPDX-License-Identifier: Apache-2.0
#include "cli/input/frame_names.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>

#include "cli/text/name_order.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

namespace fs = std::filesystem;

// The last number in a name, and what stands around it.
struct Numbered {
  std::string before, after;
  unsigned long number = 0;
};
std::optional<Numbered> numbered(const std::string& path) {
  constexpr size_t kMostDigits = 9;
  const std::string name = fs::path(path).filename().string();
  size_t end = name.size();
  while (end > 0 && (name[end - 1] < '0' || name[end - 1] > '9')) --end;
  size_t begin = end;
  while (begin > 0 && name[begin - 1] >= '0' && name[begin - 1] <= '9') --begin;
  if (begin == end || end - begin > kMostDigits) return std::nullopt;
  return Numbered{name.substr(0, begin), name.substr(end),
                  std::stoul(name.substr(begin, end - begin))};
}

// A name with a # for each number in it.
std::string kind_of(const std::string& path) {
  std::string kind;
  for (const char c : fs::path(path).filename().string()) {
    const bool is_digit = c >= '0' && c <= '9';
    if (!is_digit || kind.empty() || kind.back() != '#') kind += is_digit ? '#' : c;
  }
  return kind;
}

// Files that may be of another sequence, or of none.
void note_kinds(Context& context, const std::string& folder,
                const std::vector<std::string>& files) {
  if (std::none_of(files.begin(), files.end(), [](const auto& f) { return numbered(f); })) return;
  std::map<std::string, std::string> kinds;
  for (const std::string& file : files) kinds.emplace(kind_of(file), file);
  if (kinds.size() < 2) return;
  context.note(folder + ": its files have names of " + format_count(kinds.size()) + " kinds, as " +
               kinds.begin()->second + " and " + std::next(kinds.begin())->second +
               "; all are taken as frames of one sequence, in the order of their names");
}

// Names of a folder need no numbers; where they have them, frames may be missing.
void note_gaps(Context& context, const std::string& folder, const std::vector<std::string>& files) {
  size_t missing = 0;
  std::string first;
  for (size_t k = 1; k < files.size(); ++k) {
    const auto a = numbered(files[k - 1]), b = numbered(files[k]);
    if (!a || !b || a->before != b->before || a->after != b->after) return;
    if (b->number == a->number) {
      context.note(folder + ": " + files[k - 1] + " and " + files[k] +
                   " have the same number; both are taken as frames");
    }
    if (b->number <= a->number + 1) continue;
    if (missing == 0) first = files[k - 1];
    missing += b->number - a->number - 1;
  }
  if (missing == 0) return;
  context.note(folder + ": the numbers of its files leave out " + format_count(missing) +
               ", first behind " + first + "; the frames follow each other as if they did not");
}

}  // namespace

void order_frames(std::vector<std::string>* files) {
  std::sort(files->begin(), files->end(), name_is_before);
}

void note_frame_names(Context& context, const std::string& where,
                      const std::vector<std::string>& files) {
  note_kinds(context, where, files);
  note_gaps(context, where, files);
}

}  // namespace l4d::cli
