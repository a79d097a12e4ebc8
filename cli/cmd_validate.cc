// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "cli/common.h"
#include "cli/files.h"
#include "cli/progress.h"
#include "cli/units.h"

namespace l4d::cli {
namespace {

struct ValidateArguments {
  std::string input;
  uint64_t max_errors = 100;
};

struct Found {
  Json errors = Json::array();
  std::string text;
  uint64_t max_errors;
  // Set where this build cannot read the stream, so that there is no telling whether it is valid.
  l4d_status unreadable = L4D_OK;
  std::string unreadable_message;
};

void collect(void* user, const l4d_violation* violation) {
  auto& found = *static_cast<Found*>(user);
  if (violation->status == L4D_ERR_NOT_L4D || violation->status == L4D_ERR_VERSION_UNSUPPORTED ||
      violation->status == L4D_ERR_FEATURE_UNSUPPORTED) {
    found.unreadable = violation->status;
    found.unreadable_message = violation->message;
  }
  if (found.errors.size() >= found.max_errors) return;
  const bool has_offset = violation->offset != UINT64_MAX;
  found.errors.push_back({{"clause", violation->clause},
                          {"offset", has_offset ? Json(violation->offset) : Json()},
                          {"message", violation->message},
                          {"status", l4d_status_name(violation->status)}});
  const std::string clause = *violation->clause == '\0' ? "-" : violation->clause;
  const std::string offset = has_offset ? std::to_string(violation->offset) : "-";
  found.text +=
      format("  %-10s byte %-12s %s\n", clause.c_str(), offset.c_str(), violation->message);
}

Outcome run_validate(Context& context, const ValidateArguments& arguments) {
  const Stopwatch watch;
  const Input input(arguments.input);
  const FileReader reader(input.path());
  const l4d_decoder_options options = context.decoder_options();
  Found found;
  found.max_errors = arguments.max_errors;
  uint64_t violations = 0;
  {
    Progress progress(context, "validate");
    progress.step("checking");
    const l4d_status status = l4d_validate(reader.get(), &options, &collect, &found, &violations);
    if (status != L4D_OK) {
      const std::string detail = found.errors.empty()
                                     ? std::string(l4d_status_description(status))
                                     : found.errors.back()["message"].get<std::string>();
      throw Failure(status, input.name() + ": " + detail);
    }
    if (found.unreadable != L4D_OK && found.unreadable != L4D_ERR_NOT_L4D) {
      throw Failure(found.unreadable, input.name() + ": " + found.unreadable_message);
    }
  }
  check_interrupt();
  const bool valid = violations == 0;

  Outcome outcome;
  outcome.code = valid                        ? kExitOk
                 : found.unreadable == L4D_OK ? kExitNo
                                              : exit_code_of(found.unreadable);
  outcome.json = {
      {"schema", "l4dcodec.validate/1"}, {"input", input.name()},  {"valid", valid},
      {"num_errors", violations},        {"errors", found.errors}, {"file_bytes", input.bytes()},
      {"total_s", watch.seconds()}};
  outcome.text = input.name() + (valid ? ": valid, " + format_bytes(input.bytes()) + "\n"
                                       : ": " + format_count(violations) + " violation" +
                                             (violations == 1 ? "" : "s") + "\n" + found.text);
  if (violations > found.errors.size()) {
    outcome.text +=
        format("  and %s more\n", format_count(violations - found.errors.size()).c_str());
  }
  return outcome;
}

}  // namespace

void add_validate(Registry& registry) {
  auto arguments = std::make_shared<ValidateArguments>();
  CLI::App* verb =
      add_verb(registry, "validate", "Check a stream against every rule of the format",
               [arguments](Context& context) { return run_validate(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to check, '-' = stdin")->required();
  verb->add_option("--max-errors", arguments->max_errors, "Violations to list; all are counted")
      ->type_name("N")
      ->capture_default_str();
  verb->footer(
      "Exit code: 0 valid, 1 violations found, 3 or 4 unreadable, 5 of a version or with a\n"
      "tool that this build does not know. What it prints names the clause of spec/l4d.md.");
}

}  // namespace l4d::cli
