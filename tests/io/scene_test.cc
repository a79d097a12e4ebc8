// SPDX-License-Identifier: Apache-2.0
#include "io/scene/scene.h"

#include <cmath>

#include "libl4dcodec/scene/slice.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using test::random_scene;

TEST(Scene, ViewDescribesTheArrays) {
  const Scene scene = random_scene(1, 7, 2);
  const l4d_gaussians view = scene.view();
  EXPECT_EQ(view.struct_size, sizeof(l4d_gaussians));
  EXPECT_EQ(view.count, 7U);
  EXPECT_EQ(view.sh_degree, 2U);
  EXPECT_EQ(view.flags, scene.flags);
  EXPECT_EQ(view.sh, scene.sh.data());
  EXPECT_EQ(scene.sh.size(), 7U * 9 * 3);
  EXPECT_EQ(scene.rotor.size(), 7U * 8);
  EXPECT_DOUBLE_EQ(duration(scene.timeline), 5);
}

TEST(Scene, PositionsMoveWithTheVelocity) {
  const Scene before = random_scene(2, 500, 0);
  Scene after = before;
  positions_to_reference_time(after);
  EXPECT_EQ(after.flags, static_cast<uint32_t>(L4D_OPACITY_LOGIT));
  for (size_t i = 0; i < before.count(); ++i) {
    const test::ReferenceSlice s = test::reference_slice(before, i);
    const double mean_t = static_cast<double>(before.mean_t[i]);
    const double t_ref = mean_t < 1.5 ? 1.5 : (mean_t > 6.5 ? 6.5 : mean_t);
    for (size_t k = 0; k < 3; ++k) {
      const double expected = static_cast<double>(before.position[3 * i + k]) +
                              static_cast<double>(s.velocity[k]) * (t_ref - mean_t);
      ASSERT_NEAR(static_cast<double>(after.position[3 * i + k]), expected,
                  1e-7 * (1 + std::abs(expected)));
    }
  }
  const Scene between = after;
  positions_to_mean_time(after);
  EXPECT_EQ(after.flags, before.flags);
  for (size_t i = 0; i < before.position.size(); ++i) {  // two roundings, of the larger value
    ASSERT_NEAR(after.position[i], before.position[i],
                1.2e-7 * (std::abs(between.position[i]) + std::abs(before.position[i])));
  }
}

TEST(Scene, ConversionsThatAreDoneKeepBits) {
  Scene scene = random_scene(3, 50, 1);
  const Scene before = scene;
  positions_to_mean_time(scene);
  opacity_to_logit(scene);
  test::expect_same_arrays(scene, before);
}

TEST(Scene, GaussiansInsideTheSequenceKeepTheirPosition) {
  Scene scene = random_scene(4, 50, 0);
  for (float& t : scene.mean_t) t = 3;
  const Scene before = scene;
  positions_to_reference_time(scene);
  EXPECT_TRUE(test::same_bits(scene.position, before.position));
}

TEST(Scene, OpacityConversionsAreFiniteAndKeepBothEnds) {
  Scene scene = random_scene(5, 6, 0);
  scene.flags = 0;
  scene.opacity = {0, 1, 0.5F, 1e-30F, 0.99999994F, 0.1F};
  const std::vector<float> before = scene.opacity;
  opacity_to_logit(scene);
  EXPECT_EQ(scene.opacity[2], 0);
  for (const float o : scene.opacity) EXPECT_TRUE(std::isfinite(o));
  const auto back = [&](size_t i) {
    return static_cast<float>(linear_opacity(static_cast<double>(scene.opacity[i]), true));
  };
  EXPECT_EQ(back(0), 0);
  EXPECT_EQ(back(1), 1);
  for (size_t i = 2; i < 6; ++i) EXPECT_NEAR(back(i) / before[i], 1, 1e-5);
}

}  // namespace
}  // namespace l4d::io
