// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>

#include "encoder/plan/layers.h"
#include "libl4dcodec/scene/layers.h"
#include "tests/common/test_scene.h"

namespace l4d {
namespace {

using namespace test;

struct Planned {
  EncoderScene scene;
  std::vector<LayerPlan> plans;
};

Planned plan(const TestScene& input, double merge_fraction, double merge_count,
             bool lossless = false) {
  EncoderSettings settings;
  EXPECT_TRUE(settings.set(Parameter::kMergeFraction, -1, merge_fraction).ok());
  EXPECT_TRUE(settings.set(Parameter::kMergeCount, -1, merge_count).ok());
  EXPECT_TRUE(settings.set(Parameter::kLossless, -1, lossless).ok());
  EncoderInput in;
  in.gaussians = input.view();
  in.timeline = input.timeline;
  in.placement.scale = 1;
  Planned p;
  EXPECT_TRUE(check_input(in).ok());
  EXPECT_TRUE(prepare_scene(in, settings, 1, &p.scene).ok());
  p.plans = plan_layers(p.scene, settings);
  return p;
}

// What holds of every plan.
void expect_sound(const Planned& p) {
  std::vector<int> seen(p.scene.count, 0);
  unsigned level = 0;
  for (size_t k = 0; k < p.plans.size(); ++k) {
    const LayerPlan& l = p.plans[k];
    EXPECT_GE(l.level, level);
    level = l.level;
    EXPECT_TRUE(!l.permanent || (k == 0 && l.level == 0));
    EXPECT_TRUE(std::is_sorted(l.gaussians.begin(), l.gaussians.end()));
    for (const uint32_t i : l.gaussians) {
      ++seen[i];
      if (l.permanent) continue;
      const uint32_t bucket = bucket_of_time(p.scene.timeline, p.scene.mean_t[i], l.level);
      EXPECT_TRUE(
          fits_layer(p.scene.mean_t[i], p.scene.sigma_t(i), bucket, l.level, p.scene.timeline))
          << "Gaussian " << i << " at level " << l.level;
    }
  }
  EXPECT_EQ(seen, std::vector<int>(p.scene.count, 1)) << "every Gaussian in one layer";
  const bool has_level0 = std::any_of(p.plans.begin(), p.plans.end(), [](const LayerPlan& l) {
    return l.level == 0 && !l.permanent;
  });
  EXPECT_TRUE(has_level0);
}

TEST(Layering, FinestLayerThatHoldsTheExtent) {
  const Planned p = plan(make_scene({}), 0, 0);
  expect_sound(p);
  const uint32_t levels = num_layers(p.scene.timeline.num_frames);
  for (const LayerPlan& l : p.plans) {
    EXPECT_LT(l.level, levels);
    for (const uint32_t i : l.gaussians) {
      if (l.permanent) continue;
      const double tau = 8 * p.scene.sigma_t(i);
      if (l.level > 0) {
        EXPECT_LE(tau, p.scene.duration / (1u << l.level) * (1 + 1e-6));
      }
      if (l.level + 1 < levels) {
        EXPECT_GT(tau, p.scene.duration / (2u << l.level) * (1 - 1e-6));
      }
    }
  }
  EXPECT_GE(p.plans.size(), 6u);
}

TEST(Layering, PermanentGaussiansNeitherMoveNorFade) {
  const Planned p = plan(make_scene({}), 0, 0);
  ASSERT_TRUE(p.plans[0].permanent);
  EXPECT_NEAR(static_cast<double>(p.plans[0].gaussians.size()), 600, 60);  // 30 % of 2000
  for (const uint32_t i : p.plans[0].gaussians) {
    for (const double t : {0.0, p.scene.duration}) {
      const double dt = t - p.scene.mean_t[i];
      EXPECT_LE(0.5 * p.scene.lambda[i] * dt * dt, 1e-3);
    }
    double moved = 0;
    for (size_t k = 0; k < 3; ++k) {
      moved += std::fabs(p.scene.velocity[3 * i + k]) * p.scene.duration;
    }
    EXPECT_LE(moved, 2e-3 * std::exp(-2.0));
  }
}

TEST(Layering, LosslessHasNoPermanentLayer) {
  const Planned p = plan(make_scene({}), 0, 0, true);
  expect_sound(p);
  for (const LayerPlan& l : p.plans) EXPECT_FALSE(l.permanent);
}

TEST(Layering, ThinFineLayersMergeTowardsCoarserOnes) {
  const TestScene scene = make_scene({});
  const Planned apart = plan(scene, 0, 0);
  std::vector<unsigned> level(scene.count());
  for (const LayerPlan& l : apart.plans) {
    for (const uint32_t i : l.gaussians) level[i] = l.level;
  }
  for (const auto& [fraction, count] :
       {std::pair<double, double>{0.2, 0}, {0, 400}, {0, 1e9}, {1, 0}}) {
    const Planned p = plan(scene, fraction, count);
    expect_sound(p);
    const double least = std::max(fraction * static_cast<double>(scene.count()), count);
    const LayerPlan& finest = p.plans.back();
    EXPECT_TRUE(finest.level == 0 || static_cast<double>(finest.gaussians.size()) >= least);
    for (const LayerPlan& l : p.plans) {
      for (const uint32_t i : l.gaussians) EXPECT_LE(l.level, level[i]);
    }
  }
  const Planned one = plan(scene, 0, 1e9);
  ASSERT_EQ(one.plans.size(), 1u);
  EXPECT_EQ(one.plans[0].gaussians.size(), scene.count());
}

TEST(Layering, AllPermanentStaysPermanent) {
  SceneOptions o;
  o.permanent = 1;
  const Planned p = plan(make_scene(o), 0, 1e9);
  expect_sound(p);
  ASSERT_EQ(p.plans.size(), 2u);
  EXPECT_TRUE(p.plans[0].permanent);
  EXPECT_TRUE(p.plans[1].gaussians.empty());
}

TEST(Layering, SequencesOfOneFrame) {
  SceneOptions o;
  o.num_frames = 1;
  o.count = 200;
  const Planned p = plan(make_scene(o), 0, 0);
  expect_sound(p);
  for (const LayerPlan& l : p.plans) EXPECT_EQ(l.level, 0u);
}

}  // namespace
}  // namespace l4d
