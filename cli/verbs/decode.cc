// SPDX-License-Identifier: Apache-2.0
#include <filesystem>
#include <memory>

#include "cli/command/context.h"
#include "cli/command/detail.h"
#include "cli/command/progress.h"
#include "cli/command/values.h"
#include "cli/input/arrays.h"
#include "cli/input/files.h"
#include "cli/input/instants.h"
#include "cli/input/scene_source.h"
#include "cli/input/sequence.h"
#include "cli/input/tolerant.h"
#include "cli/text/units.h"
#include "cli/verbs/verbs.h"
#include "io/ply/scene_ply.h"

namespace l4d::cli {
namespace {

constexpr const char* kRawExtension = ".safetensors";
constexpr const char* kBirthsExtension = ".4dgs";

struct DecodeArguments {
  std::string input;
  std::string output;
  std::string format = "l4d";
  std::string time, from, to;
  uint32_t max_level = UINT32_MAX;
  uint32_t max_tier = UINT32_MAX;
  std::string detail = "full";
  bool tolerant = false;
  bool digest = false;
  bool packed = false;
  ImportArguments import;

  // Arrays as they are decoded, in place of a scene.
  bool wants_arrays() const { return digest || format == "raw"; }
};

// Of a name that ends in .4dgs without --format, that one.
std::string format_of_scene(const DecodeArguments& arguments) {
  const bool is_default = arguments.format == "l4d";
  const bool is_named = std::filesystem::path(arguments.output).extension() == kBirthsExtension;
  return is_default && is_named ? "4dgs" : arguments.format;
}

// Arrays have the size of what was selected; ranges say how much of it came.
void cut_to_ranges(LoadedScene& loaded) {
  size_t count = 0;
  for (const l4d_bucket_span& r : loaded.spans) count += static_cast<size_t>(r.count);
  io::Scene& scene = loaded.scene;
  scene.resize(count);
}

l4d_query make_query(Context& context, const DecodeArguments& arguments,
                     const l4d_timeline& timeline) {
  l4d_query query = L4D_INIT(l4d_query);
  query.kind = L4D_QUERY_ALL;
  query.point = operating_point(arguments.max_level, arguments.max_tier, arguments.detail);
  const auto seconds = [&](const std::string& text, const char* option) {
    return clamp_to_sequence(context, timeline, parse_seconds(text, option), option);
  };
  if (!arguments.time.empty()) {
    query.kind = L4D_QUERY_TIME;
    query.time_begin = query.time_end = seconds(arguments.time, "--time");
  } else if (!arguments.from.empty() || !arguments.to.empty()) {
    query.kind = L4D_QUERY_RANGE;
    query.time_begin =
        arguments.from.empty() ? timeline.time_begin : seconds(arguments.from, "--from");
    query.time_end = arguments.to.empty() ? timeline.time_begin + io::duration(timeline)
                                          : seconds(arguments.to, "--to");
  }
  return query;
}

// Usage errors that need no file.
void check(const DecodeArguments& arguments) {
  if (!arguments.time.empty()) parse_seconds(arguments.time, "--time");
  check_order(arguments.from, arguments.to, true);
  if (arguments.packed && !arguments.wants_arrays()) {
    throw usage_error("--packed needs --digest or --format raw");
  }
  if (arguments.digest && arguments.format != "raw" &&
      (!arguments.output.empty() || arguments.format == "ftgs")) {
    throw usage_error("--digest hashes arrays and writes no PLY; --format raw writes the arrays");
  }
}

// --format raw and --digest.
Outcome run_arrays(Context& context, const DecodeArguments& arguments) {
  const Stopwatch watch;
  const bool writes = arguments.format == "raw";
  const std::string name =
      writes ? output_name(arguments.output, arguments.input, kRawExtension) : "";
  arguments.import.check();
  context.files.add_input(arguments.input, kTheInput);
  const std::unique_ptr<Output> output(writes ? new Output(context, name) : nullptr);
  const Input input(context, arguments.input);
  const TolerantStream stream(context, input, arguments.import, arguments.tolerant);
  const l4d_query query = make_query(context, arguments, stream.info().timeline);
  const DecoderHandle& decoder = stream.decoder();
  LossReport losses;
  Arrays arrays;
  double decode_seconds = 0;
  uint64_t bytes = 0;
  {
    const Stopwatch decode_watch;
    Progress progress(context, "decode");
    decoder.check(l4d_decoder_set_progress(decoder.get(), &Progress::callback, &progress));
    arrays = about(input.name(), [&] {
      return arguments.packed ? decode_packed(context, decoder, query)
                              : decode_attributes(context, decoder, query);
    });
    decoder.check(l4d_decoder_set_progress(decoder.get(), nullptr, nullptr));
    decode_seconds = decode_watch.seconds();
    losses.add(decoder);
    losses.note(context, input.name(), static_cast<size_t>(arrays.count));
    check_interrupt();
    if (writes) {
      progress.step("writing");
      write_raw(output->path(), arrays, decoder);
    }
  }
  if (writes) bytes = output->finish();

  Outcome outcome;
  outcome.stdout_is_data = writes && output->is_stdout();
  outcome.json = {{"schema", "l4dcodec.decode/1"},
                  {"input", input.name()},
                  {"output", writes ? Json(name) : Json()},
                  {"format", writes ? Json("raw") : Json()},
                  {"detail", arguments.detail},
                  {"num_gaussians", arrays.count},
                  {"lossless", (stream.info().tools & L4D_TOOL_LOSSLESS) != 0},
                  {"losses", losses.json()},
                  {"file_bytes", bytes},
                  {"decode_s", decode_seconds},
                  {"total_s", watch.seconds()}};
  if (arguments.digest) {
    const Digests digests(arrays);
    outcome.json["digests"] = digests.json();
    outcome.text = digests.text();
    outcome.text_is_asked_for = true;
  } else {
    outcome.text = format("%s: %s Gaussians, %s, decoded in %s\n", name.c_str(),
                          format_count(arrays.count).c_str(), format_bytes(bytes).c_str(),
                          format_seconds(decode_seconds).c_str());
  }
  return outcome;
}

Outcome run_decode(Context& context, const DecodeArguments& arguments) {
  const Stopwatch watch;
  check(arguments);
  if (arguments.wants_arrays()) return run_arrays(context, arguments);
  const std::string target = format_of_scene(arguments);
  const std::string name = output_name(arguments.output, arguments.input,
                                       target == "ftgs"   ? ".ftgs.ply"
                                       : target == "4dgs" ? kBirthsExtension
                                                          : ".ply");
  arguments.import.check();
  context.files.add_input(arguments.input, kTheInput);
  Output output(context, name);
  const Input input(context, arguments.input);

  const TolerantStream stream(context, input, arguments.import, arguments.tolerant);
  const l4d_query query = make_query(context, arguments, stream.info().timeline);
  LoadedScene loaded;
  double decode_seconds = 0;
  LossReport losses;
  {
    const Stopwatch decode_watch;
    Progress progress(context, "decode");
    const DecoderHandle& decoder = stream.decoder();
    decoder.check(l4d_decoder_set_progress(decoder.get(), &Progress::callback, &progress));
    loaded = about(input.name(), [&] { return decode_scene(context, decoder, &query); });
    decoder.check(l4d_decoder_set_progress(decoder.get(), nullptr, nullptr));
    decode_seconds = decode_watch.seconds();
    losses.add(decoder);
    cut_to_ranges(loaded);
    // Before the writers, which end by giving the file its name.
    losses.note(context, input.name(), loaded.scene.count());
    check_interrupt();
    progress.step("writing");
    if (target == "ftgs") {
      write_moving(context, output.path(), loaded.scene, io::write_ftgs_ply);
    } else if (target == "4dgs") {
      write_births(context, output.path(), loaded.scene);
    } else {
      io::write_l4d_ply(output.path(), loaded.scene, check_interrupt);
    }
  }
  const size_t count = loaded.scene.count();
  const uint64_t bytes = output.finish();

  Outcome outcome;
  outcome.stdout_is_data = output.is_stdout();
  outcome.json = {{"schema", "l4dcodec.decode/1"},
                  {"input", input.name()},
                  {"output", name},
                  {"format", target},
                  {"detail", arguments.detail},
                  {"num_gaussians", count},
                  {"lossless", (stream.info().tools & L4D_TOOL_LOSSLESS) != 0},
                  {"losses", losses.json()},
                  {"file_bytes", bytes},
                  {"decode_s", decode_seconds},
                  {"total_s", watch.seconds()}};
  outcome.text =
      format("%s: %s Gaussians, %s, decoded in %s\n", name.c_str(), format_count(count).c_str(),
             format_bytes(bytes).c_str(), format_seconds(decode_seconds).c_str());
  return outcome;
}

}  // namespace

void add_decode(Registry& registry) {
  auto arguments = std::make_shared<DecodeArguments>();
  Verb* verb = add_verb(registry, "decode", "Decode a stream, or part of it, to a PLY or to arrays",
                        [arguments](Context& context) { return run_decode(context, *arguments); });
  verb->add_option("input", arguments->input, scene_help())->required();
  verb->add_option("-o,--output", arguments->output,
                   "PLY or .4dgs to write, '-' = stdout (default: input's name with .ply)")
      ->type_name("FILE");
  verb->add_option("--format", arguments->format,
                   "l4d: every attribute, bit for bit where the stream is lossless; ftgs: "
                   "FreeTimeGS, converted; 4dgs: .4dgs, rounded to its steps; raw: arrays exactly "
                   "as decoded, no PLY (input's name with "
                   ".safetensors)")
      ->type_name("NAME")
      ->one_of({"l4d", "ftgs", "4dgs", "raw"})
      ->capture_default_str();
  auto* time = verb->add_option("--time", arguments->time,
                                "Only buckets that may be visible at this time: 2.5, 1:30")
                   ->type_name("T");
  auto* from = verb->add_option("--from", arguments->from,
                                "Only buckets that may be visible from this time on")
                   ->type_name("T");
  auto* to = verb->add_option("--to", arguments->to, "... and up to this one")->type_name("T");
  time->excludes(from)->excludes(to);
  verb->add_option("--max-level", arguments->max_level,
                   "Leave out temporal levels finer than this: a preview without fast detail")
      ->type_name("N")
      ->whole_number(0, 63);
  add_tier_option(verb, arguments->max_tier);
  add_detail_option(verb, arguments->detail);
  verb->add_flag(
      "--digest", arguments->digest,
      "Print XXH3-64 of each decoded array and of all (appendix F of the specification); "
      "writes no file unless with --format raw");
  verb->add_flag("--packed", arguments->packed,
                 "Arrays of indices and codes, not dequantised: of streams of the profile indexed, "
                 "with --digest or --format raw");
  add_tolerant_option(verb, arguments->tolerant);
  add_import_options(verb, arguments->import);
  verb->footer(
      "Examples:\n"
      "  l4dcodec decode scene.l4d -o scene.ply\n"
      "  l4dcodec decode long.l4d --from 1:30 --to 1:35 -o part.ply\n"
      "  l4dcodec decode scene.l4d --time 2 --digest\n"
      "A lossless stream gives back the input's bits; rows may be in another order.");
}

}  // namespace l4d::cli
