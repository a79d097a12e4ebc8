// SPDX-License-Identifier: Apache-2.0
// What presets declare of each single Gaussian, held against what is decoded: an oracle of its own,
// in double.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"
#include "tests/numerics/formula.h"
#include "tests/numerics/hard_scenes.h"
#include "tests/numerics/oracle.h"

namespace l4d::numerics {
namespace {

using namespace test;

struct PresetBounds {
  const char* name;
  double position, covariance, opacity, base_color, directional_color;
};
// As docs/numerics.md has them.
constexpr PresetBounds kPresets[] = {{"tiny", 1, 1.5, 0.1, 0.1, 0.5},
                                     {"small", 1, 1.5, 0.1, 0.06, 0.5},
                                     {"default", 0.5, 1.5, 0.1, 0.05, 0.5},
                                     {"large", 0.25, 1.3, 0.05, 0.04, 0.4},
                                     {"archive", 0.1, 1.1, 0.02, 1.0 / 255, 0.2},
                                     {"indexed-small", 1, 1.5, 0.1, 0.1, 0.5},
                                     {"indexed", 0.5, 1.5, 0.1, 0.05, 0.5},
                                     {"indexed-high", 0.1, 1.2, 0.05, 0.04, 0.4}};

EncodeOptions options_of(const PresetBounds& preset, bool bounded) {
  EncodeOptions o;
  o.preset = preset.name;
  o.rans = true;
  o.settings.push_back({L4D_ENC_KMEANS_ITERATIONS, 2});
  if (!bounded) {
    o.settings.push_back({L4D_ENC_MAX_POSITION_ERROR, 0});
    o.settings.push_back({L4D_ENC_MAX_COVARIANCE_FACTOR, 0});
    o.settings.push_back({L4D_ENC_MAX_OPACITY_ERROR, 0});
    o.settings.push_back({L4D_ENC_MAX_BASE_COLOR_ERROR, 0});
    o.settings.push_back({L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR, 0});
  }
  return o;
}

nlohmann::ordered_json& rows() {
  static nlohmann::ordered_json all = nlohmann::ordered_json::array();
  return all;
}

void record_row(const HardScene& scene, const PresetBounds& preset, const Worst& before,
                const Worst& after, size_t bytes_before, size_t bytes_after, uint64_t escapes) {
  const auto figures = [](const Worst& w, size_t bytes) {
    return nlohmann::ordered_json{{"position", w.position},
                                  {"covariance", w.covariance},
                                  {"opacity", w.opacity},
                                  {"bytes", bytes}};
  };
  rows().push_back({{"scene", scene.name},
                    {"what", scene.what},
                    {"preset", preset.name},
                    {"without", figures(before, bytes_before)},
                    {"with", figures(after, bytes_after)},
                    {"escapes", escapes}});
  record("bounds", rows());
}

// No error is beyond what the stream states, and that is hardly more.
void expect_stated(const Encoded& e, const Worst& worst, const char* what) {
  const l4d_coding_errors stated = stated_errors(e.bytes);
  ASSERT_EQ(stated.stated, 1u);
  EXPECT_GE(stated.position, worst.position) << what;
  EXPECT_GE(stated.covariance, worst.covariance) << what;
  EXPECT_LE(stated.position, 1.01 * worst.position + 1e-6) << what;
  EXPECT_LE(stated.covariance, 1 + 1.01 * (worst.covariance - 1) + 1e-6) << what;
  // The oracle looks at 200 instants, and lets permanent ones fade by up to a thousandth.
  EXPECT_GE(stated.opacity, worst.opacity - 1e-3) << what;
  EXPECT_LE(stated.opacity, 1.02 * worst.opacity + 2e-3) << what;
  EXPECT_LE(stated.mean_t, worst.mean_time + 1e-6) << what;
  ASSERT_EQ(stated.colors_stated, 1u);
  EXPECT_GE(stated.base_color, worst.base_color) << what;
  EXPECT_LE(stated.base_color, 1.001 * worst.base_color + 1e-6) << what;
  EXPECT_GE(stated.directional_color, worst.directional_color) << what;
  EXPECT_LE(stated.directional_color, 1.001 * worst.directional_color + 1e-6) << what;
  // Rounded up.
  EXPECT_GE(stated.position, e.report.max_position_error);
  EXPECT_LE(stated.position, e.report.max_position_error * (1 + 1e-5));
  EXPECT_GE(stated.mean_t, e.report.max_mean_t_error);
  EXPECT_GE(stated.visible, e.report.max_visible_error);
}

class Bounds : public testing::TestWithParam<size_t> {};

TEST_P(Bounds, HoldForEveryGaussian) {
  const HardScene& hard = hard_scenes()[GetParam()];
  const TestScene scene = hard.make();
  for (const PresetBounds& preset : kPresets) {
    const Encoded e = encode(scene, options_of(preset, true));
    ASSERT_EQ(e.report.coded_gaussians, scene.count());
    EXPECT_TRUE(validate(e.bytes).empty()) << preset.name;
    const Worst worst = worst_errors(scene, e);
    EXPECT_LE(worst.position, preset.position + 1e-3) << preset.name;
    EXPECT_LE(worst.covariance, preset.covariance * (1 + 1e-3)) << preset.name;
    EXPECT_LE(worst.opacity, preset.opacity + 1e-3) << preset.name;
    EXPECT_LE(worst.base_color, preset.base_color) << preset.name;
    EXPECT_LE(worst.directional_color, preset.directional_color) << preset.name;
    // What the encoder says it saw.
    EXPECT_NEAR(e.report.max_position_error, worst.position, 1e-3 + 1e-2 * worst.position)
        << preset.name;
    EXPECT_NEAR(e.report.max_covariance_factor, worst.covariance, 1e-2 * worst.covariance)
        << preset.name;
    expect_stated(e, worst, preset.name);
    const l4d_coding_errors stated = stated_errors(e.bytes);
    EXPECT_EQ(static_cast<float>(preset.position), static_cast<float>(stated.position_bound));
    EXPECT_EQ(static_cast<float>(preset.covariance), static_cast<float>(stated.covariance_bound));
    EXPECT_EQ(static_cast<float>(preset.opacity), static_cast<float>(stated.opacity_bound));
    EXPECT_EQ(static_cast<float>(preset.base_color), static_cast<float>(stated.base_color_bound));
    EXPECT_EQ(static_cast<float>(preset.directional_color),
              static_cast<float>(stated.directional_color_bound));
    EXPECT_NEAR(stated.min_size, min_size(scene), 1e-6 * stated.min_size);
    EXPECT_EQ(stated.own_min_sizes, 0u);
    const Encoded without = encode(scene, options_of(preset, false));
    const Worst before = worst_errors(scene, without);
    expect_stated(without, before, "without bounds");
    EXPECT_EQ(stated_errors(without.bytes).position_bound, 0);
    record_row(hard, preset, before, worst, without.bytes.size(), e.bytes.size(), e.report.escapes);
  }
}

INSTANTIATE_TEST_SUITE_P(HardScenes, Bounds, testing::Range<size_t>(0, 8), [](const auto& scene) {
  std::string name = hard_scenes()[scene.param].name;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

// Lossless streams say that they are.
TEST(BoundsOf, LosslessStreamsStateNoErrors) {
  EncodeOptions o;
  o.preset = "lossless";
  const l4d_coding_errors stated = stated_errors(encode(hard_scenes()[0].make(), o).bytes);
  EXPECT_EQ(stated.stated, 1u);
  EXPECT_EQ(stated.position, 0);
  EXPECT_EQ(stated.covariance, 1);
  EXPECT_EQ(stated.opacity, 0);
  EXPECT_EQ(stated.visible, 0);
  EXPECT_EQ(stated.mean_t, 0);
  EXPECT_EQ(stated.colors_stated, 1u);
  EXPECT_EQ(stated.base_color, 0);
  EXPECT_EQ(stated.directional_color, 0);
}

// What is smaller than its own minimum size counts as that, which is worth bytes.
TEST(BoundsOf, OwnMinSizesCount) {
  const TestScene scene = hard_scenes()[4].make();
  EncodeOptions options = options_of(kPresets[4], true);
  const Encoded with_none = encode(scene, options);
  constexpr float kLeast = 0.2f;
  const std::vector<float> sizes(scene.count(), kLeast);
  options.min_sizes = &sizes;
  const Encoded e = encode(scene, options);
  const Worst worst = worst_errors(scene, e, static_cast<double>(kLeast));
  EXPECT_LE(worst.position, kPresets[4].position + 1e-3);
  EXPECT_LE(worst.covariance, kPresets[4].covariance * (1 + 1e-3));
  EXPECT_EQ(stated_errors(e.bytes).own_min_sizes, 1u);
  EXPECT_GE(stated_errors(e.bytes).position, worst.position);
  EXPECT_GT(worst_errors(scene, e).position, worst.position);
  EXPECT_LT(e.bytes.size(), with_none.bytes.size());
}

// A static flash must not start to move.
TEST(BoundsOf, WhatStandsStillStandsStill) {
  const TestScene scene = hard_scenes()[2].make();
  for (const char* preset : {"tiny", "default", "archive"}) {
    const Encoded e = encode(scene, options_of({preset, 0, 0, 0, 0, 0}, true));
    const GaussianArrays a = decode(e.bytes, all_query());
    for (size_t j = 0; j < a.count(); ++j) {
      const Seen is = seen_of(&a.position[3 * j], a.mean_t_double[j], &a.log_scale[4 * j],
                              &a.rotor[8 * j], a.opacity[j], 0, 10);
      ASSERT_LT(is.velocity.norm(), 1e-3) << preset << " " << e.order[j];
    }
  }
}

// The others' positions are as good as if the floaters were not there.
TEST(BoundsOf, FloatersCoarsenNothing) {
  const auto median = [](double distance) {
    const TestScene scene = room_with_floaters(distance, 5);
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    const Encoded e = encode(scene, o);
    EXPECT_TRUE(validate(e.bytes).empty());
    const GaussianArrays a = decode(e.bytes, all_query());
    std::vector<double> errors;
    for (size_t j = 0; j < a.count(); ++j) {
      if (e.order[j] >= scene.count() - 5) continue;
      double sum = 0;
      for (size_t k = 0; k < 3; ++k) {
        const double d = static_cast<double>(a.position[3 * j + k]) -
                         static_cast<double>(scene.position[3 * e.order[j] + k]);
        sum += d * d;
      }
      errors.push_back(std::sqrt(sum));
    }
    std::nth_element(errors.begin(),
                     errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2), errors.end());
    return errors[errors.size() / 2];
  };
  const double near = median(1);
  EXPECT_LT(median(1e5), 1.1 * near);
  EXPECT_LT(median(1e6), 1.1 * near);
}

// Gaussians larger than the scene are not all of its pictures: the others keep their colours.
TEST(BoundsOf, HugeGaussiansCoarsenNothing) {
  SceneOptions given;
  given.count = 4000;
  given.sh_degree = 3;
  const TestScene room = make_scene(given);
  const auto median = [&](bool huge) {
    TestScene scene = room;
    for (size_t i = 0; huge && i < scene.count(); i += 100) {
      std::fill_n(&scene.log_scale[4 * i], 3, 5.0f);
    }
    EncodeOptions o = options_of({"default", 0, 0, 0, 0, 0}, false);
    const Encoded e = encode(scene, o);
    const GaussianArrays a = decode(e.bytes, all_query());
    std::vector<double> errors;
    for (size_t j = 0; j < a.count(); ++j) {
      if (e.order[j] % 100 == 0) continue;
      Worst own;
      add_colors(scene, e.order[j], a, j, &own);
      errors.push_back(own.base_color);
    }
    const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
    std::nth_element(errors.begin(), middle, errors.end());
    return *middle;
  };
  EXPECT_LT(median(true), 2 * median(false));
}

// Colours far beyond what screens show keep their bounds in parts of themselves.
TEST(BoundsOf, BrightColoursKeepTheirs) {
  TestScene scene = hard_scenes()[0].make();
  for (float& x : scene.sh) x *= 1e4f;
  for (const PresetBounds& preset : kPresets) {
    const Encoded e = encode(scene, options_of(preset, true));
    const Worst worst = worst_errors(scene, e);
    EXPECT_LE(worst.base_color, preset.base_color) << preset.name;
    EXPECT_LE(worst.directional_color, preset.directional_color) << preset.name;
    expect_stated(e, worst, preset.name);
  }
}

}  // namespace
}  // namespace l4d::numerics
