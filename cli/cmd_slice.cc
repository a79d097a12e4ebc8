// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <memory>

#include "cli/common.h"
#include "cli/files.h"
#include "cli/progress.h"
#include "cli/scene_source.h"
#include "cli/units.h"
#include "io/formats.h"

namespace l4d::cli {
namespace {

struct SliceArguments {
  std::string input;
  std::string output;
  std::string time, from, to, fps;
  ImportArguments import;
};

// A name with one %d or %0Nd in it: "out_%04d.ply". "%%" is a percent sign.
class NumberedName {
 public:
  explicit NumberedName(const std::string& pattern) {
    std::string* part = &before_;
    size_t fields = 0;
    for (size_t i = 0; i < pattern.size(); ++i) {
      if (pattern[i] != '%') {
        *part += pattern[i];
        continue;
      }
      if (pattern.compare(i, 2, "%%") == 0) {
        *part += '%';
        ++i;
        continue;
      }
      size_t end = i + 1;
      while (end < pattern.size() && pattern[end] >= '0' && pattern[end] <= '9') ++end;
      const std::string digits = pattern.substr(i + 1, end - i - 1);
      if (end == pattern.size() || pattern[end] != 'd' || digits.size() > 2 || ++fields > 1) {
        fields = 0;
        break;
      }
      if (!digits.empty()) width_ = static_cast<size_t>(std::stoi(digits));
      part = &after_;
      i = end;
    }
    if (fields != 1) {
      throw usage_error("a sequence needs an output name with one %d in it, as out_%04d.ply");
    }
  }
  std::string operator()(size_t number) const {
    std::string digits = std::to_string(number);
    if (digits.size() < width_) digits.insert(0, width_ - digits.size(), '0');
    return before_ + digits + after_;
  }

 private:
  std::string before_, after_;
  size_t width_ = 0;
};

constexpr size_t kMaxFrames = 1u << 24;

// Instants from + k / fps in [from, to); the end of a sequence is no frame of it.
std::vector<double> instants(Context& context, const SliceArguments& arguments,
                             const l4d_timeline& timeline) {
  const auto seconds = [&](const std::string& text, const char* option, double otherwise) {
    return text.empty() ? otherwise
                        : clamp_to_sequence(context, timeline, parse_seconds(text, option), option);
  };
  if (!arguments.time.empty()) return {seconds(arguments.time, "--time", 0)};
  const double begin = timeline.time_begin;
  const double from = seconds(arguments.from, "--from", begin);
  const double to = seconds(arguments.to, "--to", begin + io::duration(timeline));
  const double fps =
      arguments.fps.empty() ? frames_per_second(timeline) : parse_number(arguments.fps, "--fps");
  if (!(fps > 0)) throw usage_error("--fps must be positive");
  if (!(to > from)) throw usage_error("--to must lie after --from");
  // A frame that starts within rounding of the end is past it.
  const double count = std::ceil((to - from) * fps - 1e-6);
  if (count > static_cast<double>(kMaxFrames)) throw usage_error("more than 2^24 frames");
  std::vector<double> times;
  for (size_t k = 0; k < static_cast<size_t>(count); ++k) {
    times.push_back(from + static_cast<double>(k) / fps);
  }
  return times;
}

void require_what(const SliceArguments& arguments) {
  const bool range = !arguments.from.empty() || !arguments.to.empty() || !arguments.fps.empty();
  if (arguments.time.empty() && !range) {
    throw usage_error("slice needs --time T, or --from A --to B --fps F for a sequence");
  }
}

Outcome run_slice(Context& context, const SliceArguments& arguments) {
  const Stopwatch watch;
  require_what(arguments);
  const bool single = !arguments.time.empty();
  if (!single && arguments.output == "-") throw usage_error("a sequence cannot go to stdout");
  const Input input(arguments.input);
  const std::unique_ptr<NumberedName> pattern(single ? nullptr
                                                     : new NumberedName(arguments.output));
  SceneStream stream(context, input, arguments.import);
  const l4d_info& info = stream.info();
  const std::vector<double> times = instants(context, arguments, info.timeline);
  const l4d_placement& p = info.placement;
  if (p.scale != 1 || p.origin[0] != 0 || p.origin[1] != 0 || p.origin[2] != 0) {
    context.note("positions are in the frame of the scene; world = (" +
                 format("%.15g, %.15g, %.15g", p.origin[0], p.origin[1], p.origin[2]) + ") + " +
                 format("%.15g", p.scale) + " * position");
  }

  // All names are checked before anything is written.
  std::vector<std::unique_ptr<Output>> outputs;
  for (size_t k = 0; k < times.size(); ++k) {
    outputs.push_back(std::make_unique<Output>(context, single ? arguments.output : (*pattern)(k),
                                               std::vector<const Input*>{&input}));
  }

  Outcome outcome;
  Json frames = Json::array();
  uint64_t total_splats = 0;
  uint64_t total_bytes = 0;
  double slice_seconds = 0;
  {
    Progress progress(context, "slice");
    for (size_t k = 0; k < times.size(); ++k) {
      check_interrupt();
      progress.update(k, times.size(), "frames");
      const Stopwatch slice_watch;
      SplatArrays arrays = about(input.name(), [&] { return stream.decoder().slice(times[k]); });
      slice_seconds += slice_watch.seconds();
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
  outcome.stdout_is_data = outputs[0]->is_stdout();
  l4d_counters counters;
  l4d_counters_init(&counters);
  stream.decoder().check(l4d_decoder_get_counters(stream.decoder().get(), &counters));

  outcome.json = {
      {"schema", "l4dcodec.slice/1"},      {"input", input.name()},
      {"num_frames", times.size()},        {"frames", frames},
      {"file_bytes", total_bytes},         {"buckets_decoded", counters.buckets_decoded},
      {"cache_hits", counters.cache_hits}, {"slice_s", slice_seconds},
      {"total_s", watch.seconds()}};
  if (single) {
    outcome.text = format("%s: %s splats at %s s, %s\n", arguments.output.c_str(),
                          format_count(total_splats).c_str(), format_number(times[0]).c_str(),
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
  CLI::App* verb =
      add_verb(registry, "slice", "Write the scene at an instant, or at many, as 3DGS PLY",
               [arguments](Context& context) { return run_slice(context, *arguments); });
  verb->add_option("input", arguments->input, "Scene: .l4d or PLY, '-' = stdin")->required();
  verb->add_option("-o,--output", arguments->output,
                   "3DGS PLY to write, '-' = stdout; a sequence needs a %d: out_%04d.ply, counted "
                   "from 0")
      ->type_name("FILE")
      ->required();
  auto* time =
      verb->add_option("--time", arguments->time, "One instant: 2.5, 1:30")->type_name("T");
  auto* from = verb->add_option("--from", arguments->from, "Sequence from here (default: start)")
                   ->type_name("T");
  auto* to =
      verb->add_option("--to", arguments->to, "... to before here (default: end)")->type_name("T");
  auto* fps = verb->add_option("--fps", arguments->fps, "Frames per second (default: the scene's)")
                  ->type_name("F");
  time->excludes(from)->excludes(to)->excludes(fps);
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
