// SPDX-License-Identifier: Apache-2.0
// Frames per second of the renderer, another instant each frame, and where the time goes.
#include "l4d/render.hpp"

#include <algorithm>
#include <cstdio>

#include "bench/tables/common.h"
#include "io/camera/cameras.h"
#include "io/synth/synth.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr int kFrames = 12;
constexpr int kReferenceFrames = 1;

struct Result {
  double seconds = 0;  // per frame, decoding or slicing included; the median
  double stage[L4D_RENDER_PASS_COUNT] = {};
  l4d_render_stats stats;
};

// Frames spread over the sequence, seen from cameras in turn.
Result run(RendererHandle& renderer, const std::vector<l4d_camera>& cameras,
           const l4d_timeline& timeline, int frames) {
  Result out;
  const l4d_camera& first = cameras.front();
  std::vector<float> rgb(size_t{3} * first.width * first.height);
  const double length = io::duration(timeline);
  const auto frame = [&](int k) {
    renderer.set_time(timeline.time_begin + length * (k + 0.5) / frames);
    renderer.render(cameras[static_cast<size_t>(k) % cameras.size()], rgb.data());
  };
  if (frames > 1) frame(0);
  std::vector<double> seconds;
  for (int k = 0; k < frames; ++k) {
    const double started = seconds_now();
    frame(k);
    seconds.push_back(seconds_now() - started);
    out.stats = renderer.stats();
    for (size_t s = 0; s < L4D_RENDER_PASS_COUNT; ++s) {
      out.stage[s] += out.stats.seconds[s] / frames;
    }
  }
  out.seconds = median(seconds);
  return out;
}

RendererHandle make_renderer(uint32_t path, uint32_t exponential, uint32_t threads) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = path;
  options.exponential = exponential;
  options.threads = threads;
  return RendererHandle(&options);
}

void print(const char* name, const char* threads, const Result& r, double reference) {
  std::printf("| %s | %s | %.2f | %.0f |", name, threads, 1 / r.seconds, reference / r.seconds);
  for (const uint32_t s : {L4D_RENDER_PASS_SLICE, L4D_RENDER_PASS_PROJECT, L4D_RENDER_PASS_SORT,
                           L4D_RENDER_PASS_BIN, L4D_RENDER_PASS_BLEND}) {
    std::printf(" %.1f |", 1e3 * r.stage[s]);
  }
  std::puts("");
}

void table(const char* name, const WeightedScene& scene, const std::vector<float>& sh,
           const std::vector<l4d_camera>& cameras) {
  const l4d_gaussians gaussians = scene.scene.view();
  const l4d_timeline& timeline = scene.scene.timeline;
  RendererHandle reference = make_renderer(L4D_BACKEND_REFERENCE, L4D_RENDER_EXP_ACCURATE, 1);
  reference.set_gaussians(gaussians, timeline);
  const Result slow = run(reference, cameras, timeline, kReferenceFrames);
  std::printf(
      "\n%s: %zu Gaussians, SH degree %u, %ux%u pixels; of the frame in the middle %llu "
      "visible, %llu in view\n\n",
      name, scene.scene.count(), scene.scene.sh_degree, cameras[0].width, cameras[0].height,
      static_cast<unsigned long long>(slow.stats.visible),
      static_cast<unsigned long long>(slow.stats.projected));
  std::puts(
      "| path | threads | frames/s | times the reference | slice ms | project | sort | bin | "
      "blend |\n|---|---|---|---|---|---|---|---|---|");
  print("reference", "1", slow, slow.seconds);
  const struct {
    const char* name;
    uint32_t exponential, threads;
    const char* threads_name;
  } paths[] = {{"fast", L4D_RENDER_EXP_ACCURATE, 1, "1"},
               {"fast", L4D_RENDER_EXP_ACCURATE, 0, "all"},
               {"fast, fast exponential", L4D_RENDER_EXP_FAST, 0, "all"}};
  for (const auto& p : paths) {
    RendererHandle r = make_renderer(L4D_BACKEND_CPU, p.exponential, p.threads);
    r.set_gaussians(gaussians, timeline);
    print(p.name, p.threads_name, run(r, cameras, timeline, kFrames), slow.seconds);
  }
  // Decoding counts as slicing; a second pass finds the stream's pages in the cache.
  const std::vector<unsigned char> file = make_encoder(scene, sh, "default").encode();
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  RendererHandle r = make_renderer(L4D_BACKEND_CPU, L4D_RENDER_EXP_ACCURATE, 0);
  r.set_decoder(decoder);
  print("fast, from .l4d, first pass", "all", run(r, cameras, timeline, kFrames), slow.seconds);
  print("fast, from .l4d, second pass", "all", run(r, cameras, timeline, kFrames), slow.seconds);
}

std::vector<l4d_camera> cameras_of(const io::CameraSet& set) {
  std::vector<l4d_camera> out;
  for (const io::Camera& c : set.cameras) out.push_back(c.camera);
  return out;
}

}  // namespace

int main() {
  io::SynthOptions options;
  options.gaussians = 370000;  // some 0.3 million of them visible at a time
  WeightedScene synth{io::synthesize(options), {}};
  table("synth", synth, {}, cameras_of(io::orbit_cameras(synth.scene, 4, 1352, 1014)));
  if (data_dir().empty()) {
    std::puts("\nbasketball: SKIPPED, set L4D_DATA_DIR");
    return 0;
  }
  const WeightedScene scene = load_basketball();
  io::CameraSet set = io::read_cameras(data_dir() + "/basketball/cameras.json");
  std::vector<l4d_camera> cameras;
  for (const size_t c : {0u, 7u, 15u, 22u}) cameras.push_back(set.cameras.at(c).camera);
  table("basketball", scene, sh_weights(scene), cameras);
  return 0;
}
