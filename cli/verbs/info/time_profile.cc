// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/info/time_profile.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "cli/text/units.h"
#include "l4d/experimental/inspect.h"

namespace l4d::cli {
namespace {

// A plot has no more columns than that to show.
constexpr uint32_t kMaxSteps = 600;

// Bytes of pages by level and of directory.
struct Cost {
  std::vector<uint64_t> upto;  // [level]: of all levels up to this one
  uint64_t directory = 0;
  uint64_t gaussians = 0;
};

Cost cost_of(const DecoderHandle& decoder, const std::vector<uint32_t>& levels, l4d_query query) {
  Cost cost;
  for (const uint32_t level : levels) {
    query.point.levels = level + 1;
    const l4d_selection selection = decoder.select(query);
    cost.upto.push_back(selection.bytes);
    cost.directory = selection.directory_bytes;
    cost.gaussians = selection.num_gaussians;
  }
  return cost;
}

uint64_t visible_at(const DecoderHandle& decoder, double seconds) {
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  decoder.check(l4d_decoder_slice(decoder.get(), seconds, &splats));
  return splats.count;
}

}  // namespace

uint64_t TimeProfile::step_bytes(size_t step) const {
  uint64_t sum = directory_bytes[step];
  for (const std::vector<uint64_t>& level : bytes) sum += level[step];
  return sum;
}

double TimeProfile::step_seconds() const {
  return static_cast<double>(frames_per_step) / frames_per_second(timeline);
}

double TimeProfile::mean_rate() const {
  if (times.size() < 2) return 0;
  double sum = 0;
  for (size_t step = 1; step < times.size(); ++step) sum += static_cast<double>(step_bytes(step));
  return sum / (static_cast<double>(times.size() - 1) * step_seconds());
}

double TimeProfile::peak_rate() const {
  if (times.size() < 2) return 0;
  const auto in_a_second = static_cast<size_t>(std::max(1.0, std::round(1 / step_seconds())));
  const size_t window = std::min(in_a_second, times.size() - 1);
  uint64_t sum = 0;
  uint64_t most = 0;
  for (size_t step = 1; step < times.size(); ++step) {
    sum += step_bytes(step);
    if (step > window) sum -= step_bytes(step - window);
    most = std::max(most, sum);
  }
  return static_cast<double>(most) / (static_cast<double>(window) * step_seconds());
}

Json TimeProfile::json() const {
  Json by_level = Json::array();
  for (size_t l = 0; l < levels.size(); ++l) {
    by_level.push_back({{"level", levels[l]}, {"bytes", bytes[l]}});
  }
  return {{"frames_per_step", frames_per_step},
          {"times", times},
          {"levels", by_level},
          {"directory_bytes", directory_bytes},
          {"gaussians", gaussians},
          {"visible", visible},
          {"setup_bytes", setup_bytes},
          {"opening_bytes", opening_bytes()},
          {"mean_bytes_per_s", mean_rate()},
          {"peak_bytes_per_s", peak_rate()}};
}

std::string TimeProfile::text() const {
  return format("%s until the first image, then %s/s on average and %s/s in the worst second",
                format_bytes(opening_bytes()).c_str(),
                format_bytes(static_cast<uint64_t>(mean_rate())).c_str(),
                format_bytes(static_cast<uint64_t>(peak_rate())).c_str());
}

TimeProfile profile_over_time(const SceneStream& stream, const std::vector<l4d_layer_info>& layers,
                              const std::vector<uint64_t>& sections, Progress& progress) {
  const DecoderHandle& decoder = stream.decoder();
  TimeProfile profile;
  profile.timeline = stream.info().timeline;
  std::map<uint32_t, double> widths;
  for (const l4d_layer_info& layer : layers) widths[layer.level] = layer.bucket_width;
  for (const auto& [level, width] : widths) {
    profile.levels.push_back(level);
    profile.bucket_widths.push_back(width);
  }
  profile.bytes.resize(profile.levels.size());
  for (const uint32_t section : {L4D_SECTION_HEADER, L4D_SECTION_CODEBOOKS, L4D_SECTION_RCQ_TABLES,
                                 L4D_SECTION_ENTROPY_TABLES}) {
    profile.setup_bytes += sections[section];
  }
  const uint32_t frames = profile.timeline.num_frames;
  profile.frames_per_step = (frames + kMaxSteps - 1) / kMaxSteps;
  const uint32_t steps = (frames + profile.frames_per_step - 1) / profile.frames_per_step;

  l4d_query query = L4D_INIT(l4d_query);
  Cost here;  // of the buckets that the step before has
  for (uint32_t step = 0; step < steps; ++step) {
    check_interrupt();
    progress.update(step, steps, "stepping");
    const double time = profile.timeline.time_begin + step * profile.step_seconds();
    Cost fetched;
    if (step > 0) {
      query.kind = L4D_QUERY_RANGE;
      query.time_begin = profile.times.back();
      query.time_end = time;
      fetched = cost_of(decoder, profile.levels, query);
    }
    query.kind = L4D_QUERY_TIME;
    query.time_begin = query.time_end = time;
    const Cost next = cost_of(decoder, profile.levels, query);
    if (step == 0) {
      fetched = next;
      here.upto.resize(profile.levels.size());
    }
    uint64_t coarser = 0;
    for (size_t l = 0; l < profile.levels.size(); ++l) {
      const uint64_t upto = fetched.upto[l] - here.upto[l];
      profile.bytes[l].push_back(upto - coarser);
      coarser = upto;
    }
    profile.directory_bytes.push_back(fetched.directory -
                                      std::min(fetched.directory, here.directory));
    profile.times.push_back(time);
    profile.gaussians.push_back(next.gaussians);
    profile.visible.push_back(visible_at(decoder, time));
    here = next;
  }
  return profile;
}

}  // namespace l4d::cli
