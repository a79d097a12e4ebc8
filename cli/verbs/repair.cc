// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <exception>
#include <memory>
#include <set>

#include "cli/command/progress.h"
#include "cli/input/member_file.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "l4d/experimental/copy.h"

namespace l4d::cli {
namespace {

struct RepairArguments {
  std::string input;
  std::string output;
};

bool is_damage(l4d_status status) {
  return status == L4D_ERR_TRUNCATED || status == L4D_ERR_CORRUPT || status == L4D_ERR_CHECKSUM;
}

// By the headers of all; or by the index, which also finds what lies behind a damaged header.
std::unique_ptr<MemberFile> find_members(const Context& context, const Input& input) {
  std::unique_ptr<MemberFile> walked;
  std::exception_ptr why;
  try {
    walked = std::make_unique<MemberFile>(context, input, true);
    if (walked->info().rest == L4D_OK) return walked;
  } catch (const Failure&) {
    why = std::current_exception();
  }
  try {
    auto listed = std::make_unique<MemberFile>(context, input);
    if (listed->info().from_index != 0) return listed;
  } catch (const Failure&) {
    // No index: what the headers say is all there is.
  }
  if (!walked) std::rethrow_exception(why);
  return walked;
}

struct Repaired {
  Json kept = Json::array();
  Json dropped = Json::array();
  Json partial = Json::array();     // of `kept`
  Json incomplete = Json::array();  // likewise
  size_t num_kept = 0;
  size_t num_dropped = 0;
  size_t num_partial = 0;
  size_t num_incomplete = 0;
};

enum class Kept { kWhole, kInPart, kNot };

// Copies a member, and if it or its copy is wrong, the pages that are right. Keeps a copy if it
// decodes and breaks no rule. *why: what is wrong.
Kept copy_member(const std::string& name, const MemberFile& file, size_t index,
                 const l4d_member_parameters& parameters, MemberWriter& writer, std::string* why) {
  const auto is_right = [&](l4d_status status) {
    if (status == L4D_OK) return true;
    if (why->empty()) *why = l4d_last_error_message();
    if (is_damage(status)) return false;
    throw Failure(status, name + ": member " + std::to_string(parameters.number) + ": " +
                              l4d_last_error_message());
  };
  l4d_reader reader = L4D_INIT(l4d_reader);
  if (!is_right(file.find_reader(index, &reader))) return Kept::kNot;
  for (const bool tolerant : {false, true}) {
    if (!is_right(writer.add(reader, parameters, tolerant))) continue;
    // Right checksums say nothing of what a broken writer put under them.
    std::string broken;
    if (writer.prove_last(&broken)) return tolerant ? Kept::kInPart : Kept::kWhole;
    if (why->empty()) *why = broken;
  }
  return Kept::kNot;
}

// Copies every member of which pages are right. Those that need a member which is left out show
// less: they no longer need it.
Repaired copy_members(Context& context, const std::string& name, const MemberFile& file,
                      MemberWriter& writer) {
  Repaired out;
  std::set<uint32_t> gone;
  Progress progress(context, "repair");
  for (size_t i = 0; i < file.members().size(); ++i) {
    progress.update(i, file.members().size(), "copying");
    MemberInfo m = file.members()[i];
    if (m.is_index()) continue;
    const uint32_t number = m.member.number;
    const size_t needed = m.needs.size();
    m.needs.erase(std::remove_if(m.needs.begin(), m.needs.end(),
                                 [&](uint32_t need) { return gone.count(need) != 0; }),
                  m.needs.end());
    l4d_member_parameters p = parameters_of(m);
    p.stream = file.info().stream;
    std::string why;
    const Kept kept = copy_member(name, file, i, p, writer, &why);
    Json damaged = {{"number", number}, {"offset", m.member.offset}, {"reason", why}};
    if (kept == Kept::kNot) {
      gone.insert(number);
      out.dropped.push_back(damaged);
      ++out.num_dropped;
      context.note("member " + std::to_string(number) + " is left out: " + why);
      continue;
    }
    out.kept.push_back(number);
    ++out.num_kept;
    if (m.needs.size() != needed) {
      out.incomplete.push_back(number);
      ++out.num_incomplete;
    }
    if (kept == Kept::kWhole) continue;
    const uint64_t all = file.num_gaussians(i), left = writer.last_num_gaussians();
    damaged["num_gaussians"] = left;
    damaged["lost_gaussians"] = all - left;
    out.partial.push_back(damaged);
    ++out.num_partial;
    const std::string lost = left == all
                                 ? "SH detail of damaged pages, which show base colours"
                                 : format_count(all - left) + " of its " + format_count(all) +
                                       " Gaussians, which are in damaged pages";
    context.note("member " + std::to_string(number) + " is kept without " + lost + ": " + why);
  }
  if (out.num_incomplete > 0) {
    context.note(format_items(out.num_incomplete, "member") +
                 " that needed what is left out will show the rest: " + out.incomplete.dump());
  }
  return out;
}

Outcome run_repair(Context& context, const RepairArguments& arguments) {
  const Input input(context, arguments.input);
  check_one_file(arguments.output, "--output", {".l4d"});
  Output output(context, arguments.output);
  const std::unique_ptr<MemberFile> found = find_members(context, input);
  const MemberFile& file = *found;
  note_signature(context, input, file);
  MemberWriter writer(context);
  const Repaired repaired = copy_members(context, input.name(), file, writer);
  if (repaired.num_kept == 0) {
    throw Failure(L4D_ERR_CORRUPT, input.name() + ": no member is whole, also none in part");
  }
  writer.add_index();
  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  const uint64_t bytes = writer.finish(output);
  const uint64_t lost = file.rest().empty() ? 0 : input.bytes() - file.info().bytes;
  outcome.json = {{"schema", "l4dcodec.repair/1"},
                  {"input", input.name()},
                  {"output", arguments.output},
                  {"kept", repaired.kept},
                  {"dropped", repaired.dropped},
                  {"partial", repaired.partial},
                  {"incomplete", repaired.incomplete},
                  {"rest", file.rest().empty() ? Json() : Json(file.rest())},
                  {"rest_bytes", lost},
                  {"file_bytes", bytes}};
  const auto counted = [](size_t count, const char* what) {
    return count == 0 ? std::string() : ", " + std::to_string(count) + what;
  };
  outcome.text =
      format("%s: %s kept%s%s, %s\n", arguments.output.c_str(),
             format_items(repaired.num_kept, "member").c_str(),
             counted(repaired.num_partial, " of them in part").c_str(),
             counted(repaired.num_dropped, " left out").c_str(), format_bytes(bytes).c_str());
  if (!file.rest().empty()) {
    outcome.text += format_count(lost) + " bytes behind are lost: " + file.rest() + "\n";
  }
  return outcome;
}

}  // namespace

void add_repair(Registry& registry) {
  auto arguments = std::make_shared<RepairArguments>();
  Verb* verb =
      add_verb(registry, "repair", "Keep what is right of a damaged file, and write its index",
               [arguments](Context& context) { return run_repair(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to repair, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output, "File to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  verb->footer(
      "For recordings that broke off, or that still grow: every member is kept, but for pages of\n"
      "which bytes are wrong or whose Gaussians break a rule of the format, and without members\n"
      "that it needs if nothing of these is right. Pages of which only SH detail is wrong are "
      "kept\n"
      "in base colours. What is kept decodes and breaks no rule. The input stays as it is.\n"
      "Exit code: 0 where a member is kept, whatever is left out (`dropped`, `partial`,\n"
      "`incomplete` and `rest_bytes` of --json); 4 where nothing is right.");
}

}  // namespace l4d::cli
