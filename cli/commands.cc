// SPDX-License-Identifier: Apache-2.0
#include "cli/commands.h"

#include "cli/command/help.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"

namespace l4d::cli {

const std::vector<ExitStatus>& exit_statuses() {
  static const std::vector<ExitStatus> statuses = {
      {kExitOk, "done", "Done."},
      {kExitNo, "the answer is no",
       "The answer is no: validate found violations or a claim that does not hold, a demand of "
       "compare or a target of encode does not hold."},
      {kExitUsage, "usage", "Wrong usage."},
      {kExitIo, "I/O", "Input or output failed, or an output exists."},
      {kExitCorrupt, "corrupt input",
       "The input is damaged, no scene or one of no Gaussian, or holds what cannot be coded."},
      {kExitUnsupported, "valid but unsupported",
       "The input is of a version or with a tool that this build does not know."},
      {kExitLimit, "over a limit",
       "The input needs more than --limit-memory or another limit allows."},
      {kExitRuntime, "runtime", "The machine failed: out of memory; or a defect."},
      {kExitCancelled, "cancelled", "Cancelled by SIGINT, SIGTERM or SIGHUP."}};
  return statuses;
}

CommandLine::CommandLine()
    : app(std::make_unique<CLI::App>("Codec for long dynamic Gaussian-splat scenes", "l4dcodec")),
      registry{app.get(), &context, nullptr, "", {}} {
  app->require_subcommand(0, 1);
  app->formatter(std::make_shared<HelpFormatter>());
  std::string codes = "Exit codes:";
  for (const ExitStatus& status : exit_statuses()) {
    codes +=
        (status.code == kExitOk ? " " : ", ") + std::to_string(status.code) + " " + status.brief;
  }
  app->footer(wrap(codes, 0) + ".\nSee l4dcodec COMMAND --help; l4dcodec --version.");

  add_encode(registry);
  add_decode(registry);
  add_convert(registry);
  add_info(registry);
  add_slice(registry);
  add_render(registry);
  add_validate(registry);
  add_compare(registry);
  add_sensitivity(registry);
  add_synth(registry);
  add_cameras(registry);
  add_concat(registry);
  add_cut(registry);
  add_remux(registry);
  add_repair(registry);
  add_manifest(registry);
  add_sign(registry);
  add_keygen(registry);
  add_serve(registry);
  add_view(registry);
  add_version(registry);
  for (Verb& verb : registry.verbs) add_common_options(&verb, context.options);
}

CommandLine::~CommandLine() = default;

}  // namespace l4d::cli
