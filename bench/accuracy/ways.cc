// SPDX-License-Identifier: Apache-2.0
// What the time of an encode buys: the ways of the tool, from an estimate of importance to many
// passes of a fit, at several qualities each.
#include "bench/accuracy/sections.h"
#include "bench/accuracy/timing.h"
#include "eval/refit/view_encoding.h"

namespace l4d::bench {
namespace {

// Of these the page tells bytes at the fidelities between them.
constexpr double kQualities[] = {39, 45, 52};

struct Way {
  const char* name;  // as a user writes it
  enum { kEstimate, kMadeUp, kCameras } importance;
  bool refits = false;
  double effort = 7;
};

eval::Encoding encode_way(const BenchScene& scene, const Way& way, double quality,
                          uint32_t backend) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.backend = backend;
  const EncoderHandle encoder(&options);
  encoder.check(l4d_encoder_set_preset(encoder.get(), "default"));
  encoder.set(L4D_ENC_EFFORT, way.effort);
  encoder.set(L4D_ENC_QUALITY, quality);
  const l4d_gaussians view = scene.scene.view();
  encoder.check(
      l4d_encoder_set_scene(encoder.get(), &view, &scene.scene.timeline, &scene.scene.placement));
  eval::Observer quiet;
  if (way.importance == Way::kCameras) {
    eval::ViewEncodingOptions how;
    how.preset = "default";
    how.rendering.renderer.backend = backend;
    how.refits = way.refits;
    return eval::encode_for_views(encoder, scene.scene, scene.training_views(), how, quiet)
        .encoding;
  }
  Measured made_up;
  if (way.importance == Way::kMadeUp) {
    made_up = measure_made_up(scene.scene, backend);
    l4d_importance importance = made_up.weights.view();
    importance.views = L4D_WEIGHT_VIEWS_SOME;
    encoder.check(l4d_encoder_set_importance(encoder.get(), &importance));
  }
  return eval::encode_scene(quiet, encoder, "", true);
}

Json run(Bench& bench, uint32_t backend, std::vector<Way> ways) {
  if (bench.quick()) ways.pop_back();  // the slowest
  const BenchScene& scene = bench.real();
  const Judge& judge = bench.judge(scene);
  Json rows = Json::array();
  for (const Way& way : bench.take(ways)) {
    for (const double quality :
         bench.take(std::vector(std::begin(kQualities), std::end(kQualities)))) {
      const double started = seconds_now();
      const eval::Encoding encoding = encode_way(scene, way, quality, backend);
      const double seconds = seconds_now() - started;
      bench.add(rows, {{"name", way.name},
                       {"quality", quality},
                       {"bytes", encoding.stream.size()},
                       {"fidelity_db", std::min(judge.of_file(encoding.stream).psnr, kMaxDecibels)},
                       {"seconds", seconds}});
    }
  }
  return {{"ways", rows}};
}

}  // namespace

Json run_ways(Bench& bench) {
  return run(bench, L4D_BACKEND_CPU,
             {{"--estimate", Way::kEstimate},
              {"(nothing)", Way::kMadeUp},
              {"--cameras --refit 0", Way::kCameras},
              {"--cameras", Way::kCameras, true},
              {"--cameras --effort 8", Way::kCameras, true, 8}});
}

Json run_device_ways(Bench& bench) {
  return run(bench, L4D_BACKEND_CUDA,
             {{"--cameras --refit 0", Way::kCameras},
              {"--cameras", Way::kCameras, true},
              {"--cameras --effort 8", Way::kCameras, true, 8}});
}

}  // namespace l4d::bench
