// SPDX-License-Identifier: Apache-2.0
#include "io/synth/synth.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "io/synth/cloud.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

uint64_t hash(const Scene& scene) {  // FNV-1a over the bits of all arrays
  uint64_t h = 0xcbf29ce484222325U;
  for (const auto* array : {&scene.position, &scene.mean_t, &scene.log_scale, &scene.rotor,
                            &scene.opacity, &scene.sh}) {
    for (const float value : *array) {
      uint32_t bits = 0;
      std::memcpy(&bits, &value, sizeof(bits));
      h = (h ^ bits) * 0x100000001b3U;
    }
  }
  return h;
}

Scene make(const std::vector<std::string>& effects, uint64_t gaussians = 20000, double seconds = 5,
           uint64_t seed = 1) {
  SynthOptions options;
  options.effects = effects;
  options.gaussians = gaussians;
  options.seconds = seconds;
  options.seed = seed;
  return synthesize(options);
}

bool all_finite(const Scene& scene) {
  for (const auto* array : {&scene.position, &scene.mean_t, &scene.log_scale, &scene.rotor,
                            &scene.opacity, &scene.sh}) {
    for (const float value : *array) {
      if (!std::isfinite(value)) return false;
    }
  }
  return true;
}

// These numbers change only when the scenes are meant to change: documents and benchmarks quote
// results on them.
TEST(Synth, BitsAreTheSameEverywhere) {
  EXPECT_EQ(hash(make({})), 12754325115315320538U);
  EXPECT_EQ(hash(make({"static"})), 7454814664518463808U);
  EXPECT_EQ(hash(make({"rigid", "deform", "flicker", "appear"}, 3000, 86400, 7)),
            4387295175896179918U);
}

TEST(Synth, SeedsAndRepetitions) {
  EXPECT_EQ(hash(make({}, 2000)), hash(make({}, 2000)));
  EXPECT_NE(hash(make({}, 2000)), hash(make({}, 2000, 5, 2)));
}

TEST(Synth, AllEffectsByNameEqualTheDefault) {
  EXPECT_EQ(hash(make({"static", "rigid", "deform", "flicker", "appear", "view"}, 2000)),
            hash(make({}, 2000)));
}

TEST(Synth, WithoutDynamicsEverythingIsPermanent) {
  for (const double seconds : {0.1, 5.0, 600.0, 86400.0}) {
    const Scene scene = make({"static", "view"}, 2000, seconds);
    EXPECT_FALSE(test::has_motion(scene));
    EXPECT_EQ(scene.sh_degree, 3U);
    for (size_t i = 0; i < scene.count(); ++i) {
      ASSERT_EQ(scene.mean_t[i], static_cast<float>(duration(scene.timeline) / 2));
      ASSERT_GE(std::exp(static_cast<double>(scene.log_scale[4 * i + 3])),
                16 * duration(scene.timeline) * (1 - 1e-12));
    }
  }
}

TEST(Synth, EffectsThatAreOffLeaveNothing) {
  EXPECT_EQ(make({"static", "rigid"}, 500).sh_degree, 0U);
  EXPECT_EQ(make({"view"}, 500).sh_degree, 3U);
  EXPECT_FALSE(test::has_motion(make({"view"}, 500)));
  EXPECT_FALSE(test::has_motion(make({"static", "flicker", "appear"}, 2000)));
  EXPECT_FALSE(test::has_motion(make({"flicker"}, 500)));
  EXPECT_FALSE(test::has_motion(make({"appear"}, 500)));
  EXPECT_TRUE(test::has_motion(make({"rigid"}, 500)));
  EXPECT_TRUE(test::has_motion(make({"deform"}, 500)));
  const Scene scene = make({"static"}, 500);
  EXPECT_EQ(scene.sh.size(), 500U * 3);
}

TEST(Synth, BadOptionsAreRefused) {
  const auto status = [](const SynthOptions& options) {
    return test::status_of([&] { synthesize(options); });
  };
  SynthOptions options;
  options.effects = {"static", "smoke"};
  EXPECT_EQ(status(options), L4D_ERR_INVALID_ARGUMENT);
  options = {};
  options.gaussians = 0;
  EXPECT_EQ(status(options), L4D_ERR_INVALID_ARGUMENT);
  options = {};
  options.seconds = std::nan("");
  EXPECT_EQ(status(options), L4D_ERR_INVALID_ARGUMENT);
  options.seconds = 86400;
  options.fps = 1000;  // over 2^24 frames
  EXPECT_EQ(status(options), L4D_ERR_INVALID_ARGUMENT);
}

TEST(Synth, ACallerMayStopIt) {
  for (const char* scene : {"cloud", "square", "room"}) {
    SynthOptions options;
    options.scene = scene;
    options.gaussians = 9000;
    options.check = [] { throw Error(L4D_ERR_CANCELLED, "stop"); };
    EXPECT_EQ(test::status_of([&] { synthesize(options); }), L4D_ERR_CANCELLED) << scene;
  }
}

TEST(Synth, AnyCountAndLengthIsFinite) {
  for (const uint64_t count : {1U, 2U, 7U, 33U, 1000U}) {
    for (const double seconds : {0.01, 1.0, 3600.0, 86400.0}) {
      const Scene scene = make({}, count, seconds);
      ASSERT_EQ(scene.count(), count);
      ASSERT_TRUE(all_finite(scene));
      ASSERT_NEAR(duration(scene.timeline), std::max(seconds, 1.0 / 30), 1.0 / 30);
      for (const float s : scene.log_scale) ASSERT_TRUE(s > -16 && s < 20) << s;
    }
  }
}

TEST(Synth, RotorsAreUnitAndValid) {
  const Scene scene = make({});
  for (size_t i = 0; i < scene.count(); ++i) {
    const reference::Rotor r = reference::load(&scene.rotor[8 * i]);
    const double constraint =
        static_cast<double>(r.s * r.p - r.b01 * r.b23 + r.b02 * r.b13 - r.b03 * r.b12);
    double norm2 = 0;
    for (size_t k = 0; k < 8; ++k) {
      norm2 +=
          static_cast<double>(scene.rotor[8 * i + k]) * static_cast<double>(scene.rotor[8 * i + k]);
    }
    ASSERT_NEAR(constraint, 0, 1e-7);
    ASSERT_NEAR(norm2, 1, 1e-6);
  }
}

// What makes a scene hard or easy for the codec, as trained scenes have it.
TEST(Synth, LooksLikeATrainedScene) {
  const Scene scene = make({}, 50000);
  size_t whole_sequence = 0, outside = 0, brief = 0, thin = 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    const double sigma_t = static_cast<double>(test::reference_slice(scene, i).sigma_t);
    const double mean_t = static_cast<double>(scene.mean_t[i]);
    whole_sequence += 8 * sigma_t > 5;
    brief += 8 * sigma_t < 0.7;
    outside += mean_t < 0 || mean_t >= 5;
    // Nothing is wasted on Gaussians that are never seen.
    ASSERT_LE(std::abs(std::clamp(mean_t, 0.0, 5.0) - mean_t), 4 * sigma_t) << i;
    const auto s = scene.log_scale.begin() + static_cast<std::ptrdiff_t>(4 * i);
    thin += *std::max_element(s, s + 3) - *std::min_element(s, s + 3) > std::log(1000.0);
  }
  const double n = static_cast<double>(scene.count());
  EXPECT_GT(static_cast<double>(whole_sequence) / n, 0.7);
  EXPECT_LT(static_cast<double>(whole_sequence) / n, 0.95);
  EXPECT_GT(static_cast<double>(brief) / n, 0.05);
  EXPECT_GT(static_cast<double>(outside) / n, 0.2);
  EXPECT_GT(static_cast<double>(thin) / n, 0.02);

  // Positions are right when the Gaussians are seen: in or near the room, however far the mean
  // time.
  Scene seen = scene;
  positions_to_reference_time(seen);
  for (const float x : seen.position) ASSERT_LT(std::abs(x), 6);
}

synth::Setting setting_of(const Scene& scene) {
  synth::Setting setting;
  setting.seed = 1;
  setting.seconds = duration(scene.timeline);
  setting.temporal = setting.motion = true;
  return setting;
}

TEST(Synth, StoredGaussiansMoveAsTheirPartSays) {
  for (const char* effect : {"rigid", "deform"}) {
    const Scene scene = make({effect}, 3000, 20);
    const auto part = std::string(effect) == "rigid"
                          ? synth::make_rigid_objects(setting_of(scene))
                          : synth::make_deforming_sheets(setting_of(scene));
    for (size_t i = 0; i < scene.count(); ++i) {
      const synth::Particle p = part->particle(i, scene.count());
      const test::ReferenceSlice s = test::reference_slice(scene, i);
      ASSERT_NEAR(static_cast<double>(s.sigma_t), synth::exp(p.log_sigma_t), 1e-3);
      for (size_t k = 0; k < 3; ++k) {
        ASSERT_NEAR(static_cast<double>(s.velocity[k]), p.velocity[k], 2e-3) << effect << i;
        ASSERT_NEAR(static_cast<double>(scene.position[3 * i + k]), p.position[k], 1e-5);
      }
    }
  }
}

// The pieces of a path join: from one to the next a point of the body goes as far as its velocity
// says (trapezoid rule; the third derivative of the paths is below 20).
TEST(Synth, PathsAreSmooth) {
  synth::Setting setting;
  setting.seed = 3;
  setting.seconds = 10;
  const auto part = synth::make_rigid_objects(setting);
  const uint64_t count = 8 * 64;
  size_t joints = 0;
  for (uint64_t i = 0; i + 1 < count; ++i) {
    const synth::Particle a = part->particle(i, count);
    for (uint64_t j = i + 1; j < std::min(count, i + 12); ++j) {
      const synth::Particle b = part->particle(j, count);
      const double dt = b.mean_t - a.mean_t;
      if (a.color != b.color || a.log_scale != b.log_scale || dt > 0.7 || dt < 0.1) continue;
      ++joints;
      for (size_t k = 0; k < 3; ++k) {
        const double gone = b.position[k] - a.position[k];
        ASSERT_NEAR(gone, (a.velocity[k] + b.velocity[k]) / 2 * dt, 20.0 / 12 * dt * dt * dt);
      }
    }
  }
  EXPECT_GT(joints, 50U);
}

TEST(Synth, DynamicPartIsSpreadOverTheWholeSequence) {
  for (const char* effect : {"rigid", "deform", "flicker", "appear"}) {
    const Scene scene = make({effect}, 8000, 120);
    std::vector<size_t> tenths(10);
    for (const float t : scene.mean_t) {
      ++tenths[static_cast<size_t>(std::clamp(t / 12.0F, 0.0F, 9.0F))];
    }
    for (const size_t count : tenths) {
      EXPECT_GT(count, 400U) << effect;
      EXPECT_LT(count, 1600U) << effect;
    }
  }
}

TEST(Synth, ColoursNeedMoreThanAFewDirections) {
  const Scene scene = make({}, 4000);
  const size_t dim = 45;
  std::vector<double> covariance(dim * dim);
  for (size_t i = 0; i < scene.count(); ++i) {
    const float* ac = &scene.sh[48 * i + 3];
    for (size_t a = 0; a < dim; ++a) {
      for (size_t b = 0; b < dim; ++b) {
        covariance[dim * a + b] += static_cast<double>(ac[a]) * static_cast<double>(ac[b]);
      }
    }
  }
  double trace = 0, squares = 0;
  for (size_t a = 0; a < dim; ++a) trace += covariance[dim * a + a];
  for (const double c : covariance) squares += c * c;
  // trace^2 / sum of squared eigenvalues: how many directions carry the variance.
  EXPECT_GT(trace * trace / squares, 12);
  EXPECT_LT(trace * trace / squares, 40);
}

TEST(SynthMath, ElementaryFunctionsAreAccurate) {
  reference::Random random(1);
  for (int n = 0; n < 20000; ++n) {
    const double x = random.uniform(-30, 30);
    ASSERT_NEAR(synth::exp(x) / std::exp(x), 1, 1e-14);
    const double y = random.log_uniform(1e-9, 1e9);
    ASSERT_NEAR(synth::log(y), std::log(y), 2e-15 * (1 + std::abs(std::log(y))));
    const double turns = random.uniform(-3, 3);
    ASSERT_NEAR(synth::sin_turns(turns),
                static_cast<double>(std::sin(6.283185307179586476925L * turns)), 4e-15);
  }
}

TEST(SynthMath, RandomNumbersHaveTheirMoments) {
  synth::Rng rng(1, 2, 3);
  double sum = 0, sum2 = 0, sum_u = 0;
  const int count = 200000;
  for (int i = 0; i < count; ++i) {
    const double x = rng.normal();
    sum += x;
    sum2 += x * x;
    sum_u += rng.uniform();
  }
  EXPECT_NEAR(sum / count, 0, 0.01);
  EXPECT_NEAR(sum2 / count, 1, 0.02);
  EXPECT_NEAR(sum_u / count, 0.5, 0.005);
}

}  // namespace
}  // namespace l4d::io
