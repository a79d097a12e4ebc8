// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <iostream>
#include <string>
#include <vector>

#include "tests/gpu/trainable_support.h"
#include "training/step/backend.h"
#include "training/step/schedule.h"

// A small training, for tests of back ends.
namespace l4d::train::test {

using l4d::test::Random;

// 3,000 Gaussians that cameras in a ring see at four instants.
struct Capture {
  explicit Capture(uint32_t views) : truth(render::synth(3000, 7)) {
    RendererHandle renderer = render::make_renderer(L4D_BACKEND_CPU);
    renderer.set_gaussians(truth.view(), truth.timeline);
    for (uint32_t v = 0; v < views; ++v) {
      cameras.push_back(render::ring_camera(96, 64, 6.28 * v / views));
      for (int t = 0; t < 4; ++t) {
        renderer.set_time(0.5 + t);
        std::vector<uint8_t> image;
        for (const float x : renderer.render(cameras[v])) {
          image.push_back(static_cast<uint8_t>(
              std::lround(255 * std::min(std::max(static_cast<double>(x), 0.0), 1.0))));
        }
        targets.push_back(image);
      }
    }
  }
  StepInput input(uint64_t step, const ScheduleOptions& options, bool sparse) const {
    StepInput in;
    const size_t t = static_cast<size_t>(step % 4);
    in.adam = adam_step_at(options, 0.4, 1, step, 0);  // SH of all degrees
    in.adam.sparse = sparse;
    in.measure = step % 3 == 0;
    for (size_t k = 0; k < 3; ++k) {
      const size_t camera = (static_cast<size_t>(step) * 3 + k) % cameras.size();
      StepView view;
      view.camera = cameras[camera];
      view.time = 0.5 + static_cast<double>(t) + 0.01 * static_cast<double>(k);
      view.image = camera * 4 + t;
      view.target = targets[camera * 4 + t].data();
      in.views.push_back(view);
    }
    return in;
  }
  io::Scene truth;
  std::vector<l4d_camera> cameras;
  std::vector<std::vector<uint8_t>> targets;
};

// The true scene, disturbed.
inline ModelState start_of(const io::Scene& truth, uint64_t capacity, uint32_t degree) {
  io::Scene scene = render::with_degree(truth, degree);
  io::opacity_to_logit(scene);
  ModelState state;
  state.allocate(capacity, degree);
  state.count = scene.count();
  state.next_id = static_cast<uint32_t>(scene.count());
  Random random(4);
  for_each_attribute(
      [&](const AttributeInfo& a, const std::vector<float>& from, std::vector<float>& to) {
        for (size_t i = 0; i < from.size(); ++i) {
          to[i] = from[i] + 0.02f * static_cast<float>(random.normal());
        }
        static_cast<void>(a);
      },
      scene, state.value);
  for (size_t i = 0; i < scene.count(); ++i) state.id[i] = static_cast<uint32_t>(i);
  return state;
}

inline ScheduleOptions schedule_of(const Capture& capture, uint32_t degree) {
  ScheduleOptions options;
  options.radius = 6;
  options.duration = io::duration(capture.truth.timeline);
  options.sh_degree = degree;
  return options;
}

inline void expect_models(const ModelState& a, const ModelState& b, double most,
                          const std::string& what) {
  ASSERT_EQ(a.count, b.count) << what;
  const std::vector<float>* left[6] = {&a.value.position, &a.value.mean_t,  &a.value.log_scale,
                                       &a.value.rotor,    &a.value.opacity, &a.value.sh};
  const std::vector<float>* right[6] = {&b.value.position, &b.value.mean_t,  &b.value.log_scale,
                                        &b.value.rotor,    &b.value.opacity, &b.value.sh};
  for (size_t k = 0; k < 6; ++k) {
    const double distance = render::relative_distance(*left[k], *right[k]);
    std::cout << what << ", " << kAttributes[k].name << ": " << distance << "\n";
    EXPECT_LT(distance, most) << what << ", " << kAttributes[k].name;
  }
}

inline double psnr_of(Backend* backend, const Capture& capture) {
  double squared = 0, values = 0;
  const float black[3] = {0, 0, 0};
  for (size_t camera = 0; camera < capture.cameras.size(); ++camera) {
    for (size_t t = 0; t < 4; ++t) {
      const io::Image image =
          backend->render(capture.cameras[camera], 0.5 + static_cast<double>(t), black);
      const std::vector<uint8_t>& target = capture.targets[4 * camera + t];
      for (size_t i = 0; i < target.size(); ++i) {
        const double x = std::min(std::max(static_cast<double>(image.rgb[i]), 0.0), 1.0);
        squared += std::pow(x - target[i] / 255.0, 2);
        values += 1;
      }
    }
  }
  return -10 * std::log10(squared / values);
}

// random: with noise and births, whose rounding soon leads to another model.
inline ModelState trained(Backend* backend, const Capture& capture, bool sparse, bool random,
                          uint64_t steps, double* psnr) {
  const ScheduleOptions options = schedule_of(capture, 1);
  backend->load(start_of(capture.truth, 3600, 1), capture.truth.timeline);
  backend->renew_weights(0);
  for (uint64_t step = 1; step <= steps; ++step) {
    StepInput input = capture.input(step, options, sparse);
    if (!random) input.adam.noise = 0;
    EXPECT_TRUE(backend->step(input).finite);
    if (!random) continue;
    DensityStep density;
    density.seed = 1;
    density.step = step;
    density.turn = static_cast<uint32_t>(step % kCycle);
    density.time_end = options.duration;
    backend->change_density(density, 3);
    if (step % 100 == 0) backend->renew_weights(1);
  }
  *psnr = psnr_of(backend, capture);
  return backend->save();
}

}  // namespace l4d::train::test
