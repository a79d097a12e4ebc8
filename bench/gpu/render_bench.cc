// SPDX-License-Identifier: Apache-2.0
// Frames per second of device-resident rendering, and views per second of
// importances, by the device's own clock. Beside them: what the bytes of each stage take at the
// copy rate of the device.
//
//   gpu_render_bench [forward] [WIDTHxHEIGHT] [gaussians | scene ...]
//
// Numbers are sizes of the synthetic scene, 620000 and 1240000 unless anything is given; others are
// files. Cameras are those of a cameras.json beside the file, or an orbit of 8. Images have
// 1352x1014 pixels unless a size is given. forward: nothing but forward rendering from binary16.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "bench/gpu/render_timing.h"
#include "io/camera/cameras.h"
#include "io/ply/scene_ply.h"
#include "io/synth/synth.h"
#include "l4d/cuda.h"
#include "l4d/experimental/cuda_render.h"
#include "l4d/experimental/sensitivity.hpp"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr int kRuns = 300;

struct Size {
  uint32_t width = 1352, height = 1014;
  size_t pixels() const { return size_t{width} * height; }
};

// The same view on another number of pixels.
l4d_camera with_size(l4d_camera c, Size size) {
  const double x = double{1} * size.width / c.width, y = double{1} * size.height / c.height;
  c.width = size.width;
  c.height = size.height;
  c.fx *= y;
  c.fy *= y;
  c.cx *= x;
  c.cy *= y;
  return c;
}

// Bytes read and written per second by a large copy.
double copy_rate() {
  constexpr size_t kBytes = size_t{1} << 30;
  const Array<char> from(kBytes), to(kBytes);
  from.clear();
  const Timing t = time_runs(20, nullptr, [&](int) {
    check(cudaMemcpyAsync(to.get(), from.get(), kBytes, cudaMemcpyDeviceToDevice));
  });
  return 2.0 * static_cast<double>(kBytes) / (1e-3 * t.median);
}

struct Bench {
  io::Scene scene;
  std::vector<l4d_camera> cameras;
  Array<float> position, mean_t, log_scale, rotor, opacity, sh;
  Array<uint32_t> window;
  l4d_gaussians device;
  Size size;
  double rate;

  // views: of the scene; none: an orbit.
  Bench(io::Scene&& s, const std::vector<io::Camera>& views, Size pixels, double copy)
      : scene(std::move(s)),
        position(scene.position),
        mean_t(scene.mean_t),
        log_scale(scene.log_scale),
        rotor(scene.rotor),
        opacity(scene.opacity),
        sh(scene.sh),
        window(scene.window.empty() ? std::vector<uint32_t>(2) : scene.window),
        device(scene.view()),
        size(pixels),
        rate(copy) {
    const auto orbit = io::orbit_cameras(scene, 8, size.width, size.height);
    for (const io::Camera& c : views.empty() ? orbit.cameras : views) {
      cameras.push_back(with_size(c.camera, size));
    }
    device.position = position.get();
    device.mean_t = mean_t.get();
    device.log_scale = log_scale.get();
    device.rotor = rotor.get();
    device.opacity = opacity.get();
    device.sh = sh.get();
    if (!scene.window.empty()) device.window = window.get();
    device.mean_t_double = nullptr;  // of the host
  }

  double time_of(int k) const {
    return scene.timeline.time_begin + io::duration(scene.timeline) * (k % 97 + 0.5) / 97;
  }
  const l4d_camera& camera_of(int k) const {
    return cameras[static_cast<size_t>(k) % cameras.size()];
  }
};

void stages(const Bench& bench, l4d_cuda_renderer* r, const l4d_cuda_image& image,
            cudaStream_t stream, bool half) {
  double sums[L4D_RENDER_PASS_COUNT] = {};
  double visible = 0, projected = 0, instances = 0;
  constexpr int kFrames = 64;
  l4d_cuda_frame_stats f = L4D_INIT(l4d_cuda_frame_stats);
  for (int k = 0; k < kFrames; ++k) {
    must(l4d_cuda_renderer_render(r, bench.time_of(k), &bench.camera_of(k), &image, stream));
    must(l4d_cuda_renderer_get_stats(r, stream, &f));
    for (int s = 0; s < L4D_RENDER_PASS_COUNT; ++s) sums[s] += f.seconds[s] / kFrames;
    visible += static_cast<double>(f.visible) / kFrames;
    projected += static_cast<double>(f.projected) / kFrames;
    instances += static_cast<double>(f.instances) / kFrames;
  }
  const double pixels = static_cast<double>(bench.size.pixels());
  const double row = 64 + (half ? 96 : 192);
  // What must move at least: attributes in, splats out; pairs of key and value through the sorts;
  // splats to tiles; pixels out.
  const double bytes[5] = {8 * static_cast<double>(bench.scene.count()) + 4 * visible,
                           visible * (4 + row) + projected * 56, projected * (8 + 16 * 4),
                           instances * (8 + 16 * 2 + 4) + projected * 40,
                           instances * 52 + pixels * 12};
  std::printf("%.0f visible, %.0f in view, %.0f instances (%.2f each)\n", visible, projected,
              instances, instances / projected);
  std::printf("| stage | us | floor us |\n|---|---|---|\n");
  const char* names[5] = {"slice", "project", "sort", "bin", "blend"};
  for (int s = 0; s < 5; ++s) {
    std::printf("| %s | %.1f | %.1f |\n", names[s], 1e6 * sums[s], 1e6 * bytes[s] / bench.rate);
  }
}

void print(const char* what, const Timing& t) {
  std::printf("%-34s median %.3f ms, 99th percentile %.3f ms: %.0f per second\n", what, t.median,
              t.p99, 1e3 / t.median);
}

// One frame, over and over, as launches and as a graph.
void one_frame(const Bench& bench, l4d_cuda_renderer* r, const l4d_cuda_image& image,
               cudaStream_t stream) {
  const auto one = [&] {
    must(l4d_cuda_renderer_render(r, 1.0, &bench.camera_of(0), &image, stream));
  };
  one();
  check(cudaStreamSynchronize(stream));
  print("one frame, launched", time_runs(kRuns, stream, [&](int) { one(); }));
  cudaGraph_t captured = nullptr;
  cudaGraphExec_t replay = nullptr;
  check(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal));
  one();
  check(cudaStreamEndCapture(stream, &captured));
  check(cudaGraphInstantiate(&replay, captured, 0));
  print("one frame, as a CUDA graph",
        time_runs(kRuns, stream, [&](int) { check(cudaGraphLaunch(replay, stream)); }));
  cudaGraphExecDestroy(replay);
  cudaGraphDestroy(captured);
}

struct Destroy {
  void operator()(l4d_cuda_renderer* r) const { l4d_cuda_renderer_destroy(r); }
};
using Renderer = std::unique_ptr<l4d_cuda_renderer, Destroy>;

Renderer make_renderer(const Bench& bench, uint32_t format, bool timed) {
  l4d_cuda_renderer_options options = L4D_INIT(l4d_cuda_renderer_options);
  options.sh_format = format;
  options.time_passes = timed;
  l4d_cuda_renderer* r = nullptr;
  if (l4d_cuda_renderer_create(&options, &r) != L4D_OK) std::exit(1);
  must(l4d_cuda_renderer_set_gaussians(r, &bench.device, &bench.scene.timeline));
  l4d_cuda_frame_capacity capacity = L4D_INIT(l4d_cuda_frame_capacity);
  capacity.width = bench.size.width;
  capacity.height = bench.size.height;
  capacity.visible = bench.scene.count();
  capacity.instances = 16 * bench.scene.count();
  must(l4d_cuda_renderer_reserve(r, &capacity));
  return Renderer(r);
}

void forward(const Bench& bench, uint32_t format) {
  const Renderer renderer = make_renderer(bench, format, false);
  l4d_cuda_renderer* r = renderer.get();
  cudaStream_t stream;
  check(cudaStreamCreate(&stream));
  const Array<float> rgb(3 * bench.size.pixels());
  const Array<uint32_t> rgba8(bench.size.pixels());
  l4d_cuda_image image = L4D_INIT(l4d_cuda_image);
  image.rgb = rgb.get();
  const bool half = format == L4D_CUDA_SH_FLOAT16;
  const auto frame = [&](int k) {
    must(l4d_cuda_renderer_render(r, bench.time_of(k), &bench.camera_of(k), &image, stream));
  };
  std::printf("\n## %zu Gaussians, %ux%u, SH in %s\n", bench.scene.count(), bench.size.width,
              bench.size.height, half ? "binary16" : "binary32");
  print("forward, another instant each", time_runs(kRuns, stream, frame));
  print("forward, one instant", time_runs(kRuns, stream, [&](int k) {
          must(l4d_cuda_renderer_render(r, 1.0, &bench.camera_of(k), &image, stream));
        }));
  l4d_cuda_image bytes = L4D_INIT(l4d_cuda_image);
  bytes.rgba8 = rgba8.get();
  print("forward to RGBA8", time_runs(kRuns, stream, [&](int k) {
          must(l4d_cuda_renderer_render(r, bench.time_of(k), &bench.camera_of(k), &bytes, stream));
        }));
  frame(0);
  one_frame(bench, r, image, stream);
  stages(bench, make_renderer(bench, format, true).get(), image, stream, half);
  cudaStreamDestroy(stream);
}

void sensitivity(const Bench& bench, const std::vector<l4d_camera>& cameras, int instants) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = L4D_BACKEND_CUDA;
  RendererHandle renderer(&options);
  renderer.set_gaussians(bench.scene.view(), bench.scene.timeline);
  for (const uint32_t metric : {L4D_SENSITIVITY_SUM, L4D_SENSITIVITY_GAUSS_NEWTON}) {
    for (const bool visibility_only : {false, true}) {
      l4d_sensitivity_options o = L4D_INIT(l4d_sensitivity_options);
      o.metric = metric;
      if (visibility_only && metric != L4D_SENSITIVITY_SUM) continue;
      SensitivityHandle sums(&o, bench.scene.count(), bench.scene.sh_degree);
      renderer.set_time(0.1);
      sums.add_view(renderer, cameras[0], visibility_only);
      check(cudaDeviceSynchronize());
      const auto start = std::chrono::steady_clock::now();
      int views = 0;
      for (int t = 0; t < instants; ++t) {
        renderer.set_time(bench.time_of(t));
        for (const l4d_camera& camera : cameras) {
          sums.add_view(renderer, camera, visibility_only);
          ++views;
        }
      }
      check(cudaDeviceSynchronize());
      const double s =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      std::printf(
          "%ux%u, %s: %d views in %.2f s, %.3f ms a view; 21,600 views %.1f s, 4,050 views %.2f "
          "s\n",
          cameras[0].width, cameras[0].height,
          visibility_only                 ? "visibility only"
          : metric == L4D_SENSITIVITY_SUM ? "SUM"
                                          : "GAUSS_NEWTON",
          views, s, 1e3 * s / views, 21600 * s / views, 4050 * s / views);
    }
  }
}

}  // namespace

int main(int argc, char** argv) {
  uint32_t count = 0;
  if (l4d_cuda_get_device_count(&count) != L4D_OK || count == 0) {
    std::puts("SKIPPED: there is no CUDA device");
    return 0;
  }
  const double rate = copy_rate();
  std::printf("device copy %.2f TB/s\n", 1e-12 * rate);
  std::vector<std::string> scenes;
  Size size;
  bool all = true;
  for (int k = 1; k < argc; ++k) {
    const std::string word = argv[k];
    Size given;
    if (word == "forward") {
      all = false;
    } else if (std::sscanf(argv[k], "%ux%u", &given.width, &given.height) == 2) {
      size = given;
    } else {
      scenes.push_back(word);
    }
  }
  if (scenes.empty()) scenes = {"620000", "1240000"};
  for (const std::string& name : scenes) {
    io::SynthOptions options;
    options.gaussians = std::strtoull(name.c_str(), nullptr, 0);
    const bool made = options.gaussians > 0;
    const std::string beside = name.substr(0, name.rfind('/') + 1) + "cameras.json";
    std::vector<io::Camera> views;
    if (!made && std::ifstream(beside).good()) views = io::read_cameras(beside).cameras;
    const Bench bench(made ? io::synthesize(options) : io::read_scene_ply(name), views, size, rate);
    forward(bench, L4D_CUDA_SH_FLOAT16);
    if (!all) continue;
    forward(bench, L4D_CUDA_SH_FLOAT32);
    std::puts("");
    if (views.empty()) {
      sensitivity(bench, bench.cameras, 20);
      std::vector<l4d_camera> small;
      for (const l4d_camera& c : bench.cameras) small.push_back(with_size(c, {640, 360}));
      sensitivity(bench, small, 20);
    } else {
      std::vector<l4d_camera> own;
      for (const io::Camera& c : views) own.push_back(c.camera);
      sensitivity(bench, own, 30);
    }
  }
  return 0;
}
