// SPDX-License-Identifier: Apache-2.0
#include "eval/scene/decoded_scene.h"

#include <algorithm>
#include <cmath>

#include "eval/scene/motion.h"
#include "l4d/experimental/inspect.hpp"
#include "libl4dcodec/scene/window.h"

namespace l4d::eval {
namespace {

uint64_t sh_numbers(uint32_t degree) { return uint64_t{3} * (degree + 1) * (degree + 1); }

// Times as double where float32 is not the same: in lossless streams at all, in others by more than
// a thousandth of a frame or of a Gaussian's own duration.
void keep_exact_times(const std::vector<double>& times, bool lossless, io::Scene& scene) {
  const double frame = static_cast<double>(scene.timeline.fps_den) / scene.timeline.fps_num;
  const auto rounding = [&](size_t i) {
    return std::abs(times[i] - static_cast<double>(scene.mean_t[i]));
  };
  for (size_t i = 0; i < times.size(); ++i) {
    if (rounding(i) == 0) continue;
    if (!lossless && rounding(i) <= 1e-3 * std::min(frame, motion_of(scene, i).sigma_t)) continue;
    scene.mean_t_double = times;
    return;
  }
}

// Positions are those at the end of the sequence that is nearer to a mean time outside of it;
// `part` has other ends.
void move_references(const l4d_timeline& part, DecodedScene* loaded) {
  io::Scene& scene = loaded->scene;
  for (size_t i = 0; i < scene.count(); ++i) {
    const double mean = loaded->mean_t[i];
    const double from = reference_time(scene.timeline, mean), to = reference_time(part, mean);
    if (from == to) continue;
    const io::Vec3 moved = motion_of(scene, i, mean).at(to);
    for (size_t k = 0; k < 3; ++k) scene.position[3 * i + k] = static_cast<float>(moved[k]);
  }
}

// Windows count frames from the begin of the sequence.
void cut_windows(const l4d_timeline& part, DecodedScene* loaded) {
  io::Scene& scene = loaded->scene;
  const int64_t before = std::llround(frames_of_time(scene.timeline, part.time_begin));
  const auto frame = [&](uint32_t f) {
    return static_cast<uint32_t>(
        std::clamp<int64_t>(int64_t{f} - before, 0, int64_t{part.num_frames}));
  };
  std::vector<char> keep(scene.count(), 1);
  for (size_t i = 0; i < scene.count(); ++i) {
    const FrameWindow window = window_in(scene, i);
    if (!window.is_flat()) continue;
    scene.window[2 * i] = frame(window.begin);
    scene.window[2 * i + 1] = frame(window.end);
    keep[i] = scene.window[2 * i] < scene.window[2 * i + 1];
  }
  if (std::find(keep.begin(), keep.end(), 0) == keep.end()) return;
  scene.keep(keep);
  keep_rows(keep, 1, &loaded->mean_t);
  loaded->spans.clear();
}

}  // namespace

DecodedScene decode_scene(const DecoderHandle& decoder, const l4d_query* query,
                          const io::Hold& holder) {
  l4d_query all = L4D_INIT(l4d_query);
  all.kind = L4D_QUERY_ALL;
  const l4d_info info = decoder.info();
  const l4d_query& wanted = query != nullptr ? *query : all;
  // All attributes, and mean times once more and twice as double.
  const uint64_t windows = (info.tools & L4D_TOOL_FLAT_WINDOWS) != 0 ? 2 : 0;
  const uint64_t numbers = numbers_per_gaussian(info.sh_degree) + 5 + windows;
  const l4d_selection selection = decoder.select(wanted);
  DecodedScene loaded;
  loaded.memory = io::hold(holder,
                           selection.num_gaussians * numbers * sizeof(float) +
                               selection.num_spans * sizeof(l4d_bucket_span),
                           "the decoded scene");
  GaussianArrays arrays = decoder.decode(wanted);
  io::Scene& scene = loaded.scene;
  scene.timeline = info.timeline;
  scene.placement = info.placement;
  scene.rendering = decoder.rendering();
  scene.presentation = decoder.presentation();
  std::vector<double> times = std::move(arrays.mean_t_double);
  arrays.mean_t_double.clear();
  static_cast<AttributeArrays&>(scene) = std::move(arrays);
  keep_exact_times(times, (info.tools & L4D_TOOL_LOSSLESS) != 0, scene);
  loaded.mean_t = std::move(times);
  scene.source = "l4d";
  loaded.spans = std::move(arrays.spans);
  loaded.stated = coding_errors(decoder);
  for (uint32_t l = 0; l < info.num_layers; ++l) {
    const l4d_layer_info layer = decoder.layer_info(l);
    loaded.levels.push_back(layer.level);
    loaded.permanent.push_back(layer.permanent != 0);
  }
  return loaded;
}

l4d_timeline timeline_between(const l4d_timeline& like, double begin, double end) {
  l4d_timeline timeline = like;
  timeline.time_begin = begin;
  const double frames = (end - begin) * like.fps_num / like.fps_den;
  const double whole = std::round(frames);
  const double number = std::fabs(frames - whole) < 1e-6 * whole ? whole : std::ceil(frames);
  timeline.num_frames = static_cast<uint32_t>(std::clamp(number, 1.0, double{L4D_MAX_FRAMES}));
  return timeline;
}

void present(double begin, double end, double shift, DecodedScene* loaded) {
  io::Scene& scene = loaded->scene;
  const l4d_timeline old = scene.timeline;
  const l4d_timeline part = timeline_between(old, begin, end);
  const bool is_cut = part.time_begin != old.time_begin || part.num_frames != old.num_frames;
  if (is_cut && (scene.flags & L4D_POSITION_AT_MEAN_TIME) == 0) move_references(part, loaded);
  if (is_cut && !scene.window.empty()) cut_windows(part, loaded);
  scene.timeline = part;
  scene.timeline.time_begin = begin + shift;
  if (shift == 0) return;
  const bool exact = !scene.mean_t_double.empty();
  for (size_t i = 0; i < loaded->mean_t.size(); ++i) {
    loaded->mean_t[i] += shift;
    scene.mean_t[i] = static_cast<float>(loaded->mean_t[i]);
  }
  for (l4d_bucket_span& span : loaded->spans) span.center += shift;
  keep_exact_times(loaded->mean_t, exact, scene);
}

uint64_t slice_bytes(const DecoderHandle& decoder, double seconds, uint32_t sh_degree) {
  l4d_query query = L4D_INIT(l4d_query);
  query.kind = L4D_QUERY_TIME;
  query.time_begin = seconds;
  // position, covariance, opacity
  constexpr uint64_t kNumbers = 3 + 6 + 1;
  return decoder.select(query).num_gaussians * (kNumbers + sh_numbers(sh_degree)) * sizeof(float);
}

}  // namespace l4d::eval
