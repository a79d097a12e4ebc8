// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/encode/parameters.h"

#include <algorithm>

#include "cli/command/levels.h"
#include "cli/command/values.h"
#include "cli/text/units.h"
#include "eval/target/encoding.h"
#include "l4d/experimental/parameters.h"

namespace l4d::cli {
namespace {

// "1,0.5,0.25"
std::vector<double> parse_list(const std::string& list, const std::string& option) {
  std::vector<double> numbers;
  for (size_t begin = 0; begin <= list.size();) {
    const size_t comma = std::min(list.find(',', begin), list.size());
    numbers.push_back(parse_number(list.substr(begin, comma - begin), option));
    begin = comma + 1;
  }
  return numbers;
}

// name: with or without a component. Throws what the library says of a wrong one.
void set(const EncoderHandle& encoder, const std::string& name, const std::string& text,
         const std::string& option) {
  const std::string alone = name.substr(0, name.find('.'));
  for (const l4d_parameter_info& info : EncoderHandle::parameters()) {
    if (alone != info.name) continue;
    if (info.max_values > 1) {
      const std::vector<double> values = parse_list(text, option);
      return about(option, [&] { encoder.set_list(name, values); });
    }
    // Suffixes make sense for counts only; other values may be negative or fractions.
    const bool counts = info.integer != 0 && !text.empty() && text[0] != '-';
    const double value =
        counts ? static_cast<double>(parse_size(text, option)) : parse_number(text, option);
    return about(option, [&] { encoder.set(name, value); });
  }
  throw usage_error(option + ": `" + alone +
                    "` is no parameter; `l4dcodec encode --help` lists them");
}

// "--codebook sh=4096"
void set_per_component(const EncoderHandle& encoder, const std::string& name,
                       const std::vector<std::string>& texts, const std::string& option) {
  for (const std::string& text : texts) {
    const auto [component, value] = parse_assignment(text, option);
    set(encoder, component == "all" ? name : name + "." + component, value,
        option + " " + component);
  }
}

// "--set page-size=4096", "--set codebook-size.sh=8192"
void set_generic(const EncoderHandle& encoder, const std::string& text) {
  const auto [name, value] = parse_assignment(text, "--set");
  set(encoder, name, value, "--set " + name);
}

std::string describe(const l4d_parameter_info& info) {
  const std::string many = info.max_values > 1 ? format("up to %u of ", info.max_values) : "";
  const std::string unit = info.unit[0] == '\0' ? "" : std::string(" ") + info.unit;
  const std::string initial = info.max_values > 1 ? "" : ", default " + format_number(info.initial);
  return std::string(info.description) + " (" + many + format_number(info.min) + ".." +
         format_number(info.max) + unit + (info.per_component != 0 ? ", by component" : "") +
         initial + ")";
}

}  // namespace

void EncodeParameters::add_options(Verb* verb) {
  const std::string group = "Coding";
  const std::vector<std::string> presets = EncoderHandle::preset_names();
  verb->add_option("--preset", preset, "Where the parameters start; listed below")
      ->type_name("NAME")
      ->one_of(presets)
      ->capture_default_str()
      ->group(group);
  verb->add_option("--quality", quality,
                   "Fidelity in dB to aim at, 20 to 90, in place of the preset's: about what "
                   "renders have where weights are measured from views. Not for paper presets, "
                   "codebooks with --stages, and lossless streams")
      ->type_name("DB")
      ->group(group);
  verb->add_option("-e,--effort", effort,
                   "1 to 9: how hard to try, from a measured front of time against quality "
                   "(docs/accuracy.md), and how many passes --refit has; 7 unless set")
      ->type_name("N")
      ->group(group);
  verb->add_option("--codebook", codebook,
                   "C=K: codebook entries of each stage of component C (sh, scale, rotor-spatial, "
                   "rotor-temporal, all)")
      ->type_name("C=K")
      ->allow_extra_args(false)
      ->group(group);
  verb->add_option("--stages", stages,
                   "C=1,f1,f2..: residual stages of component C, each for this share of the "
                   "Gaussians, up to 8")
      ->type_name("C=1,F..")
      ->allow_extra_args(false)
      ->group(group);
  verb->add_option("--tiers", tiers,
                   "S1,S2..: cut the long-lived Gaussians into tiers by importance, of which the "
                   "first holds the share S1, the first two S2..: players show the first ones "
                   "while the others arrive")
      ->type_name("S,S..")
      ->group(group);
  verb->add_option("--escape-threshold", escape_threshold,
                   "C=W: keep vectors of C with a weight above W unquantised; 0 = never")
      ->type_name("C=W")
      ->allow_extra_args(false)
      ->group(group);
  verb->add_option("--rcq", rcq, "Block codebooks: never, auto (where they pay), always")
      ->type_name("WHEN")
      ->one_of({"never", "auto", "always"})
      ->group(group);
  verb->add_option("--rcq-size", rcq_size, "Entries of a residual codebook, 1..4096")
      ->type_name("N")
      ->group(group);
  verb->add_option("--prune-weight", prune_weight,
                   "Drop Gaussians with an alpha_t weight of at most this; needs --weights or "
                   "--cameras")
      ->type_name("W")
      ->group(group);
  verb->add_option("--profile", profile,
                   "Profile to keep to and declare: indexed, main, lossless; unless set, the "
                   "narrowest that the coding keeps to")
      ->type_name("NAME")
      ->offers(profile_names())
      ->group(group);
  verb->add_option("--level", level,
                   "Conformance level to keep to and declare, by number or name (validate --help "
                   "lists them); unless set, the lowest that the stream keeps to")
      ->type_name("N")
      ->offers(level_names())
      ->group(group);
  verb->add_flag("--drop-invalid", drop_invalid,
                 "Drop Gaussians that cannot be coded (NaN, infinite, out of range) instead of "
                 "refusing the scene")
      ->group(group);
  verb->add_option("--set", set,
                   "NAME=VALUE or NAME.C=VALUE: any parameter listed below; may be repeated, as "
                   "the others that take C")
      ->type_name("NAME[.C]=V")
      ->allow_extra_args(false)
      ->group(group);
}

void EncodeParameters::apply(Context& context, const EncoderHandle& encoder) const {
  encoder.check(l4d_encoder_set_preset(encoder.get(), preset.c_str()));
  if (!quality.empty()) {
    const double decibels = parse_decibels(quality, "--quality");
    about("--quality", [&] { encoder.set(L4D_ENC_QUALITY, decibels); });
  }
  if (!effort.empty()) {
    cli::set(encoder, L4D_ENC_EFFORT, effort, "--effort");
  }
  set_per_component(encoder, L4D_ENC_CODEBOOK_SIZE, codebook, "--codebook");
  set_per_component(encoder, L4D_ENC_STAGES, stages, "--stages");
  if (!tiers.empty()) cli::set(encoder, L4D_ENC_TIERS, tiers, "--tiers");
  set_per_component(encoder, L4D_ENC_ESCAPE_THRESHOLD, escape_threshold, "--escape-threshold");
  if (!rcq.empty()) {
    const char* value = rcq == "never" ? "0" : rcq == "auto" ? "1" : "2";
    cli::set(encoder, L4D_ENC_RCQ, value, "--rcq");
  }
  if (!rcq_size.empty()) {
    cli::set(encoder, L4D_ENC_RCQ_SIZE, rcq_size, "--rcq-size");
  }
  if (!prune_weight.empty()) {
    cli::set(encoder, L4D_ENC_PRUNE_WEIGHT, prune_weight, "--prune-weight");
  }
  if (!profile.empty()) {
    cli::set(encoder, L4D_ENC_PROFILE, std::to_string(parse_profile(profile, "--profile")),
             "--profile");
  }
  if (!level.empty()) {
    cli::set(encoder, L4D_ENC_LEVEL, std::to_string(parse_level(level, "--level")), "--level");
  }
  if (drop_invalid) {
    cli::set(encoder, L4D_ENC_DROP_INVALID, "1", "--drop-invalid");
  }
  for (const std::string& text : set) set_generic(encoder, text);
  if (!quality.empty()) require_quality(encoder, "--quality");
  const bool for_codebooks = !codebook.empty() || !stages.empty() || !escape_threshold.empty() ||
                             !rcq.empty() || !rcq_size.empty();
  if (for_codebooks && !eval::has_codebooks(encoder)) {
    context.note(
        "no component is coded by codebooks: --codebook, --stages, --escape-threshold and "
        "--rcq change nothing; --preset indexed has codebooks");
  }
}

void EncodeParameters::note_unused(Context& context, const DecoderHandle& written) const {
  if (rcq == "always" && (written.info().tools & L4D_TOOL_RCQ) == 0) {
    context.note(
        "--rcq always: no block codebooks were written; they take codebooks, layers of level 1 or "
        "above, and Gaussians there that are no escapes");
  }
  uint32_t last_tier = 0;
  for (uint32_t l = 0; l < written.info().num_layers; ++l) {
    last_tier = std::max(last_tier, written.layer_info(l).tier);
  }
  if (!tiers.empty() && last_tier == 0) {
    context.note(
        "--tiers: the stream has one tier; the others would have so few Gaussians that they joined "
        "it");
  }
}

bool EncodeParameters::sets(const std::string& name) const {
  return std::any_of(set.begin(), set.end(), [&](const std::string& text) {
    return text.compare(0, name.size() + 1, name + '=') == 0;
  });
}

void EncodeParameters::require_quality(const EncoderHandle& encoder,
                                       const std::string& option) const {
  if (eval::has_quality(encoder)) return;
  throw usage_error(
      option + ": the preset '" + preset + "' with what is set codes by " +
      (encoder.value(L4D_ENC_LOSSLESS) != 0 ? "float32 bits" : "codebooks of given stages") +
      ", which no quality changes");
}

std::string parameter_help() {
  std::string text = "Presets:\n";
  for (uint32_t i = 0; l4d_encoder_preset_name(i) != nullptr; ++i) {
    text += format("  %-20s ", l4d_encoder_preset_name(i)) +
            wrap(l4d_encoder_preset_description(i), 23) + "\n";
  }
  const auto add = [&](const char* title, bool stable) {
    text += title;
    for (const l4d_parameter_info& info : EncoderHandle::parameters()) {
      if ((info.stable != 0) != stable) continue;
      text += format("  %-28s ", info.name) + wrap(describe(info), 31) + "\n";
    }
  };
  add("\nParameters of --set:\n", true);
  add("\nExperimental ones, which may change with each version:\n", false);
  text.pop_back();
  return text;
}

}  // namespace l4d::cli
