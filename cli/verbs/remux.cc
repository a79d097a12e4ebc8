// SPDX-License-Identifier: Apache-2.0
#include "cli/command/detail.h"
#include "cli/command/options.h"
#include "cli/command/progress.h"
#include "cli/input/member_file.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "l4d/experimental/copy.h"

namespace l4d::cli {
namespace {

struct RemuxArguments {
  std::string input;
  std::string output;
  uint32_t max_level = UINT32_MAX;
  uint32_t max_tier = UINT32_MAX;
};

Outcome run_remux(Context& context, const RemuxArguments& arguments) {
  const Input input(context, arguments.input);
  check_one_file(arguments.output, "--output", {".l4d"});
  Output output(context, arguments.output);
  Progress progress(context, "remux");
  const MemberFile file(context, input);
  file.require_whole();
  note_signature(context, input, file);
  MemberWriter writer(context);
  uint32_t copied = 0;
  for (size_t i = 0; i < file.members().size(); ++i) {
    const MemberInfo& m = file.members()[i];
    if (m.is_index()) continue;
    progress.update(i, file.members().size(), "copying");
    l4d_member_parameters p = parameters_of(m);
    p.stream = file.info().stream;
    p.levels = arguments.max_level + 1;  // UINT32_MAX: 0, which is all
    p.tiers = arguments.max_tier + 1;
    if (file.is_plain()) p.is_member = 0;
    const l4d_status status = writer.add(file.reader(i), p);
    if (status != L4D_OK) throw Failure(status, input.name() + ": " + l4d_last_error_message());
    ++copied;
  }
  if (!file.is_plain()) writer.add_index();
  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  const uint64_t bytes = writer.finish(output);
  outcome.json = {{"schema", "l4dcodec.remux/1"}, {"input", input.name()},
                  {"output", arguments.output},   {"num_members", copied},
                  {"input_bytes", input.bytes()}, {"file_bytes", bytes}};
  outcome.text = format("%s: %s of %s\n", arguments.output.c_str(), format_bytes(bytes).c_str(),
                        format_bytes(input.bytes()).c_str());
  return outcome;
}

}  // namespace

void add_remux(Registry& registry) {
  auto arguments = std::make_shared<RemuxArguments>();
  Verb* verb =
      add_verb(registry, "remux", "Copy a file in the streamable layout, without coding it again",
               [arguments](Context& context) { return run_remux(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to copy, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output, "File to write, '-' = stdout")
      ->type_name("FILE")
      ->required();
  verb->add_option("--max-level", arguments->max_level, "Leave out finer temporal levels")
      ->type_name("N")
      ->whole_number(0, 63);
  add_tier_option(verb, arguments->max_tier);
  verb->footer(
      "What players need first comes first in the file. What is copied decodes to the same bits.");
}

}  // namespace l4d::cli
