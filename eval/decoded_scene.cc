// SPDX-License-Identifier: Apache-2.0
#include "eval/decoded_scene.h"

#include <algorithm>
#include <cmath>

namespace l4d::eval {
namespace {

uint64_t sh_numbers(uint32_t degree) { return uint64_t{3} * (degree + 1) * (degree + 1); }

// Times as double where float32 is not the same: in lossless streams at all, in others by more than
// a thousandth of a frame, which is less than what coding leaves of any but the shortest events.
void keep_exact_times(std::vector<double>& times, bool lossless, io::Scene& scene) {
  const double frame = static_cast<double>(scene.timeline.fps_den) / scene.timeline.fps_num;
  double worst = 0;
  for (size_t i = 0; i < times.size(); ++i) {
    worst = std::max(worst, std::abs(times[i] - static_cast<double>(scene.mean_t[i])));
  }
  if (worst > (lossless ? 0 : 1e-3 * frame)) scene.mean_t_double = std::move(times);
}

}  // namespace

DecodedScene decode_scene(const DecoderHandle& decoder, const l4d_query* query,
                          const Hold& holder) {
  l4d_query all;
  l4d_query_init(&all);
  all.kind = L4D_QUERY_ALL;
  const l4d_info info = decoder.info();
  const l4d_query& wanted = query != nullptr ? *query : all;
  // All attributes, and mean times once more and as double.
  const uint64_t windows = (info.tools & L4D_TOOL_FLAT_WINDOWS) != 0 ? 2 : 0;
  const uint64_t numbers = numbers_per_gaussian(info.sh_degree) + 3 + windows;
  const l4d_selection selection = decoder.select(wanted);
  DecodedScene loaded;
  loaded.memory = hold(holder,
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
  for (uint32_t l = 0; l < info.num_layers; ++l) {
    const l4d_layer_info layer = decoder.layer_info(l);
    loaded.levels.push_back(layer.level);
    loaded.permanent.push_back(layer.permanent != 0);
  }
  return loaded;
}

uint64_t slice_bytes(const DecoderHandle& decoder, double seconds) {
  l4d_query query;
  l4d_query_init(&query);
  query.kind = L4D_QUERY_TIME;
  query.time_begin = seconds;
  // position, covariance, opacity
  constexpr uint64_t kNumbers = 3 + 6 + 1;
  return decoder.select(query).num_gaussians * (kNumbers + sh_numbers(decoder.info().sh_degree)) *
         sizeof(float);
}

}  // namespace l4d::eval
