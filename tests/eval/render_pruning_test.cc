// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <set>

#include "eval/opacity_fit.h"
#include "eval/pruning.h"
#include "io/synth/synth.h"
#include "l4d/experimental/sensitivity.hpp"

namespace l4d::eval {
namespace {

constexpr size_t kCopies = 12;

// A scene whose Gaussians are piles of faint ones: each shows little, and all of them everything.
io::Scene faint_scene() {
  io::SynthOptions options;
  options.gaussians = 400;
  options.seconds = 0.4;
  options.effects = {"static", "rigid"};
  const io::Scene solid = io::synthesize(options);
  io::Scene scene = solid;
  scene.flags &= ~static_cast<uint32_t>(L4D_OPACITY_LOGIT);
  for (size_t copy = 1; copy < kCopies; ++copy) {
    for_each_attribute(
        [](const AttributeInfo&, const std::vector<float>& from, std::vector<float>& to) {
          to.insert(to.end(), from.begin(), from.end());
        },
        solid, scene);
  }
  for (size_t i = 0; i < scene.count(); ++i) {
    // Not all the same, so that thresholds divide a pile.
    scene.opacity[i] = 0.02f + 0.01f * static_cast<float>(i / solid.count());
    for (size_t k = 0; k < 3; ++k) {
      scene.position[3 * i + k] += 1e-3f * static_cast<float>((i * 7 + k * 13) % 11);
    }
  }
  return scene;
}

struct Setting {
  io::Scene scene = faint_scene();
  CameraViews views;
  io::Weights weights;

  Setting() {
    views.set = io::orbit_cameras(instant_of(scene, middle_of(scene.timeline)), 5, 64, 48);
    views.views = io::select_views(views.set, {"all", "", "0:12:4"}, scene.timeline);
    RendererHandle renderer;
    renderer.set_gaussians(scene.view(), scene.timeline);
    l4d_sensitivity_options options = L4D_INIT(l4d_sensitivity_options);
    options.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
    SensitivityHandle sums(&options, scene.count(), scene.sh_degree);
    for (const io::View& view : views.views) {
      renderer.set_time(view.time);
      sums.add_view(renderer, views.set.cameras[view.camera].camera);
    }
    weights.count = scene.count();
    weights.gauss_newton = true;
    weights.alpha_t = sums.weights(L4D_WEIGHT_ALPHA_T);
    weights.sh = sums.weights(L4D_WEIGHT_SH);
    weights.opacity = sums.weights(L4D_WEIGHT_OPACITY);
  }

  PrunedScene prune(uint32_t threads, double fidelity, uint32_t passes) {
    Observer observer;
    Rendering rendering;
    rendering.renderer.threads = threads;
    FittingViews fitting(rendering, scene, views, observer);
    return prune_scene(scene, weights, fitting, {fidelity, passes, false}, observer);
  }
};

TEST(DealViews, GivesEveryInstantToTheFitAndOthersToTheCheck) {
  const Setting s;
  const DealtViews dealt = deal_views(s.views, 6);
  std::set<double> instants;
  std::set<std::pair<double, size_t>> fit;
  for (const io::View& view : dealt.fit.views) {
    instants.insert(view.time);
    fit.insert({view.time, view.camera});
  }
  EXPECT_EQ(instants.size(), 3u);
  EXPECT_EQ(fit.size(), 6u);
  EXPECT_EQ(dealt.check.views.size(), 2u);
  for (const io::View& view : dealt.check.views) EXPECT_EQ(fit.count({view.time, view.camera}), 0u);
  // One view for each instant at least, and the same to judge by where there is no other.
  EXPECT_EQ(deal_views(s.views, 1).fit.views.size(), 3u);
  EXPECT_EQ(deal_views(s.views, 100).fit.views.size(), s.views.views.size());
  EXPECT_EQ(deal_views(s.views, 100).check.views.size(), s.views.views.size());
}

// Half of the Gaussians of every pile go; the others make up for them.
TEST(OpacityFit, TakesThePlaceOfWhatIsLeftOut) {
  Setting s;
  Observer observer;
  RenderedScene original({}, &s.scene, "original");
  FidelityMeter meter(original, s.views, {}, observer);
  io::Scene part = s.scene;
  std::vector<uint8_t> kept(s.scene.count());
  for (size_t i = 0; i < kept.size(); ++i) kept[i] = i / (kept.size() / kCopies) % 2;
  part.keep(kept);
  const auto fidelity = [&](const io::Scene& scene) {
    RenderedScene rendered({}, &scene, "part");
    return meter.fidelity(rendered, observer).psnr;
  };
  const double before = fidelity(part);
  std::vector<float> contrast(part.count(), 0.3f);
  contrast[3] = -1;
  const Rendering rendering;
  OpacityFit fit(rendering, meter, part, contrast, observer);
  fit.step(observer);
  const double once = fidelity(fit.part());
  for (int k = 0; k < 4; ++k) fit.step(observer);
  EXPECT_GT(once, before + 2);
  EXPECT_GT(fidelity(fit.part()), once + 2);
  EXPECT_EQ(fit.ratios()[3], 1.0f);
  EXPECT_EQ(fit.part().opacity[3], part.opacity[3]);
}

TEST(PruneScene, KeepsTheFidelityWithFewerGaussians) {
  Setting s;
  for (const double wanted : {30.0, 38.0}) {
    const PrunedScene pruned = s.prune(0, wanted, 4);
    ASSERT_LT(pruned.result, pruned.trials.size());
    EXPECT_GE(pruned.trials[pruned.result].fidelity, wanted + 1);
    EXPECT_EQ(pruned.trials[pruned.result].passes, 4u);
    EXPECT_LT(pruned.part.count(), s.scene.count() / 2);
    EXPECT_EQ(pruned.part.count(), pruned.trials[pruned.result].kept);
  }
}

TEST(PruneScene, GivesTheSameBitsForAnyNumberOfThreads) {
  Setting s;
  const PrunedScene one = s.prune(1, 36, 2), three = s.prune(3, 36, 2);
  EXPECT_EQ(one.kept, three.kept);
  EXPECT_EQ(one.opacity, three.opacity);
  EXPECT_NE(one.opacity, s.scene.opacity);
}

// What no view shows stays as it is; so do all opacities where nothing can go.
TEST(PruneScene, LeavesAloneWhatNoViewShows) {
  Setting s;
  // Far away from all cameras' sight.
  for (size_t i = 0; i < 20; ++i) s.scene.position[3 * i + 1] += 1e4f;
  Setting hidden = s;
  for (size_t i = 0; i < 20; ++i) {
    hidden.weights.alpha_t[i] = hidden.weights.sh[i] = hidden.weights.opacity[i] = 0;
  }
  const PrunedScene pruned = hidden.prune(0, 36, 2);
  for (size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(pruned.kept[i], 1) << i;
    EXPECT_EQ(pruned.opacity[i], hidden.scene.opacity[i]) << i;
  }
  const PrunedScene all = s.prune(0, 99, 1);
  EXPECT_EQ(all.result, all.trials.size());
  EXPECT_EQ(all.opacity, s.scene.opacity);
  EXPECT_EQ(all.part.count(), s.scene.count());
}

}  // namespace
}  // namespace l4d::eval
