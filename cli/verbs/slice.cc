// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "cli/common.h"
#include "cli/files.h"
#include "cli/scene_source.h"
#include "cli/text/detail.h"
#include "cli/text/progress.h"
#include "cli/text/sequence.h"
#include "cli/text/units.h"
#include "cli/verbs/tolerant.h"
#include "io/formats.h"

namespace l4d::cli {
namespace {

struct SliceArguments {
  std::string input;
  std::string output;
  SequenceArguments sequence;
  std::string detail = "full";
  bool tolerant = false;
  ImportArguments import;
};

void require_what(const SliceArguments& arguments) {
  if (arguments.sequence.time.empty() && !arguments.sequence.is_range()) {
    throw usage_error("slice needs --time T, or --from A --to B --fps F for a sequence");
  }
}

Outcome run_slice(Context& context, const SliceArguments& arguments) {
  const Stopwatch watch;
  require_what(arguments);
  const bool single = !arguments.sequence.time.empty();
  if (!single && arguments.output == "-") throw usage_error("a sequence cannot go to stdout");
  arguments.sequence.check();
  check_extension(arguments.output, "--output", {".ply"});
  if (single) NumberedName::refuse(arguments.output);
  arguments.import.check();
  context.files.add_input(arguments.input, kTheInput);
  const std::unique_ptr<NumberedName> pattern(
      single ? nullptr : new NumberedName(arguments.output, "out_%04d.ply"));
  std::vector<std::unique_ptr<Output>> outputs;
  if (single) outputs.push_back(std::make_unique<Output>(context, arguments.output));
  const Input input(context, arguments.input);
  const TolerantStream stream(context, input, arguments.import, arguments.tolerant);
  stream.decoder().set_detail(detail_id(arguments.detail));
  const l4d_info& info = stream.info();
  const std::vector<double> times = instants(context, arguments.sequence, info.timeline);
  const l4d_placement& p = info.placement;
  if (p.scale != 1 || p.origin[0] != 0 || p.origin[1] != 0 || p.origin[2] != 0) {
    context.note("positions are in the frame of the scene; world = (" +
                 format("%.15g, %.15g, %.15g", p.origin[0], p.origin[1], p.origin[2]) + ") + " +
                 format("%.15g", p.scale) + " * position");
  }

  // All names are checked before anything is written.
  for (size_t k = outputs.size(); k < times.size(); ++k) {
    outputs.push_back(std::make_unique<Output>(context, (*pattern)(k)));
  }

  Outcome outcome;
  Json frames = Json::array();
  uint64_t total_splats = 0;
  uint64_t total_bytes = 0;
  double slice_seconds = 0;
  LossReport losses;
  {
    Progress progress(context, "slice");
    for (size_t k = 0; k < times.size(); ++k) {
      check_interrupt();
      progress.update(k, times.size(), "frames");
      const Stopwatch slice_watch;
      const HeldMemory memory(
          context, about(input.name(), [&] { return slice_bytes(stream.decoder(), times[k]); }),
          "a slice");
      SplatArrays arrays = about(input.name(), [&] { return stream.decoder().slice(times[k]); });
      slice_seconds += slice_watch.seconds();
      losses.add(stream.decoder());
      io::Splats splats;
      splats.sh_degree = arrays.sh_degree;
      splats.position = std::move(arrays.position);
      splats.covariance = std::move(arrays.covariance);
      splats.opacity = std::move(arrays.opacity);
      splats.sh = std::move(arrays.sh);
      io::write_3dgs_ply(outputs[k]->path(), splats);
      total_bytes += outputs[k]->finish();
      total_splats += splats.count();
      frames.push_back({{"index", k},
                        {"time", times[k]},
                        {"gaussians", splats.count()},
                        {"output", single ? arguments.output : (*pattern)(k)}});
    }
  }
  losses.note(context, input.name());
  outcome.stdout_is_data = outputs[0]->is_stdout();
  l4d_counters counters;
  l4d_counters_init(&counters);
  stream.decoder().check(l4d_decoder_get_counters(stream.decoder().get(), &counters));

  outcome.json = {{"schema", "l4dcodec.slice/1"},
                  {"input", input.name()},
                  {"detail", arguments.detail},
                  {"num_frames", times.size()},
                  {"frames", frames},
                  {"file_bytes", total_bytes},
                  {"buckets_decoded", counters.buckets_decoded},
                  {"cache_hits", counters.cache_hits},
                  {"losses", losses.json()},
                  {"slice_s", slice_seconds},
                  {"total_s", watch.seconds()}};
  if (single) {
    outcome.text = format("%s: %s splats at %s s, %s\n", arguments.output.c_str(),
                          format_count(total_splats).c_str(), format_time(times[0]).c_str(),
                          format_bytes(total_bytes).c_str());
  } else {
    outcome.text = format(
        "%s .. %s: %s frames, %s splats each on average, %s\n", (*pattern)(0).c_str(),
        (*pattern)(times.size() - 1).c_str(), format_count(times.size()).c_str(),
        format_count(total_splats / times.size()).c_str(), format_bytes(total_bytes).c_str());
  }
  return outcome;
}

}  // namespace

void add_slice(Registry& registry) {
  auto arguments = std::make_shared<SliceArguments>();
  Verb* verb = add_verb(registry, "slice", "Write the scene at an instant, or at many, as 3DGS PLY",
                        [arguments](Context& context) { return run_slice(context, *arguments); });
  verb->add_option("input", arguments->input, "Scene: .l4d or PLY, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output,
                   "3DGS PLY to write, '-' = stdout; a sequence needs a %d: out_%04d.ply, counted "
                   "from 0")
      ->type_name("FILE")
      ->required();
  add_sequence_options(verb, arguments->sequence);
  add_detail_option(verb, arguments->detail);
  add_tolerant_option(verb, arguments->tolerant);
  verb->add_option("--seconds", arguments->import.seconds,
                   "Duration to give a PLY that carries no timeline (default: 1)")
      ->type_name("T");
  verb->footer(
      "Examples:\n"
      "  l4dcodec slice scene.l4d --time 2.5 -o frame.ply\n"
      "  l4dcodec slice scene.l4d --from 1 --to 2 --fps 30 -o frame_%04d.ply\n"
      "Each bucket of a sequence is decoded once. Opacity has the temporal falloff applied.");
}

}  // namespace l4d::cli
