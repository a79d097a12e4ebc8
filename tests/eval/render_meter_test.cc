// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "eval/image/fidelity_meter.h"
#include "eval/image/image_comparison.h"
#include "io/synth/synth.h"

namespace l4d::eval {
namespace {

struct Setting {
  io::Scene scene;
  CameraViews views;

  Setting() {
    io::SynthOptions options;
    options.gaussians = 800;
    options.seconds = 1;
    scene = io::synthesize(options);
    views.set = io::orbit_cameras(instant_of(scene, middle_of(scene.timeline)), 3, 48, 32);
    views.views = io::select_views(views.set, {"all", "", "0:30:10"}, scene.timeline);
  }
};

TEST(FidelityMeter, EqualScenesHaveTheGreatestFidelity) {
  const Setting s;
  Observer observer;
  RenderedScene original({}, &s.scene, "original"), same({}, &s.scene, "same");
  FidelityMeter meter(original, s.views, {}, observer);
  EXPECT_EQ(meter.num_views(), 9u);
  EXPECT_EQ(meter.fidelity(same, observer).psnr, kMaxDecibels);
}

// Whether renders of the original are kept or made again changes no figure, and both ways of
// comparing agree.
TEST(FidelityMeter, AgreesWithAComparisonOfImages) {
  const Setting s;
  Observer observer;
  io::Scene faint = s.scene;
  for (float& opacity : faint.opacity) opacity *= 0.9f;
  RenderedScene original({}, &s.scene, "original"), coded({}, &faint, "coded");
  const ImageComparison compared =
      compare_images(original, coded, s.views, false, nullptr, 1, observer);
  const io::Fidelity expected = compared.summary(&ViewFidelity::fidelity);
  EXPECT_GT(expected.psnr, 10);
  EXPECT_LT(expected.psnr, 60);
  for (const uint64_t bytes : {uint64_t{0}, uint64_t{1} << 30}) {
    MeterOptions options;
    options.max_render_bytes = bytes;
    FidelityMeter meter(original, s.views, options, observer);
    EXPECT_DOUBLE_EQ(meter.fidelity(coded, observer).psnr, expected.psnr);
  }
}

TEST(CheckedFidelity, NamesTheWorstCameraAndInstant) {
  CameraViews views;
  for (const int id : {7, 8, 9}) {
    io::Camera camera;
    camera.id = id;
    views.set.cameras.push_back(camera);
  }
  // Two instants that all cameras see, and one of a single view, which is no instant's.
  views.views = {{0, 0.0}, {1, 0.0}, {2, 0.0}, {0, 0.5}, {1, 0.5}, {2, 0.5}, {0, 0.9}};
  const CheckedFidelity f = checked_fidelity(views, {1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 4e-4, 9e-4});
  EXPECT_NEAR(f.psnr, -10 * std::log10(18e-4 / 7), 1e-9);
  EXPECT_EQ(f.camera, 7);
  EXPECT_NEAR(f.worst_camera, -10 * std::log10(11e-4 / 3), 1e-9);
  EXPECT_EQ(f.instant, 0.5);
  EXPECT_NEAR(f.worst_instant, -10 * std::log10(6e-4 / 3), 1e-9);
}

TEST(RenderedScene, MessagesNameTheScene) {
  const unsigned char nothing[1] = {0};
  try {
    RenderedScene broken({}, StreamBytes{nothing, 1}, "broken.l4d");
    ADD_FAILURE() << "opened";
  } catch (const io::Error& error) {
    EXPECT_EQ(std::string(error.what()).rfind("broken.l4d: ", 0), 0u) << error.what();
  }
}

}  // namespace
}  // namespace l4d::eval
