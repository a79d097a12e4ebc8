// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>

#include "io/formats/write_usd.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

class UsdTest : public test::IoTest {
 protected:
  static Splats two_splats() {
    Splats splats;
    splats.sh_degree = 0;
    splats.position = {1.5F, -2.25F, 0.1F, 0, 4, 1e-9F};
    splats.covariance = {0.25F, 0, 0, 0.25F, 0, 0.25F, 4, 0, 0, 4, 0, 4};
    splats.opacity = {0.25F, 1};
    splats.sh = {0, 0, 0, 2, -2, 0.5F};
    return splats;
  }
  std::string written(const InstantSetting& setting, size_t notes) const {
    EXPECT_EQ(write_usd(path("a.usda"), two_splats(), setting).size(), notes);
    return test::read_bytes(path("a.usda"));
  }
};

TEST_F(UsdTest, TheTextIsThatOfTheSchema) {
  InstantSetting setting;
  setting.placement = {{0, 0, 0}, 1, L4D_COORDINATES_RIGHT_UP_BACK, L4D_COLOR_LINEAR_SRGB};
  std::string text = written(setting, 0);
  // Round Gaussians have any rotation; here it is that of the axes, in some order.
  const size_t turn = text.find("    quatf[]");
  text.erase(turn, text.find('\n', turn) + 1 - turn);
  EXPECT_EQ(text, R"(#usda 1.0
(
    defaultPrim = "Splats"
    metersPerUnit = 1
    upAxis = "Y"
)

def ParticleField3DGaussianSplat "Splats"
{
    float3[] extent = [(-6, -3.75, -6), (6, 10, 6)]
    point3f[] positions = [(1.5, -2.25, 0.1), (0, 4, 1e-09)]
    float3[] scales = [(0.5, 0.5, 0.5), (2, 2, 2)]
    float[] opacities = [0.25, 1]
    uniform int radiance:sphericalHarmonicsDegree = 0
    float3[] radiance:sphericalHarmonicsCoefficients = [(0, 0, 0), (2, -2, 0.5)]
    color3f[] primvars:displayColor = [(0.5, 0.5, 0.5), (1, 0, 0.6410474)] (
        interpolation = "vertex"
    )
    uniform token projectionModeHint = "perspective"
    uniform token sortingModeHint = "zDepth"
}
)");
}

TEST_F(UsdTest, ThePlacementIsATransform) {
  InstantSetting setting;
  setting.placement = {{10, 20, -30.5}, 2, L4D_COORDINATES_RIGHT_DOWN_FORWARD, L4D_COLOR_SRGB};
  setting.metres_per_unit = 0.5;
  const std::string text = written(setting, 0);
  EXPECT_NE(text.find("    metersPerUnit = 0.25\n"), std::string::npos) << text;
  EXPECT_NE(text.find("    double3 xformOp:translate = (10, -20, 30.5)\n"
                      "    float xformOp:rotateX = 180\n"
                      "    float3 xformOp:scale = (2, 2, 2)\n"
                      "    uniform token[] xformOpOrder = [\"xformOp:translate\", "
                      "\"xformOp:rotateX\", \"xformOp:scale\"]\n}\n"),
            std::string::npos)
      << text;
  written({}, 1);  // the axes are not known
}

TEST_F(UsdTest, WhatIsNotFiniteIsRefused) {
  Splats splats = two_splats();
  splats.sh[3] = std::numeric_limits<float>::infinity();
  EXPECT_EQ(test::status_of([&] { write_usd(path("x.usda"), splats, {}); }), L4D_ERR_INVALID_SCENE);
  EXPECT_EQ(files_in_directory(), 0U);
}

}  // namespace
}  // namespace l4d::io
