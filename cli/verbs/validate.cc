// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <optional>

#include "cli/command/context.h"
#include "cli/command/levels.h"
#include "cli/command/progress.h"
#include "cli/input/files.h"
#include "cli/input/signature.h"
#include "cli/text/units.h"
#include "cli/verbs/judgement.h"
#include "cli/verbs/verbs.h"

namespace l4d::cli {
namespace {

struct ValidateArguments {
  std::string input;
  uint64_t max_errors = 100;
  std::string profile;
  std::string level;
  std::string key;
};

Claim parse_claim(const ValidateArguments& arguments) {
  Claim claim;
  if (!arguments.profile.empty()) claim.profile = parse_profile(arguments.profile, "--profile");
  if (!arguments.level.empty()) claim.level = parse_level(arguments.level, "--level");
  return claim;
}

// Whether the file has a signature, and of the key of --key; false if it has none.
bool add_signature(const ValidateArguments& arguments, const Input& input,
                   const std::optional<PublicKey>& asked, Outcome* outcome) {
  outcome->json["signature"] = Json();
  if (!has_signatures()) return true;
  const std::optional<FileSignature> found = check_signature(input.path());
  const bool by_asked = found && found->right && asked && found->key == *asked;
  if (found) {
    outcome->json["signature"] = {{"key", key_text(found->key)}, {"right", found->right}};
    if (asked) outcome->json["signature"]["by_key"] = by_asked;
    outcome->text +=
        "signature: " + std::string(found->right ? "of these bytes" : "not of these bytes") +
        ", by key " + key_text(found->key) + "\n";
  }
  if (!asked) return true;
  outcome->text += arguments.key + (by_asked ? ": signed by this key\n"
                                    : !found ? ": not signed\n"
                                             : ": not signed by this key\n");
  return by_asked;
}

Outcome run_validate(Context& context, const ValidateArguments& arguments) {
  const Stopwatch watch;
  const Claim claim = parse_claim(arguments);
  std::optional<PublicKey> key;
  if (!arguments.key.empty()) {
    require_signatures("--key");
    context.files.add_input(arguments.key, "--key");
    key = read_public_key(arguments.key);
  }
  const Input input(context, arguments.input, kTheInput, true);  // states its violations
  const FileReader reader(input.path());
  l4d_decoder_options options = context.decoder_options(1);
  options.accept_needs = 1;
  Found found;
  found.max_errors = arguments.max_errors;
  uint64_t violations = 0;
  {
    Progress progress(context, "validate");
    progress.step("checking");
    const l4d_status status = l4d_validate(reader.get(), &options, &collect, &found, &violations);
    if (status != L4D_OK) {
      throw Failure(status, input.name() + ": " + l4d_last_error_message());
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
  outcome.json["conformance"] = Json();
  // What is broken may have no directory to measure.
  std::optional<Judgement> judgement;
  try {
    const MemberFile file(context, input, true);
    if (file.num_streams() > 1) {
      judgement = judge_members(file, options, claim);
    } else {
      DecoderHandle decoder(&options);
      decoder.open(*reader.get());
      judgement = judge(decoder, claim);
      note_unused(context, input, decoder);
    }
  } catch (const Error&) {
    if (valid) throw;
  } catch (const Failure&) {
    if (valid) throw;
  }
  if (judgement) {
    outcome.json["conformance"] = judgement->json;
    outcome.text += judgement->text;
    if (valid && !judgement->holds) outcome.code = kExitNo;
  }
  const bool by_key = add_signature(arguments, input, key, &outcome);
  if (valid && !by_key) outcome.code = kExitNo;
  return outcome;
}

}  // namespace

void add_validate(Registry& registry) {
  auto arguments = std::make_shared<ValidateArguments>();
  Verb* verb =
      add_verb(registry, "validate", "Check a stream against every rule of the format",
               [arguments](Context& context) { return run_validate(context, *arguments); });
  verb->add_option("input", arguments->input, ".l4d to check, '-' = stdin")->required();
  verb->add_option("--max-errors", arguments->max_errors, "Violations to list; all are counted")
      ->type_name("N")
      ->whole_number(0)
      ->capture_default_str();
  verb->add_option("--profile", arguments->profile,
                   "Also hold the stream against this profile: indexed, main, lossless")
      ->type_name("NAME")
      ->offers(profile_names());
  verb->add_option(
          "--level", arguments->level,
          "Also hold the stream against this conformance level, by number or name: 1 phone,\n"
          "2 headset, 3 laptop, 4 desktop, 5 workstation, 6 studio")
      ->type_name("N")
      ->offers(level_names());
  verb->add_option("--key", arguments->key,
                   "Also demand a signature by this public key, as `keygen` makes it")
      ->type_name("FILE");
  verb->footer(
      "Exit code: 0 valid, and of the profile, level and key asked for, 1 not so, 3 or 4 "
      "unreadable, 5 "
      "of a\n"
      "version or with a tool that this build does not know. What it prints names the clause of\n"
      "spec/l4d.md, whatever the exit code from 0 to 5.");
}

}  // namespace l4d::cli
