// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/refine.h"

#include <gmock/gmock.h>

#include "training/run/train/output.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

// Pixels by which two cameras show the Gaussians of the truth apart, in the mean.
double apart(const l4d_camera& a, const l4d_camera& b) {
  const io::Scene truth = test::tiny_truth();
  double sum = 0, seen = 0;
  for (size_t i = 0; i < truth.count(); ++i) {
    double x[2], y[2], z[2];
    const l4d_camera* cameras[2] = {&a, &b};
    for (size_t k = 0; k < 2; ++k) {
      double at[3];
      for (size_t r = 0; r < 3; ++r) {
        const double* m = cameras[k]->world_to_camera + 4 * r;
        at[r] = m[3];
        for (size_t c = 0; c < 3; ++c) at[r] += m[c] * double{truth.position[3 * i + c]};
      }
      x[k] = cameras[k]->fx * at[0] / at[2] + cameras[k]->cx;
      y[k] = cameras[k]->fy * at[1] / at[2] + cameras[k]->cy;
      z[k] = at[2];
    }
    const bool shows = z[0] > 0 && x[0] > 0 && x[0] < a.width && y[0] > 0 && y[0] < a.height;
    if (!shows) continue;
    sum += std::hypot(x[1] - x[0], y[1] - y[0]);
    ++seen;
  }
  return sum / seen;
}

// Of the right scene, which stays as it is.
struct Training {
  explicit Training(Capture* capture)
      : loader(*capture, 1),
        instants(instants_of(*capture, "train")),
        store(make_image_store(loader, instants, {}, nullptr)),
        backend(make_cpu_backend(1)),
        trainer(settings(), *capture, loader, instants, store.get(), backend.get(), 1),
        refinement(settings(), capture, &loader, &trainer) {
    trainer.start(model_of(test::tiny_truth()));
    trainer.state().rate_factor = 0;
  }
  static Settings settings() {
    Settings settings;
    settings.steps = 450;
    settings.views = 4;
    settings.exposure = "off";
    settings.density = "off";
    settings.refine_times = 2;
    settings.refine_cameras = 2;
    return settings;
  }
  ImageLoader loader;
  std::vector<Instant> instants;
  std::unique_ptr<ImageStore> store;
  std::unique_ptr<Backend> backend;
  Trainer trainer;
  Refinement refinement;
};

// The scene is right, and some numbers of two cameras are not.
TEST(Refine, FindsClocksPlacesAndLenses) {
  constexpr uint32_t kTurned = 6, kLate = 10;
  const Capture truth = read_capture(test::tiny_capture(), {});
  Capture capture = truth;
  const double half_a_frame = 0.5 / capture.fps;
  test::turn(&capture.cameras[kTurned].source.camera, 1);
  capture.cameras[kTurned].source.camera.fx *= 1.03;
  capture.cameras[kTurned].source.camera.fy *= 1.03;
  for (CaptureView& view : capture.views) {
    if (view.camera == kLate) view.time += half_a_frame;
  }
  std::stable_sort(capture.views.begin(), capture.views.end(),
                   [](const CaptureView& a, const CaptureView& b) { return a.time < b.time; });
  const Capture given = capture;

  Training training(&capture);
  Trainer& trainer = training.trainer;
  Refinement& refinement = training.refinement;
  const ImageLoader& loader = training.loader;
  while (!trainer.done()) {
    const StepReport step = trainer.advance();
    EXPECT_EQ(step.view_gradients.empty(), step.progress < 0.1);
    refinement.advance(step);
  }

  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    const CaptureCamera& camera = capture.cameras[c];
    const double late = c == kLate ? -half_a_frame : 0;
    EXPECT_NEAR(camera.change[kTime], late, 0.2 * half_a_frame) << c;
    // Of a place and a lens, images tell together what they do to them, and each by itself less.
    const l4d_camera& right = truth.cameras[c].source.camera;
    EXPECT_LT(apart(right, loader.camera(c)), 0.1) << c;
    if (c == kTurned) {
      EXPECT_GT(apart(right, given.cameras[c].source.camera), 0.8);
      EXPECT_LT(camera.change[kTurn + 1], -0.01);
      EXPECT_LT(camera.change[kFocal], -0.01);
    }
    if (camera.split == "test") {
      EXPECT_EQ(camera.change, CameraChange{}) << c;
    }
  }
  for (uint32_t k = 0; k < capture.views.size(); ++k) {
    if (capture.views[k].camera != kLate) continue;
    const double by = capture.cameras[kLate].change[kTime];
    EXPECT_NEAR(capture.time_of(k), std::max(0.0, capture.views[k].time + by), 1e-12);
  }
  EXPECT_THAT(refinement.notes(), testing::ElementsAre(testing::HasSubstr("camera 10 "),
                                                       testing::HasSubstr("camera 6 ")));

  // As a file, and back.
  const test::Folder folder;
  write_refined(folder / "refined.json", capture, true);
  Capture again = given;
  ImageLoader its(again, 1);
  follow_refined(folder / "refined.json", &again, &its);
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    const l4d_camera &one = loader.camera(c), &other = its.camera(c);
    EXPECT_TRUE(std::equal(one.world_to_camera, one.world_to_camera + 12, other.world_to_camera));
    EXPECT_EQ(one.fx, other.fx);
    EXPECT_NEAR(again.cameras[c].change[kTime], capture.cameras[c].change[kTime], 1e-12);
  }
  again.cameras.pop_back();
  EXPECT_THROW(follow_refined(folder / "refined.json", &again, &its), io::Error);
}

// Where all steps of a camera go one way; what is no number is left out.
TEST(Refine, EndsAtItsBounds) {
  Capture capture = read_capture(test::tiny_capture(), {});
  Training training(&capture);
  StepReport step;
  step.progress = 0.1;
  step.views = {training.instants[0].views[1]};
  const CaptureCamera& camera = capture.cameras[capture.views[step.views[0]].camera];
  step.view_gradients = {{0, 0, 0, 0, 0, 0, 0, std::nan(""), 0}};
  training.refinement.advance(step);
  EXPECT_EQ(camera.change, CameraChange{});
  step.view_gradients = {{1e-3, 0, 0, 0, 0, 0, 0, 0, 0}};
  for (int k = 0; k < 300; ++k) training.refinement.advance(step);
  EXPECT_DOUBLE_EQ(camera.change[kTime], -2 / capture.fps);
  EXPECT_THAT(training.refinement.notes(),
              testing::Contains(camera.name + " is at the bound of --refine-times."));
}

// A world that moves is no change of the cameras in it, but for the one that also moves by itself.
TEST(Refine, HoldsTheWorld) {
  const Capture capture = read_capture(test::tiny_capture(), {});
  const CaptureFrame frame = frame_of(capture);
  std::vector<uint32_t> cameras;
  std::vector<RefinedCamera> refined(capture.cameras.size());
  const double spin[3] = {1e-4, -2e-4, 3e-4}, shift[3] = {2e-4, 1e-4, -1e-4}, growth = 1e-4;
  for (uint32_t c = 0; c < capture.cameras.size(); ++c) {
    if (capture.cameras[c].split != "train") continue;
    cameras.push_back(c);
    double center[3], from[3], moved[3];
    camera_center(capture.cameras[c].source.camera, center);
    for (size_t k = 0; k < 3; ++k) from[k] = center[k] - frame.center[k];
    for (size_t k = 0; k < 3; ++k) {
      const size_t d = (k + 1) % 3, e = (k + 2) % 3;
      moved[k] = spin[d] * from[e] - spin[e] * from[d] + shift[k] + growth * from[k];
    }
    // A camera that goes with the world: R' = R exp(-spin), and its centre moves.
    const double* m = capture.cameras[c].source.camera.world_to_camera;
    for (size_t r = 0; r < 3; ++r) {
      for (size_t k = 0; k < 3; ++k) {
        refined[c].change[kTurn + r] -= m[4 * r + k] * spin[k];
        refined[c].change[kMove + r] -= m[4 * r + k] * moved[k];
      }
    }
    refined[c].change[kTime] = 0.01;
    refined[c].change[kFocal] = -0.002;
  }
  refined[3].change[kTurn] += 0.005;
  hold_medians(capture, cameras, &refined);
  for (const uint32_t c : cameras) {
    for (size_t k = 0; k < refined[c].change.size(); ++k) {
      const double own = c == 3 && k == kTurn ? 0.005 : 0;
      EXPECT_NEAR(refined[c].change[k], own, 2e-5) << c << " " << k;
    }
  }
}

}  // namespace
}  // namespace l4d::train
