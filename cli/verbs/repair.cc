// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <exception>
#include <memory>
#include <set>

#include "cli/member_file.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"

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
  Json incomplete = Json::array();  // of `kept`
  size_t num_kept = 0;
  size_t num_incomplete = 0;
  size_t num_dropped = 0;
};

// Copies every member of which all bytes are right. Those that need a member which is left out show
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
    const size_t needed = m.needs.size();
    m.needs.erase(std::remove_if(m.needs.begin(), m.needs.end(),
                                 [&](uint32_t need) { return gone.count(need) != 0; }),
                  m.needs.end());
    l4d_member_parameters p = parameters_of(m);
    p.stream = file.info().stream;
    l4d_reader reader;
    l4d_reader_init(&reader);
    l4d_status status = file.find_reader(i, &reader);
    if (status == L4D_OK) status = writer.add(reader, p);
    if (status != L4D_OK && !is_damage(status)) {
      throw Failure(status, name + ": member " + std::to_string(m.member.number) + ": " +
                                l4d_last_error_message());
    }
    if (status == L4D_OK) {
      out.kept.push_back(m.member.number);
      ++out.num_kept;
      if (m.needs.size() == needed) continue;
      out.incomplete.push_back(m.member.number);
      ++out.num_incomplete;
      continue;
    }
    const std::string why = l4d_last_error_message();
    gone.insert(m.member.number);
    ++out.num_dropped;
    out.dropped.push_back(
        {{"number", m.member.number}, {"offset", m.member.offset}, {"reason", why}});
    context.note("member " + std::to_string(m.member.number) + " is left out: " + why);
  }
  if (out.num_incomplete > 0) {
    context.note(format_items(out.num_incomplete, "member") +
                 " that needed what is left out will show the rest: " + out.incomplete.dump());
  }
  return out;
}

Outcome run_repair(Context& context, const RepairArguments& arguments) {
  const Input input(context, arguments.input);
  check_extension(arguments.output, "--output", {".l4d"});
  Output output(context, arguments.output);
  const std::unique_ptr<MemberFile> found = find_members(context, input);
  const MemberFile& file = *found;
  note_signature(context, input, file);
  MemberWriter writer(context);
  const Repaired repaired = copy_members(context, input.name(), file, writer);
  if (repaired.num_kept == 0) {
    throw Failure(L4D_ERR_CORRUPT, input.name() + ": no member is whole");
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
                  {"incomplete", repaired.incomplete},
                  {"rest", file.rest().empty() ? Json() : Json(file.rest())},
                  {"rest_bytes", lost},
                  {"file_bytes", bytes}};
  const std::string left = repaired.num_dropped == 0
                               ? std::string()
                               : ", " + std::to_string(repaired.num_dropped) + " left out";
  outcome.text = format("%s: %s kept%s, %s\n", arguments.output.c_str(),
                        format_items(repaired.num_kept, "member").c_str(), left.c_str(),
                        format_bytes(bytes).c_str());
  if (!file.rest().empty()) {
    outcome.text += format_count(lost) + " bytes behind are lost: " + file.rest() + "\n";
  }
  return outcome;
}

}  // namespace

void add_repair(Registry& registry) {
  auto arguments = std::make_shared<RepairArguments>();
  Verb* verb = add_verb(registry, "repair", "Keep the whole members of a file, and write its index",
                        [arguments](Context& context) { return run_repair(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to repair, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output, "File to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  verb->footer(
      "For recordings that broke off, or that still grow: every member of which all bytes are\n"
      "right is kept, without those that it needs if these are damaged. The input stays as it is.\n"
      "Exit code: 0 where a member is kept, whatever is left out (`dropped`, `incomplete` and\n"
      "`rest_bytes` of --json); 4 where none is whole.");
}

}  // namespace l4d::cli
