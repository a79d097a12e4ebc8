// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "eval/refit/opacity_fit.h"
#include "eval/refit/pruning.h"
#include "io/synth/synth.h"
#include "l4d/experimental/sensitivity.hpp"
#include "libl4dcodec/scene/window.h"

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
    FittingViews fitting(rendering, scene, views, 64, observer);
    return prune_scene(scene, weights, fitting, {fidelity, passes, false}, observer);
  }
};

using Chosen = std::set<std::pair<double, size_t>>;

Chosen chosen(const CameraViews& views) {
  Chosen all;
  for (const io::View& view : views.views) all.insert({view.time, view.camera});
  return all;
}

size_t num_instants(const CameraViews& views) {
  std::set<double> instants;
  for (const io::View& view : views.views) instants.insert(view.time);
  return instants.size();
}

TEST(DealViews, GivesEveryInstantToTheFitAndOthersToTheCheck) {
  const Setting s;
  for (const size_t most : {size_t{1}, size_t{6}, size_t{100}}) {
    const DealtViews dealt = deal_views(s.views, most);
    const Chosen fit = chosen(dealt.fit), check = chosen(dealt.check);
    EXPECT_EQ(num_instants(dealt.fit), 3u);
    EXPECT_EQ(fit.size(), std::clamp<size_t>(most, 3, 7));
    EXPECT_GE(check.size(), fit.size() / 2);
    for (const auto& view : check) EXPECT_EQ(fit.count(view), 0u);
    if (most == 100) {
      EXPECT_EQ(fit.size() + check.size(), s.views.views.size());
    }
  }
  // One instant at least is checked as all cameras see it that the fit does not use.
  std::map<double, size_t> at;
  for (const io::View& view : deal_views(s.views, 3).check.views) ++at[view.time];
  EXPECT_TRUE(std::any_of(at.begin(), at.end(), [](const auto& a) { return a.second == 4; }));
}

// Where one camera sees an instant, as one that moves does, every other instant is checked; a view
// alone serves the fit and the check.
TEST(DealViews, SharesInstantsThatOneCameraSees) {
  Setting s;
  std::vector<io::View> one;
  for (const io::View& view : s.views.views) {
    if (view.camera == 0) one.push_back(view);
  }
  for (const size_t count : {one.size(), size_t{1}}) {
    one.resize(count);
    s.views.views = one;
    const DealtViews dealt = deal_views(s.views, 100);
    const Chosen fit = chosen(dealt.fit), check = chosen(dealt.check);
    EXPECT_EQ(fit.size(), std::max<size_t>(1, count / 2));
    EXPECT_EQ(check.size(), std::max<size_t>(1, count - fit.size()));
    EXPECT_EQ(check == fit, count == 1);
  }
}

// Three minutes from every instant, or images of 16 million pixels, take long; five seconds in
// small ones do not.
TEST(DealViews, TellsWhichFitsTakeLong) {
  const auto is_long = [](uint32_t side, uint32_t frames, size_t num_gaussians) {
    CameraViews views;
    views.set.cameras.resize(2);
    for (io::Camera& camera : views.set.cameras) camera.camera.width = camera.camera.height = side;
    for (uint32_t frame = 0; frame < frames; ++frame) {
      for (size_t camera = 0; camera < 2; ++camera) {
        views.views.push_back({camera, frame / 30.0, frame});
      }
    }
    return is_long_fit(views, 150, num_gaussians);
  };
  EXPECT_FALSE(is_long(480, 150, 200000));
  EXPECT_TRUE(is_long(480, 5400, 200000));
  EXPECT_TRUE(is_long(4096, 150, 200000));
  EXPECT_TRUE(is_long(480, 150, 10000000));
}

// Each camera of the orbit once, each at another instant of the sequence.
TEST(MadeUpViews, LookFromAllSidesAtAllTimes) {
  io::Scene scene = faint_scene();
  scene.timeline.time_begin = -7;
  const CameraViews views = made_up_views(scene);
  std::set<size_t> cameras;
  for (const io::View& view : views.views) {
    cameras.insert(view.camera);
    EXPECT_EQ(view.frame, frame_of_time(scene.timeline, view.time));
  }
  EXPECT_EQ(cameras.size(), views.set.cameras.size());
  EXPECT_EQ(views.views.size(), cameras.size());
  EXPECT_EQ(num_instants(views), cameras.size());
  const double duration = io::duration(scene.timeline);
  EXPECT_NEAR(views.views.front().time, -7, 0.02 * duration);
  EXPECT_NEAR(views.views.back().time, -7 + duration, 0.02 * duration);
}

// Half of the Gaussians of every pile go; the others make up for them.
TEST(OpacityFit, TakesThePlaceOfWhatIsLeftOut) {
  Setting s;
  Observer observer;
  RenderedScene original({}, &s.scene, "original");
  FidelityMeter meter(original, s.views, {}, observer);
  std::vector<uint8_t> kept(s.scene.count());
  for (size_t i = 0; i < kept.size(); ++i) kept[i] = i / (kept.size() / kCopies) % 2;
  const size_t dark = kept.size() / kCopies + 3;  // fourth of the part
  std::vector<float> contrast(s.scene.count(), 0.3f);
  contrast[dark] = -1;
  const Rendering rendering;
  const SharedLight light = shared_light(rendering, s.views, s.scene, contrast, observer);
  const std::vector<float> ones(s.scene.count(), 1.0f);
  OpacityFit fit(rendering, meter, s.scene, light, kept, ones);
  const auto fidelity = [&](const io::Scene& scene) {
    RenderedScene rendered({}, &scene, "part");
    return meter.fidelity(rendered, observer).psnr;
  };
  const double before = fidelity(fit.part());
  fit.pass(observer);
  const double once = fidelity(fit.part());
  for (int k = 0; k < 4; ++k) fit.pass(observer);
  EXPECT_GT(once, before + 2);
  EXPECT_GT(fidelity(fit.part()), once + 2);
  EXPECT_EQ(fit.ratios()[3], 1.0f);
  EXPECT_EQ(fit.part().opacity[3], s.scene.opacity[dark]);
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
