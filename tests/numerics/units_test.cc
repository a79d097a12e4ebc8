// SPDX-License-Identifier: Apache-2.0
// The units of a scene do not matter: its streams are valid and keep their bounds in all of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"
#include "tests/numerics/hard_scenes.h"
#include "tests/numerics/oracle.h"

namespace l4d::numerics {
namespace {

using namespace test;

struct BoundedPreset {
  const char* name;
  double position, covariance;
};
constexpr BoundedPreset kPresets[] = {
    {"tiny", 1, 1.5}, {"default", 0.5, 1.5}, {"archive", 0.1, 1.1}};

EncodeOptions options_of(const char* preset) {
  EncodeOptions o;
  o.preset = preset;
  o.rans = true;
  return o;
}

void expect_bounds(const TestScene& scene, const BoundedPreset& preset, const std::string& what) {
  const Encoded e = encode(scene, options_of(preset.name));
  EXPECT_EQ(e.report.coded_gaussians, scene.count()) << what;
  EXPECT_TRUE(validate(e.bytes).empty()) << what;
  const Worst worst = worst_errors(scene, e);
  EXPECT_LE(worst.position, preset.position * (1 + 1e-4)) << what;
  EXPECT_LE(worst.covariance, preset.covariance * (1 + 1e-4)) << what;
  const l4d_coding_errors stated = stated_errors(e.bytes);
  EXPECT_GE(stated.position * (1 + 1e-4), worst.position) << what;
  EXPECT_GE(stated.covariance * (1 + 1e-4), worst.covariance) << what;
  EXPECT_LE(stated.position, stated.position_bound) << what;
  EXPECT_LE(stated.covariance, stated.covariance_bound) << what;
}

class Units : public testing::TestWithParam<size_t> {};

// spec: DIR-9, DIR-10, ENC-2. What has sizes that no stream holds is refused with the limit.
TEST_P(Units, BoundsHoldAtEveryScale) {
  const HardScene& hard = hard_scenes()[GetParam()];
  const TestScene scene = hard.make();
  constexpr struct {
    double scale, later;
  } kUnits[] = {{1e-6, 0}, {1e-4, 0}, {1e-3, 0}, {1e-2, 0}, {1, 0},
                {1, 1e5},  {1e2, 0},  {1e3, 0},  {1e4, 0},  {1e6, 0}};
  for (const auto& [scale, later] : kUnits) {
#ifdef L4D_SANITIZED
    // Bounds are measured without sanitizers, too; these see the ends, the middle and what is
    // refused.
    if (scale == 1e-4 || scale == 1e-2 || scale == 1e2 || scale == 1e4) continue;
#endif
    const TestScene other = in_other_units(scene, scale, later);
    const float largest = *std::max_element(other.log_scale.begin(), other.log_scale.end());
    const float smallest = *std::min_element(other.log_scale.begin(), other.log_scale.end());
    for (const BoundedPreset& preset : kPresets) {
      const std::string what = std::string(preset.name) + " at " + std::to_string(scale);
      if (largest <= 17 && smallest >= -17) {
        expect_bounds(other, preset, what);
        continue;
      }
      EXPECT_TRUE(scale < 1e-3 || scale > 1e4) << what;
      try {
        encode(other, options_of(preset.name));
        ADD_FAILURE() << what;
      } catch (const Error& error) {
        const std::string message = error.what();
        EXPECT_NE(message.find("at most 17"), std::string::npos) << message;
        EXPECT_NE(message.find("other units"), std::string::npos) << message;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(HardScenes, Units, testing::Range<size_t>(0, 8), [](const auto& scene) {
  std::string name = hard_scenes()[scene.param].name;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

// Steps of temporal rotors follow the unit: without that, fast or slow Gaussians are escapes.
TEST(UnitsOf, BytesGrowLittle) {
  const auto bytes_at = [](double scale) {
    size_t bytes = 0;
    for (const HardScene& hard : hard_scenes()) {
      bytes += encode(in_other_units(hard.make(), scale, 0), options_of("default")).bytes.size();
    }
    return static_cast<double>(bytes);
  };
  const double before = bytes_at(1);
  EXPECT_LT(bytes_at(1e-3), 1.04 * before);
  EXPECT_LT(bytes_at(1e3), 1.05 * before);
}

// Errors are against the input at the ends of the range of sizes, too.
TEST(UnitsOf, ErrorsAreAgainstTheInput) {
  for (const float log_scale : {-16.9f, 16.9f}) {
    TestScene scene = hard_scenes()[0].make();
    for (size_t i = 0; i < 20; ++i) {
      for (size_t k = 0; k < 3; ++k) scene.log_scale[4 * i + k] = log_scale;
    }
    for (const BoundedPreset& preset : kPresets) {
      expect_bounds(scene, preset, std::string(preset.name) + " " + std::to_string(log_scale));
    }
  }
}

}  // namespace
}  // namespace l4d::numerics
