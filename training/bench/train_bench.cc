// SPDX-License-Identifier: Apache-2.0
// Microseconds of each stage of a training step on a device, and views that steps train per second,
// by the device's own clock.
//
//   gpu_train_bench [WIDTHxHEIGHT] [steps] [gaussians | scene ...]
//
// Numbers are sizes of the synthetic scene; others are files, whose cameras are those of a
// cameras.json beside them, or else on an orbit. Without arguments: 656000 Gaussians at 1352x1014,
// half a million of which are visible at a time. Targets are pictures of the scene itself with
// noise, so derivatives are those of a model that is nearly trained. steps: nothing but some whole
// steps, for a profiler.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "bench/gpu/render_timing.h"
#include "io/camera/cameras.h"
#include "io/ply/scene_ply.h"
#include "io/synth/synth.h"
#include "l4d/cuda.h"
#include "l4d/experimental/cuda_train.h"
#include "training/cuda/device_model.h"
#include "training/cuda/loss_device.h"
#include "training/step/schedule.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr int kRuns = 200;

void must(const Status& status) {
  if (status.ok()) return;
  std::fprintf(stderr, "%s\n", status.detail().c_str());
  std::exit(1);
}

struct View {
  View(size_t pixels, uint32_t width, uint32_t height)
      : rgb(3 * pixels),
        gradient(3 * pixels),
        factors(9 * pixels),
        error(pixels),
        partial(train::loss_partial_size(width, height)),
        target(3 * pixels) {}
  Array<float> rgb, gradient, factors, error;
  Array<double> partial;
  Array<uint8_t> target;
};

// A step of a model in device memory, stage by stage; no stage waits for the device.
class Step {
 public:
  Step(const io::Scene& scene, const std::vector<l4d_camera>& cameras, uint32_t views, bool timed)
      : scene_(scene), cameras_(cameras), counts_(views), flags_(4) {
    counts_.clear();
    flags_.clear();
    io::opacity_to_logit(scene_);
    train::ModelState state;
    state.allocate(scene_.count(), 3);
    state.count = scene_.count();
    for (size_t i = 0; i < scene_.count(); ++i) state.id[i] = static_cast<uint32_t>(i);
    for_each_attribute(
        [](const AttributeInfo&, const std::vector<float>& from, std::vector<float>& to) {
          std::copy(from.begin(), from.end(), to.begin());
        },
        scene_, state.value);
    must(model_.load(state, nullptr));
    check(cudaStreamCreate(&stream_));
    l4d_cuda_renderer_options options = L4D_INIT(l4d_cuda_renderer_options);
    options.time_passes = timed;
    if (l4d_cuda_trainable_create(&options, &live_) != L4D_OK) std::exit(1);
    const l4d_gaussians g = model_.gaussians();
    ok(l4d_cuda_trainable_set_scene(live_, &g, &scene_.timeline, nullptr));
    l4d_cuda_frame_capacity capacity = L4D_INIT(l4d_cuda_frame_capacity);
    capacity.width = cameras[0].width;
    capacity.height = cameras[0].height;
    capacity.visible = scene_.count();
    capacity.instances = std::max<uint64_t>(6 * scene_.count(), 1u << 20);
    ok(l4d_cuda_trainable_reserve(live_, &capacity, views));
    const size_t pixels = size_t{capacity.width} * capacity.height;
    for (uint32_t v = 0; v < views; ++v) {
      views_.push_back(std::make_unique<View>(pixels, capacity.width, capacity.height));
      train::DeviceLossView& loss = batch_.views[batch_.count++];
      loss.view.width = capacity.width;
      loss.view.height = capacity.height;
      loss.view.rendered = views_[v]->rgb.get();
      loss.view.target = views_[v]->target.get();
      loss.view.ssim_weight = 0.2f;
      loss.factors = views_[v]->factors.get();
      loss.partial = views_[v]->partial.get();
      loss.sums = counts_.get() + v;
      loss.rgb_gradient = views_[v]->gradient.get();
      loss.weight = 1 / static_cast<float>(views);
    }
    begin(0);
    refresh();
    forward();
    make_targets(pixels);
    train::ScheduleOptions schedule;
    schedule.duration = io::duration(scene_.timeline);
    adam_ = train::adam_step_at(schedule, 0.5, 1, 1000, 0);
    adam_.count = scene_.count();
    adam_.active_sh_degree = 3;
    // As small as derivatives are near the end, so that the scene stays what it is.
    adam_.rates = {};
    adam_.noise = 0;
  }
  ~Step() {
    cudaStreamSynchronize(stream_);
    l4d_cuda_trainable_destroy(live_);
    cudaStreamDestroy(stream_);
  }
  cudaStream_t stream() const { return stream_; }

  // Chooses the instant and the cameras of step k.
  void begin(int k) {
    const double share = (k % 97 + 0.5) / 97;
    chosen_.clear();
    for (size_t v = 0; v < views_.size(); ++v) {
      l4d_cuda_trainable_view view = L4D_INIT(l4d_cuda_trainable_view);
      view.camera = &cameras_[(static_cast<size_t>(k) * views_.size() + v) % cameras_.size()];
      view.time = scene_.timeline.time_begin + io::duration(scene_.timeline) * share;
      view.rgb = views_[v]->rgb.get();
      chosen_.push_back(view);
    }
  }
  void refresh() { ok(l4d_cuda_trainable_refresh(live_, stream_)); }
  void forward() { ok(l4d_cuda_trainable_forward(live_, chosen_.data(), count(), stream_)); }
  void loss() {
    train::launch_loss_forward(batch_, flags_.get(), stream_);
    train::launch_loss_backward(batch_, stream_);
  }
  void backward() {
    check(cudaMemsetAsync(model_.shown(), 0, scene_.count(), stream_));
    std::vector<l4d_cuda_trainable_loss> losses(views_.size());
    for (size_t v = 0; v < losses.size(); ++v) {
      losses[v] = L4D_INIT(l4d_cuda_trainable_loss);
      losses[v].rgb_gradient = views_[v]->gradient.get();
    }
    l4d_cuda_trainable_statistics statistics = L4D_INIT(l4d_cuda_trainable_statistics);
    statistics.shown = model_.shown();
    const l4d_gradients gradients = model_.gradients();
    ok(l4d_cuda_trainable_backward(live_, losses.data(), count(), &gradients, &statistics,
                                   stream_));
  }
  // sparse: of the rows that the step shows.
  void adam(bool sparse = false) {
    train::AdamStep adam = adam_;
    adam.sparse = sparse;
    train::launch_adam(adam, model_.adam_arrays(), model_.sh_updates(), flags_.get(),
                       reinterpret_cast<unsigned long long*>(flags_.get() + 2), stream_);
  }
  void density() {
    train::DensityStep step;
    step.step = 41;
    step.count = scene_.count();
    step.sh_degree = 3;
    train::launch_change_density(step, model_.density_arrays(), model_.relocation_memory(),
                                 &change_of(), stream_);
  }
  void renew_weights() { must(model_.accumulate_weights(1, stream_)); }
  void whole(int k) {
    begin(k);
    refresh();
    forward();
    loss();
    backward();
    adam();
  }
  l4d_cuda_trainable_report report() {
    l4d_cuda_trainable_report out = L4D_INIT(l4d_cuda_trainable_report);
    ok(l4d_cuda_trainable_copy_report(live_, stream_));
    ok(l4d_cuda_trainable_get_report(live_, 1, &out));
    return out;
  }

 private:
  uint32_t count() const { return static_cast<uint32_t>(views_.size()); }
  void ok(l4d_status status) const {
    if (status == L4D_OK) return;
    std::fprintf(stderr, "%s\n", l4d_last_error_message());
    std::exit(1);
  }
  train::DeviceDensityChange& change_of() {
    return *reinterpret_cast<train::DeviceDensityChange*>(change_.get());
  }
  void make_targets(size_t pixels) {
    check(cudaStreamSynchronize(stream_));
    std::vector<float> rgb(3 * pixels);
    std::vector<uint8_t> bytes(3 * pixels);
    uint32_t random = 1;
    for (const auto& view : views_) {
      check(cudaMemcpy(rgb.data(), view->rgb.get(), rgb.size() * sizeof(float),
                       cudaMemcpyDeviceToHost));
      for (size_t i = 0; i < rgb.size(); ++i) {
        random = random * 1664525 + 1013904223;
        const float noisy = 255 * rgb[i] + static_cast<float>(random >> 24) / 16 - 8;
        bytes[i] = static_cast<uint8_t>(std::min(std::max(noisy, 0.0f), 255.0f));
      }
      check(cudaMemcpy(view->target.get(), bytes.data(), bytes.size(), cudaMemcpyHostToDevice));
    }
  }

  io::Scene scene_;
  std::vector<l4d_camera> cameras_;
  train::DeviceModel model_;
  std::vector<std::unique_ptr<View>> views_;
  Array<train::DeviceLossSums> counts_;
  Array<uint32_t> flags_;
  Array<unsigned long long> change_{2};
  std::vector<l4d_cuda_trainable_view> chosen_;
  train::DeviceLossBatch batch_{};
  train::AdamStep adam_;
  l4d_cuda_trainable* live_ = nullptr;
  cudaStream_t stream_ = nullptr;
};

// The device's time of one stage of step k; the others run, too.
template <class Run>
double stage_time(Step* step, const Run& run) {
  return 1e3 * time_runs(kRuns / 2, step->stream(), run).median;
}

void measure(const io::Scene& scene, const std::vector<l4d_camera>& cameras, const char* name,
             uint32_t views, bool steps_alone) {
  Step step(scene, cameras, views, false);
  step.whole(0);
  if (steps_alone) {
    for (int k = 1; k < 20; ++k) step.whole(k);
    return;
  }
  const l4d_cuda_trainable_report r = step.report();
  std::printf("\n## %s, %ux%u, %u view%s a step\n", name, cameras[0].width, cameras[0].height,
              views, views == 1 ? "" : "s");
  std::printf("%zu Gaussians, %llu visible, %llu in view, %llu instances, %llu views skipped\n",
              scene.count(), static_cast<unsigned long long>(r.visible),
              static_cast<unsigned long long>(r.projected),
              static_cast<unsigned long long>(r.instances),
              static_cast<unsigned long long>(r.skipped));
  std::printf("| stage | us a step |\n|---|---:|\n");
  const auto row = [&](const char* what, double us) { std::printf("| %s | %.0f |\n", what, us); };
  row("prepare rows", stage_time(&step, [&](int) { step.refresh(); }));
  row("forward, with slice", stage_time(&step, [&](int k) {
        step.begin(k);
        step.forward();
      }));
  row("loss, SSIM, both ways", stage_time(&step, [&](int) { step.loss(); }));
  // A backward pass may be repeated: it goes on from the same forward.
  row("backward", stage_time(&step, [&](int) { step.backward(); }));
  row("Adam", stage_time(&step, [&](int) { step.adam(); }));
  row("Adam of shown rows", stage_time(&step, [&](int) { step.adam(true); }));
  row("density", stage_time(&step, [&](int) { step.density(); }));
  row("weights of targets, every 100 steps", stage_time(&step, [&](int) { step.renew_weights(); }));
  const Timing all = time_runs(kRuns, step.stream(), [&](int k) { step.whole(k); });
  std::printf(
      "whole step: median %.3f ms, 99th percentile %.3f ms; %.0f steps/s, %.0f views/s of "
      "forward, loss, backward and Adam\n",
      all.median, all.p99, 1e3 / all.median, 1e3 / all.median * views);
  if (views > 1) return;
  Step timed(scene, cameras, views, true);
  double sums[L4D_RENDER_PASS_COUNT] = {};
  constexpr int kFrames = 64;
  for (int k = 0; k < kFrames; ++k) {
    // What the host launches ahead, so that the device never waits for it. A backward pass marks
    // its begin as the end of blending: passes of forwards are those of forwards alone.
    for (int ahead = 0; ahead < 4; ++ahead) timed.whole(k);
    sums[L4D_RENDER_PASS_BACKWARD] += timed.report().seconds[L4D_RENDER_PASS_BACKWARD] / kFrames;
    timed.refresh();
    timed.forward();
    const l4d_cuda_trainable_report r1 = timed.report();
    for (int s = 0; s < L4D_RENDER_PASS_BACKWARD; ++s) sums[s] += r1.seconds[s] / kFrames;
  }
  const char* names[] = {"slice", "project", "sort", "bin", "blend", "backward to splats"};
  for (int s = 0; s < L4D_RENDER_PASS_COUNT; ++s) row(names[s], 1e6 * sums[s]);
}

}  // namespace

int main(int argc, char** argv) {
  uint32_t count = 0;
  if (l4d_cuda_get_device_count(&count) != L4D_OK || count == 0) {
    std::puts("SKIPPED: there is no CUDA device");
    return 0;
  }
  unsigned width = 1352, height = 1014;
  std::vector<std::string> scenes;
  bool steps_alone = false;
  for (int k = 1; k < argc; ++k) {
    unsigned w = 0, h = 0;
    if (std::sscanf(argv[k], "%ux%u", &w, &h) == 2) {
      width = w;
      height = h;
    } else if (std::string(argv[k]) == "steps") {
      steps_alone = true;
    } else {
      scenes.push_back(argv[k]);
    }
  }
  if (scenes.empty()) scenes = {"656000"};
  for (const std::string& name : scenes) {
    io::SynthOptions options;
    options.gaussians = std::strtoull(name.c_str(), nullptr, 0);
    options.seconds = 40;
    const io::Scene scene =
        options.gaussians > 0 ? io::synthesize(options) : io::read_scene_ply(name);
    std::vector<l4d_camera> cameras;
    const std::string set = name.substr(0, name.rfind('/') + 1) + "cameras.json";
    if (options.gaussians == 0 && std::filesystem::exists(set)) {
      for (const io::Camera& c : io::read_cameras(set).cameras) cameras.push_back(c.camera);
    } else {
      for (const io::Camera& c : io::orbit_cameras(scene, 8, width, height).cameras) {
        cameras.push_back(c.camera);
      }
    }
    for (const uint32_t views : {1u, 4u}) {
      measure(scene, cameras, name.c_str(), views, steps_alone);
    }
  }
  return 0;
}
