// SPDX-License-Identifier: Apache-2.0
// What the encoder takes for the importance of Gaussians where nothing, or only some, was measured.
#include "encoder/prepare/estimates.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

struct Prepared {
  TestScene input;
  EncoderScene scene;

  explicit Prepared(TestScene of, const l4d_importance& importance = L4D_INIT(l4d_importance),
                    int threads = 1)
      : input(std::move(of)) {
    EncoderInput in;
    in.gaussians = input.view();
    in.timeline = input.timeline;
    in.placement.scale = 1;
    in.importance = importance;
    EncoderSettings settings;
    EXPECT_TRUE(settings.set_preset("default").ok());
    EXPECT_TRUE(settings.set(L4D_ENC_PRUNE_COST, 0).ok());
    EXPECT_TRUE(prepare_scene(in, settings, threads, &scene).ok());
  }
};

// Gaussians of one place, opacity and life, whose sizes are those given.
TestScene scene_of(const std::vector<std::array<double, 3>>& sizes) {
  SceneOptions options;
  options.count = sizes.size();
  options.permanent = 1;
  options.outside = 0;
  TestScene scene = make_scene(options);
  for (size_t i = 0; i < sizes.size(); ++i) {
    scene.opacity[i] = 0.5f;
    for (size_t k = 0; k < 3; ++k) {
      scene.log_scale[4 * i + k] = static_cast<float>(std::log(sizes[i][k]));
    }
  }
  return scene;
}

ImageSquares squares(const TestScene& of, size_t i) {
  const Prepared prepared(of);
  return ShapeFactors(prepared.scene).squares(i, 1);
}

// A turned needle shows, a turned ball does not, and a disc lies in between; whichever axis is
// which.
TEST(Estimates, TellHowFarATurnShows) {
  const TestScene scene =
      scene_of({{0.1, 0.1, 0.1}, {0.1, 0.1, 0.02}, {0.1, 0.02, 0.02}, {0.02, 0.1, 0.02}});
  const auto turn = [&](size_t i) {
    return squares(scene, i).component[L4D_COMPONENT_ROTOR_SPATIAL];
  };
  EXPECT_LT(2 * turn(0), turn(1));
  EXPECT_LT(2 * turn(1), turn(2));
  EXPECT_DOUBLE_EQ(turn(2), turn(3));
}

// The narrower a Gaussian, the more a shift across it shows: down to what images can tell.
TEST(Estimates, TellHowFarAShiftShows) {
  const TestScene scene = scene_of(
      {{0.1, 0.1, 0.1}, {0.1, 0.05, 0.1}, {0.1, 0.05, 0.05}, {0.1, 1e-4, 1e-4}, {0.1, 1e-6, 1e-6}});
  const auto position = [&](size_t i) { return squares(scene, i).position; };
  EXPECT_DOUBLE_EQ(position(1), position(0));
  EXPECT_NEAR(position(2), 4 * position(0), 1e-5 * position(2));
  EXPECT_NEAR(position(3), 100 * position(0), 1e-4 * position(3));
  EXPECT_DOUBLE_EQ(position(4), position(3));
}

// In units that are 1,000 times as small, a shift by one of them shows a millionth as much.
TEST(Estimates, FollowUnits) {
  TestScene scene = scene_of({{0.1, 0.1, 0.1}, {0.1, 0.05, 0.02}, {0.3, 0.01, 0.01}});
  const ImageSquares before = squares(scene, 1);
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      scene.position[3 * i + k] *= 1000;
      scene.log_scale[4 * i + k] += std::log(1000.0f);
    }
  }
  const ImageSquares after = squares(scene, 1);
  EXPECT_NEAR(after.position * 1e6, before.position, 1e-5 * before.position);
  for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (c == L4D_COMPONENT_ROTOR_TEMPORAL) continue;
    EXPECT_NEAR(after.component[c], before.component[c], 1e-4 * before.component[c]) << c;
  }
}

// What a few views say counts beside estimates: what none of them shows keeps some. All views say
// it all. For any number of threads.
TEST(Estimates, MixWithWhatSomeViewsShow) {
  SceneOptions options;
  options.count = 9000;
  const TestScene scene = make_scene(options);
  std::vector<float> weights(scene.count());
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = i % 3 == 0 ? 0 : 1e-3f;
  l4d_importance importance = L4D_INIT(l4d_importance);
  importance.count = scene.count();
  importance.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
  for (const float*& of : importance.weights) of = weights.data();
  importance.views = L4D_WEIGHT_VIEWS_UNKNOWN;
  const Prepared estimated(scene), measured(scene, importance);
  importance.views = L4D_WEIGHT_VIEWS_SOME;
  const Prepared mixed(scene, importance), again(scene, importance, 3);
  for (size_t i = 0; i < scene.count(); ++i) {
    const auto expect_mix = [&](const auto& of) {
      const float half = 0.25f * of(measured.scene) + 0.5f * of(estimated.scene);
      ASSERT_NEAR(of(mixed.scene), half, 1e-5f * half) << i;
      ASSERT_EQ(of(again.scene), of(mixed.scene)) << i;
    };
    for (size_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      expect_mix([&](const EncoderScene& s) { return s.importance[c][i]; });
    }
    expect_mix([&](const EncoderScene& s) { return s.position_importance[i]; });
  }
}

}  // namespace
}  // namespace l4d
