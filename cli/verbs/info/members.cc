// SPDX-License-Identifier: Apache-2.0
#include <optional>

#include "cli/text/units.h"
#include "cli/verbs/info/parts.h"

namespace l4d::cli {
namespace {

// Gaussians of each member; none of an index, and where the headers of the member are damaged.
using Counts = std::vector<std::optional<uint64_t>>;

std::string member_table(const MemberFile& file, const Counts& gaussians) {
  std::string text = format("\n%-8s %-9s %14s %14s %12s %12s %12s %8s\n", "member", "role",
                            "offset", "bytes", "gaussians", "begin", "end", "needs");
  for (size_t i = 0; i < file.members().size(); ++i) {
    const MemberInfo& m = file.members()[i];
    std::string needs;
    for (const uint32_t n : m.needs) needs += (needs.empty() ? "" : ",") + std::to_string(n);
    const std::string count = gaussians[i] ? format_count(*gaussians[i]) : "-";
    text += format("%-8u %-9s %14s %14s %12s %12s %12s %8s\n", m.member.number,
                   member_role_name(m.member.role), format_count(m.member.offset).c_str(),
                   format_count(m.member.bytes).c_str(), count.c_str(),
                   m.is_index() ? "-" : format_time(m.member.begin).c_str(),
                   m.is_index() ? "-" : format_time(m.member.end).c_str(),
                   needs.empty() ? "-" : needs.c_str());
  }
  return text;
}

std::optional<uint64_t> count_gaussians(const MemberFile& file, size_t index) {
  if (file.members()[index].is_index()) return std::nullopt;
  try {
    return file.num_gaussians(index);
  } catch (const Failure&) {
    return std::nullopt;
  }
}

}  // namespace

// All of a file of several streams, or of one that is not whole; the rest of the report is of the
// first member.
void add_file(const Facts& facts, Outcome& outcome) {
  const MemberFile& file = *facts.file;
  Counts gaussians;
  uint64_t media = 0, sum = 0;
  for (size_t i = 0; i < file.members().size(); ++i) {
    gaussians.push_back(count_gaussians(file, i));
    sum += gaussians[i].value_or(0);
    if (file.members()[i].is_media()) ++media;
  }
  const uint64_t standing = file.num_streams() - media;
  Json& j = outcome.json["file"] = {{"num_media", media},   {"num_standing", standing},
                                    {"begin", nullptr},     {"end", nullptr},
                                    {"num_gaussians", sum}, {"has_index", file.has_index()}};
  std::string span = "no media member yet";
  if (media > 0) {
    j["begin"] = file.begin() + 0.0;
    j["end"] = file.end() + 0.0;
    span = format_time(file.begin()) + " to " + format_time(file.end()) + " s";
  }
  Json& list = outcome.json["members"] = Json::array();
  for (size_t i = 0; i < gaussians.size(); ++i) {
    Json member = file.members()[i].json();
    member["num_gaussians"] = gaussians[i] ? Json(*gaussians[i]) : Json();
    list.push_back(member);
  }
  if (facts.is_part()) {
    outcome.text += format("%s: %s media and %s standing members, %s, %s, %s Gaussians\n",
                           facts.input.name().c_str(), format_count(media).c_str(),
                           format_count(standing).c_str(), span.c_str(),
                           format_bytes(facts.input.bytes()).c_str(), format_count(sum).c_str());
    if (!file.has_index()) outcome.text += "no index: the file may still grow\n";
    outcome.text += member_table(file, gaussians);
  }
  if (file.rest().empty()) return;
  outcome.json["members_rest"] = file.rest();
  outcome.text += "behind the last member: " + file.rest() + "\n";
}

}  // namespace l4d::cli
