// SPDX-License-Identifier: Apache-2.0
// Hard input of the encoder: what it makes of it, not just that it lives.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "encoder/component/codebook_coder.h"
#include "encoder/search/kmeans.h"
#include "libl4dcodec/scene/layers.h"
#include "tests/common/codec.h"
#include "tests/common/flush_to_zero.h"
#include "tests/common/random.h"

namespace l4d::numerics {
namespace {

using namespace test;

constexpr float kDenormal = std::numeric_limits<float>::denorm_min();

// ---- k-means -----------------------------------------------------------------------------------

KMeansOptions kmeans_options(size_t codewords) {
  KMeansOptions o;
  o.num_codewords = codewords;
  o.threads = 1;
  return o;
}

// Weights over sixty powers of ten: sums of them lose the small ones, means must not.
TEST(KMeansNumerics, DuplicatesAreTheirOwnCodeword) {
  Random random(191);
  for (const float value : {0.1f, -1e15f, 1e-30f, 65504.0f, kDenormal}) {
    std::vector<float> points(4 * 3000, value), weights(3000);
    for (float& w : weights) w = static_cast<float>(std::pow(10.0, random.uniform(-30, 30)));
    for (const size_t codewords : {1u, 64u, 5000u}) {
      const Codebook codebook =
          train_codebook(points.data(), weights.data(), 3000, 4, kmeans_options(codewords));
      ASSERT_EQ(codebook.size(), 1u) << value;
      for (const float c : codebook.entries) EXPECT_EQ(c, value);
      EXPECT_EQ(codebook.weighted_distortion, 0);
    }
  }
}

TEST(KMeansNumerics, FewerPointsThanCodewordsAtAnyMagnitude) {
  Random random(192);
  for (const double magnitude : {1e-20, 1e-6, 1.0, 1e6, 1e15}) {
    std::vector<float> points(4 * 5);
    for (float& p : points) p = static_cast<float>(magnitude * random.normal());
    const Codebook codebook = train_codebook(points.data(), nullptr, 5, 4, kmeans_options(256));
    ASSERT_GE(codebook.size(), 1u);
    ASSERT_LE(codebook.size(), 5u);
    double scatter = 0;
    for (const float p : points) scatter += static_cast<double>(p) * static_cast<double>(p);
    EXPECT_LE(codebook.weighted_distortion, 1e-12 * scatter) << magnitude;
  }
}

// A point without weight must neither draw a codeword nor spoil one.
TEST(KMeansNumerics, PointsWithoutWeightDoNotCount) {
  std::vector<float> points, weights;
  for (int i = 0; i < 600; ++i) {
    const bool counts = i % 3 == 0;
    for (int k = 0; k < 4; ++k) points.push_back(counts ? static_cast<float>(i % 4) : 1e18f);
    weights.push_back(counts ? 1.0f : 0.0f);
  }
  const Codebook codebook =
      train_codebook(points.data(), weights.data(), 600, 4, kmeans_options(4));
  ASSERT_EQ(codebook.size(), 4u);
  for (const float c : codebook.entries) EXPECT_LE(c, 3.0f);
  EXPECT_EQ(codebook.weighted_distortion, 0);
}

// ---- residual stages ---------------------------------------------------------------------------

struct StageCase {
  const char* name;
  double magnitude, spread;  // centres, and what lies about them
  bool heavy_weights;
  size_t n;
};

class Stages : public testing::TestWithParam<StageCase> {};

// A stage more may never cost quality: not where what is left is below the steps of binary16, where
// it is near its largest number, where a few weights outweigh all others, or for one point.
TEST_P(Stages, NeverIncreaseTheWeightedError) {
  const StageCase& c = GetParam();
  Random random(193);
  std::vector<float> rows, weights;
  for (size_t i = 0; i < c.n; ++i) {
    const double centre = static_cast<double>(i % 7) - 3;
    for (int k = 0; k < 4; ++k) {
      rows.push_back(static_cast<float>(c.magnitude * (centre / 3 + c.spread * random.normal())));
    }
    const double weight =
        c.heavy_weights ? std::pow(10.0, random.uniform(-12, 12)) : random.uniform(0.1, 2);
    weights.push_back(i % 11 == 0 ? 0.0f : static_cast<float>(weight));
  }
  double before = HUGE_VAL;
  for (size_t stages = 1; stages <= L4D_MAX_STAGES; ++stages) {
    for (const float share : {1.0f, 0.3f}) {
      ComponentSettings s;
      s.codebook_size = 32;
      s.threads = 1;
      s.stages.assign(stages, share);
      s.stages[0] = 1;
      const CodedVq coded = code_vq(rows.data(), weights.data(), c.n, 4, {}, s);
      for (const float v : coded.decoded) ASSERT_TRUE(std::isfinite(v));
      if (share == 1) {
        EXPECT_LE(coded.weighted_distortion, before * (1 + 1e-9)) << stages << " stages";
        before = coded.weighted_distortion;
      }
      ASSERT_GE(coded.weighted_distortion, 0);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Data, Stages,
                         testing::Values(StageCase{"ordinary", 1, 0.1, false, 2000},
                                         StageCase{"exact", 3, 0, false, 2000},
                                         StageCase{"below_half_steps", 1, 1e-5, false, 2000},
                                         StageCase{"subnormal_halves", 1e-6, 0.1, false, 2000},
                                         StageCase{"below_all_halves", 1e-9, 0.1, false, 2000},
                                         StageCase{"largest_halves", 50000, 0.05, false, 2000},
                                         StageCase{"heavy_weights", 1, 0.1, true, 2000},
                                         StageCase{"seven_points", 1, 0.1, false, 7},
                                         StageCase{"one_point", 1, 0.1, false, 1}),
                         [](const testing::TestParamInfo<StageCase>& c) {
                           return std::string(c.param.name);
                         });

// ---- layers ------------------------------------------------------------------------------------

// One Gaussian to a layer: its codebooks hold one entry, which is the Gaussian.
TEST(OneGaussianLayers, KeepTheirGaussian) {
  SceneOptions options;
  options.count = 6;
  options.sh_degree = 0;
  options.num_frames = 300;
  TestScene scene = make_scene(options);
  for (size_t i = 0; i < scene.count(); ++i) {
    scene.mean_t[i] = 3.0f + static_cast<float>(i);
    const double tau = 0.9 * scene.duration() / std::exp2(static_cast<double>(i));
    scene.log_scale[4 * i + 3] = static_cast<float>(std::log(tau / 8.5));
    scene.log_scale[4 * i] = scene.log_scale[4 * i + 1] = scene.log_scale[4 * i + 2] = -9;
  }
  EncodeOptions o = small_options();
  o.settings.push_back({L4D_ENC_MERGE_COUNT, 0});
  o.settings.push_back({L4D_ENC_MERGE_FRACTION, 0});
  const Encoded e = encode(scene, o);
  EXPECT_TRUE(validate(e.bytes).empty());
  const GaussianArrays a = decode(e.bytes, all_query());
  ASSERT_EQ(a.count(), 6u);
  EXPECT_GE(e.report.num_layers, 5u);
  for (size_t i = 0; i < a.count(); ++i) {
    const size_t from = e.order[i];
    for (size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(a.log_scale[4 * i + k], scene.log_scale[4 * from + k], 4e-3);
    }
    double same = 0;
    for (size_t k = 0; k < 8; ++k) {
      same +=
          static_cast<double>(a.rotor[8 * i + k]) * static_cast<double>(scene.rotor[8 * from + k]);
    }
    // The gauge may have turned the frame; a still angle remains within what binary16 keeps.
    EXPECT_LE(std::fabs(same), 1.001);
    EXPECT_NEAR(a.mean_t[i], scene.mean_t[from], 10 * 0x1p-12);
  }
}

// ---- numbers at the end of the range -----------------------------------------------------------

struct Attribute {
  const char* name;
  std::vector<float> TestScene::*array;
  size_t dim;
};
constexpr Attribute kAttributes[] = {
    {"position", &TestScene::position, 3},   {"mean_t", &TestScene::mean_t, 1},
    {"log_scale", &TestScene::log_scale, 4}, {"rotor", &TestScene::rotor, 8},
    {"opacity", &TestScene::opacity, 1},     {"sh", &TestScene::sh, 12}};

TestScene hundred() {
  SceneOptions o;
  o.count = 100;
  return make_scene(o);
}

// Denormals are numbers. They decode to zero or to something as small beside the rest.
TEST(Denormals, AreAccepted) {
  for (const Attribute& a : kAttributes) {
    TestScene scene = hundred();
    for (size_t k = 0; k < a.dim; ++k) (scene.*a.array)[a.dim * 42 + k] = kDenormal;
    EncodeOptions o = small_options();
    const Encoded e = encode(scene, o);
    EXPECT_EQ(e.report.coded_gaussians, 100u) << a.name;
    EXPECT_TRUE(validate(e.bytes).empty()) << a.name;
    const GaussianArrays out = decode(e.bytes, all_query());
    for (const auto* v :
         {&out.position, &out.mean_t, &out.log_scale, &out.rotor, &out.opacity, &out.sh}) {
      for (const float x : *v) {
        ASSERT_TRUE(std::isfinite(x)) << a.name;
        ASSERT_TRUE(x == 0 || std::fabs(x) >= std::numeric_limits<float>::min()) << a.name;
      }
    }
  }
}

// The first and the last row, by name, flushed or not.
TEST(InvalidNumbers, AreNamedUnderFlushToZeroToo) {
  if (!FlushToZero::kAvailable) GTEST_SKIP() << "no flush-to-zero on this machine";
  const float kValues[] = {std::numeric_limits<float>::quiet_NaN(), HUGE_VALF, -HUGE_VALF};
  for (const Attribute& a : kAttributes) {
    for (const size_t row : {size_t{0}, size_t{99}}) {
      for (const float value : kValues) {
        TestScene scene = hundred();
        (scene.*a.array)[a.dim * row] = value;
        const FlushToZero scope;
        std::string what;
        try {
          encode(scene, small_options());
        } catch (const Error& error) {
          what = error.what();
        }
        EXPECT_NE(what.find("Gaussian " + std::to_string(row) + " "), std::string::npos) << what;
        EXPECT_NE(what.find(a.name), std::string::npos) << what;
        EncodeOptions drop = small_options();
        drop.settings.push_back({L4D_ENC_DROP_INVALID, 1});
        const Encoded e = encode(scene, drop);
        EXPECT_EQ(e.report.invalid_dropped, 1u);
        EXPECT_EQ(e.report.coded_gaussians, 99u);
        EXPECT_EQ(std::count(e.order.begin(), e.order.end(), row), 0);
      }
    }
  }
}

// ---- opacities at their ends -------------------------------------------------------------------

TEST(Opacity, ZeroAndOneStayInRange) {
  for (const bool logit : {false, true}) {
    for (const int bits : {1, 2, 5, 8, 11, 16}) {
      TestScene scene = hundred();
      scene.flags = logit ? static_cast<uint32_t>(L4D_OPACITY_LOGIT) : 0u;
      for (size_t i = 0; i < 100; ++i) {
        if (i % 3 == 0) scene.opacity[i] = logit ? -120.0f : 0.0f;
        if (i % 3 == 1) scene.opacity[i] = logit ? 120.0f : 1.0f;
        if (i % 3 == 2 && logit) scene.opacity[i] = 0.3f;
      }
      EncodeOptions o = small_options();
      o.settings.push_back({L4D_ENC_OPACITY_BITS, static_cast<double>(bits)});
      o.settings.push_back({L4D_ENC_CLOSED_LOOP, 0});
      const Encoded e = encode(scene, o);
      const GaussianArrays a = decode(e.bytes, all_query());
      for (size_t i = 0; i < a.count(); ++i) {
        EXPECT_GE(a.opacity[i], 0.0f);
        EXPECT_LE(a.opacity[i], 1.0f) << bits << " bits";
        if (e.order[i] % 3 == 2) continue;
        EXPECT_NEAR(a.opacity[i], e.order[i] % 3 == 0 ? 0 : 1, 1e-6);
      }
    }
  }
}

// A range that is empty is a constant and takes no bits.
TEST(Opacity, OneValueIsExact) {
  for (const float value : {0.0f, 1e-6f, 0.3333333f, 1.0f}) {
    TestScene scene = hundred();
    std::fill(scene.opacity.begin(), scene.opacity.end(), value);
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_CLOSED_LOOP, 0});
    for (const float x : decode(encode(scene, o).bytes, all_query()).opacity) {
      ASSERT_EQ(x, value);
    }
  }
}

// ---- flush-to-zero -----------------------------------------------------------------------------

TEST(FlushToZeroTest, DecodesAndEncodesTheSameBytes) {
  if (!FlushToZero::kAvailable) GTEST_SKIP() << "no flush-to-zero on this machine";
  for (const auto file : {dynamic_file, staged_file, rcq_file, lossless_file}) {
    for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU}) {
      for (const uint32_t threads : {1u, 7u}) {
        const GaussianArrays plain = decode(file(), all_query(), backend, threads);
        const FlushToZero scope;
        EXPECT_TRUE(same_bits(plain, decode(file(), all_query(), backend, threads)));
      }
    }
  }
  const TestScene scene = make_scene({});
  const Bytes plain = encode(scene, small_options()).bytes;
  const FlushToZero scope;
  EXPECT_TRUE(plain == encode(scene, small_options()).bytes);
}

}  // namespace
}  // namespace l4d::numerics
