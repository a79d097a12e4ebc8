// SPDX-License-Identifier: Apache-2.0
#include <memory>
#include <optional>

#include "cli/common.h"
#include "cli/files.h"
#include "cli/signature.h"
#include "cli/text/levels.h"
#include "cli/text/progress.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

struct ValidateArguments {
  std::string input;
  uint64_t max_errors = 100;
  std::string profile;
  std::string level;
  std::string key;
};

// What a stream is to be held against besides the rules of the format; 0 = nothing.
struct Claim {
  uint32_t profile = 0;
  uint32_t level = 0;
};

Claim parse_claim(const ValidateArguments& arguments) {
  Claim claim;
  if (!arguments.profile.empty()) claim.profile = parse_profile(arguments.profile, "--profile");
  if (!arguments.level.empty()) claim.level = parse_level(arguments.level, "--level");
  return claim;
}

struct Found {
  Json errors = Json::array();
  std::string text;
  uint64_t max_errors;
  // Set where this build cannot read the stream, so that there is no telling what else is wrong.
  l4d_status unreadable = L4D_OK;
};

void collect(void* user, const l4d_violation* violation) {
  auto& found = *static_cast<Found*>(user);
  if (violation->status == L4D_ERR_NOT_L4D || violation->status == L4D_ERR_VERSION_UNSUPPORTED ||
      violation->status == L4D_ERR_FEATURE_UNSUPPORTED) {
    found.unreadable = violation->status;
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

// What a stream asks of a player, and whether that is what was claimed.
struct Judgement {
  Json json;
  std::string text;
  bool holds = true;
};

Judgement judge(const DecoderHandle& decoder, const Claim& claim) {
  const l4d_info info = decoder.info();
  l4d_stream_demand c;
  l4d_stream_demand_init(&c);
  // Once for what the stream keeps to, then for the link of the level in question.
  decoder.check(l4d_decoder_get_stream_demand(decoder.get(), &c));
  const uint32_t level = claim.level != 0                                  ? claim.level
                         : info.level != 0 && info.level <= L4D_NUM_LEVELS ? info.level
                         : c.level != 0                                    ? c.level
                                                                           : L4D_NUM_LEVELS;
  const l4d_level_limits limits = limits_of_level(level, c.profile);
  c.bytes_per_second = limits.bytes_per_second;
  c.burst_bytes = limits.burst_bytes;
  c.burst_symbols = limits.instant_symbols;
  decoder.check(l4d_decoder_get_stream_demand(decoder.get(), &c));

  Found found;
  found.max_errors = UINT64_MAX;
  uint64_t violations = 0;
  decoder.check(l4d_decoder_check_conformance(decoder.get(), claim.profile, claim.level, &collect,
                                              &found, &violations));
  Judgement out;
  out.holds = violations == 0;
  const auto quantity = [&](const char* name, uint64_t value, uint64_t limit,
                            std::optional<double> time, const Json& more = Json::object()) {
    Json q = {{"name", name}, {"value", value}, {"limit", limit}, {"holds", value <= limit}};
    if (time) q["time"] = *time;
    q.update(more);
    out.json["quantities"].push_back(q);
    const std::string when = time ? "  at " + format_time(*time) + " s" : "";
    out.text +=
        format("  %-18s %16s of %16s%s%s\n", name, format_count(value).c_str(),
               format_count(limit).c_str(), when.c_str(), value <= limit ? "" : "  too many");
  };
  const auto name_or_null = [](uint32_t profile) {
    return profile == 0 ? Json() : Json(profile_text(profile));
  };
  out.json = {{"declared_profile", name_or_null(info.profile)},
              {"declared_level", info.level},
              {"profile", name_or_null(c.profile)},
              {"level", c.level},
              {"requested_profile", name_or_null(claim.profile)},
              {"requested_level", claim.level},
              {"holds", out.holds},
              {"violations", found.errors},
              {"limits_of_level", level},
              {"quantities", Json::array()}};
  out.text = "declares profile " + profile_text(info.profile) + ", level " +
             level_text(info.level) + "; keeps to profile " + profile_text(c.profile) + ", level " +
             level_text(c.level) + "\n";
  if (claim.profile != 0 || claim.level != 0) {
    out.text += "claimed:";
    if (claim.profile != 0) out.text += " profile " + profile_text(claim.profile);
    if (claim.level != 0) out.text += " level " + level_text(claim.level);
    out.text += out.holds ? ": holds\n" : ": does not hold\n" + found.text;
  }
  out.text += "limits of level " + level_text(level) + "\n";
  quantity("instant_gaussians", c.instant_gaussians, limits.instant_gaussians,
           c.instant_gaussians_time);
  quantity("table_bytes", c.table_bytes, limits.table_bytes, {});
  quantity("instant_bytes", c.instant_bytes, limits.instant_bytes, c.instant_bytes_time);
  quantity("start_bytes", c.start_bytes, limits.start_bytes, {});
  quantity("burst_bytes", c.min_burst_bytes, limits.burst_bytes, c.window_begin,
           {{"time_end", c.window_end}, {"bytes_per_second", c.bytes_per_second}});
  quantity("memory_bytes", c.memory_bytes, limits.memory_bytes, c.memory_time);
  quantity("instant_symbols", c.instant_symbols, limits.instant_symbols, c.instant_symbols_time);
  // No rate is enough where an instant alone is too much, which the line above says.
  if (c.min_symbols_per_second != UINT64_MAX) {
    quantity("symbols_per_second", c.min_symbols_per_second, limits.symbols_per_second, {},
             {{"burst_symbols", c.burst_symbols}});
  }
  out.json["min_bytes_per_second"] =
      c.min_bytes_per_second == UINT64_MAX ? Json() : Json(c.min_bytes_per_second);
  return out;
}

// Whether the file is signed, and by the key that was asked for; false where it is not.
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
  const Input input(context, arguments.input);
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
    DecoderHandle decoder(&options);
    decoder.open(*reader.get());
    judgement = judge(decoder, claim);
  } catch (const Error&) {
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
