// SPDX-License-Identifier: Apache-2.0
// Views per second that whole steps train, of one device and of several that share the views of
// each step, by the clock of the host.
//
//   gpu_train_group_bench [WIDTHxHEIGHT] [devices 0,1] [gaussians]
//
// Without arguments: 656000 Gaussians of a synthetic scene at 1352x1014, half a million of which
// are visible at a time, and all devices of the machine, or the first one twice. Targets are
// pictures of the scene. Views a step: 4, 8 and 16.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "io/camera/cameras.h"
#include "io/synth/synth.h"
#include "l4d/cuda.h"
#include "l4d/l4d.hpp"
#include "training/run/setup/settings.h"
#include "training/step/cuda_backend.h"
#include "training/step/schedule.h"

namespace {

using namespace l4d;
using namespace l4d::train;

constexpr int kWarmUp = 20, kSteps = 200;
constexpr size_t kInstants = 8, kCameras = 16;

// A scene with pictures of it.
struct Task {
  Task(uint64_t gaussians, uint32_t width, uint32_t height) {
    io::SynthOptions options;
    options.gaussians = gaussians;
    options.seconds = 40;
    scene = io::synthesize(options);
    for (const io::Camera& c : io::orbit_cameras(scene, kCameras, width, height).cameras) {
      cameras.push_back(c.camera);
    }
    io::opacity_to_logit(scene);
    const auto backend = make_cuda_backend(0);
    backend->load(model(), scene.timeline);
    const float black[3] = {0, 0, 0};
    for (size_t k = 0; k < kInstants * kCameras; ++k) {
      const io::Image image = backend->render(cameras[k % kCameras], time(k / kCameras), black);
      std::vector<uint8_t> bytes;
      for (const float x : image.rgb) {
        bytes.push_back(static_cast<uint8_t>(255 * std::clamp(x, 0.0f, 1.0f)));
      }
      targets.push_back(std::move(bytes));
    }
  }
  double time(size_t instant) const {
    const double share = (static_cast<double>(instant) + 0.5) / kInstants;
    return scene.timeline.time_begin + io::duration(scene.timeline) * share;
  }
  ModelState model() const {
    ModelState state;
    state.allocate(scene.count(), 3);
    state.count = scene.count();
    for (size_t i = 0; i < scene.count(); ++i) state.id[i] = static_cast<uint32_t>(i);
    for_each_attribute(
        [](const AttributeInfo&, const std::vector<float>& from, std::vector<float>& to) {
          std::copy(from.begin(), from.end(), to.begin());
        },
        scene, state.value);
    return state;
  }
  StepInput input(uint64_t step, size_t views) const {
    ScheduleOptions options;
    options.duration = io::duration(scene.timeline);
    StepInput in;
    in.adam = adam_step_at(options, 0.5, 1, step, 0);
    // As small as derivatives are near the end, so that the scene stays what it is.
    in.adam.rates = {};
    in.adam.noise = 0;
    const size_t instant = static_cast<size_t>(step) % kInstants;
    in.measure = step % 8 == 0;
    for (size_t k = 0; k < views; ++k) {
      StepView view;
      const size_t camera = (static_cast<size_t>(step) * views + k) % kCameras;
      view.camera = cameras[camera];
      view.time = time(instant);
      view.image = instant * kCameras + camera;
      view.target = targets[view.image].data();
      in.views.push_back(view);
    }
    return in;
  }

  io::Scene scene;
  std::vector<l4d_camera> cameras;
  std::vector<std::vector<uint8_t>> targets;
};

struct Result {
  double step_ms = 0, exchange_ms = 0;  // median; mean
};

Result measure(Backend* backend, const Task& task, size_t views) {
  using Clock = std::chrono::steady_clock;
  backend->load(task.model(), task.scene.timeline);
  std::vector<double> ms;
  for (int k = 1; k <= kWarmUp + kSteps; ++k) {
    if (k == kWarmUp + 1) backend->take_seconds();
    const StepInput input = task.input(static_cast<uint64_t>(k), views);
    const Clock::time_point begin = Clock::now();
    backend->step(input);
    if (k <= kWarmUp) continue;
    ms.push_back(std::chrono::duration<double, std::milli>(Clock::now() - begin).count());
  }
  std::nth_element(ms.begin(), ms.begin() + kSteps / 2, ms.end());
  return {ms[kSteps / 2], 1e3 * backend->take_seconds()[kExchange] / kSteps};
}

void run(uint64_t gaussians, uint32_t width, uint32_t height, const std::string& list) {
  const Task task(gaussians, width, height);
  std::printf("%llu Gaussians, %ux%u, %d steps a row\n\n",
              static_cast<unsigned long long>(gaussians), width, height, kSteps);
  std::printf("| devices | sums go by | views a step | ms a step | exchange | views/s | ratio |\n");
  std::printf("|---|---|---:|---:|---:|---:|---:|\n");
  for (const size_t views : {4U, 8U, 16U}) {
    double one = 0;
    const auto row = [&](const std::string& devices, Transport transport, const char* name) {
      const auto backend = make_cuda_group(devices_of(devices), transport);
      const Result r = measure(backend.get(), task, views);
      const double rate = 1e3 / r.step_ms * static_cast<double>(views);
      if (one == 0) one = rate;
      std::printf("| %s | %s | %zu | %.3f | %.3f | %.0f | %.2f |\n", devices.c_str(), name, views,
                  r.step_ms, r.exchange_ms, rate, rate / one);
    };
    row(list.substr(0, list.find(',')), Transport::kDirect, "-");
    row(list, Transport::kDirect, "kernels");
    row(list, Transport::kCopies, "copies");
  }
}

}  // namespace

int main(int argc, char** argv) {
  uint32_t count = 0;
  if (l4d_cuda_get_device_count(&count) != L4D_OK || count == 0) {
    std::puts("SKIPPED: there is no CUDA device");
    return 0;
  }
  std::string list = count == 1 ? "0,0" : "0";
  for (uint32_t k = 1; k < std::min(count, 8u); ++k) list += "," + std::to_string(k);
  uint64_t gaussians = 656000;
  unsigned width = 1352, height = 1014;
  for (int k = 1; k < argc; ++k) {
    unsigned w = 0, h = 0;
    if (std::sscanf(argv[k], "%ux%u", &w, &h) == 2) {
      width = w;
      height = h;
    } else if (std::string(argv[k]) == "devices" && k + 1 < argc) {
      list = argv[++k];
    } else {
      gaussians = std::strtoull(argv[k], nullptr, 10);
    }
  }
  try {
    run(gaussians, width, height, list);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
