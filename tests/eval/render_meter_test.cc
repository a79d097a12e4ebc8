// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "eval/fidelity_meter.h"
#include "eval/image_comparison.h"
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
    const io::Fidelity measured = meter.fidelity(coded, observer, true, 1);
    EXPECT_EQ(measured.psnr, expected.psnr);
    EXPECT_EQ(measured.min_psnr, expected.min_psnr);
    EXPECT_EQ(measured.mean_ssim, expected.mean_ssim);
  }
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
