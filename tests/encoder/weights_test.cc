// SPDX-License-Identifier: Apache-2.0
// What weights measured by Gauss-Newton mean: their squares weigh errors, and what the image
// changes by without a Gaussian decides whether it is coded.
#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

#include "encoder/layer/closed_loop.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using namespace test;

// Decoded attributes in the order of the scene given.
std::vector<float> in_order(const Encoded& e, const std::vector<float>& decoded, size_t dim) {
  std::vector<float> out(decoded.size());
  for (size_t i = 0; i < e.order.size(); ++i) {
    for (size_t k = 0; k < dim; ++k) out[dim * e.order[i] + k] = decoded[dim * i + k];
  }
  return out;
}

// Codebooks are trained by weighted squared errors. A weight measured as a sum is that weight; one
// of Gauss-Newton is its root.
TEST(GaussNewton, CodebooksWeighErrorsByItsSquare) {
  SceneOptions s;
  s.count = 1500;
  const TestScene scene = make_scene(s);
  Random random(4);
  std::vector<float> root(scene.count()), square(scene.count());
  for (size_t i = 0; i < root.size(); ++i) {
    root[i] = static_cast<float>(std::exp(2 * random.normal()));
    square[i] = root[i] * root[i];
  }
  const auto coded = [&](uint32_t metric, const std::vector<float>& weights) {
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 32});
    o.metric = metric;
    for (const uint32_t which :
         {L4D_WEIGHT_SH, L4D_WEIGHT_SCALE, L4D_WEIGHT_ROTOR_SPATIAL, L4D_WEIGHT_ROTOR_TEMPORAL}) {
      o.weights.emplace_back(which, &weights);
    }
    const Encoded e = encode(scene, o);
    const GaussianArrays a = decode(e.bytes, all_query());
    return std::vector<std::vector<float>>{in_order(e, a.sh, scene.sh_dim()),
                                           in_order(e, a.log_scale, 4), in_order(e, a.rotor, 8)};
  };
  const auto gauss_newton = coded(1, root), sums = coded(0, square), not_squared = coded(0, root);
  const char* const names[] = {"sh", "log_scale", "rotor"};
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_TRUE(same_bits(names[k], gauss_newton[k], sums[k]));
    EXPECT_FALSE(gauss_newton[k] == not_squared[k]) << names[k];
  }
}

// Gaussians without which the mean squared error of the image would be `share` of what 80 bits are
// worth elsewhere: a bit is worth 2 ln 2 of the error that one number may cause, and 66 numbers of
// each Gaussian share 10^(-quality / 10).
TEST(PruneCost, LeavesOutExactlyWhatIsWorthLessThanItsBits) {
  SceneOptions s;
  s.count = 600;
  TestScene scene = make_scene(s);
  const double n = static_cast<double>(scene.count());
  for (const bool logit : {false, true}) {
    for (const double quality : {35.0, 45.0}) {
      for (const double cost : {0.5, 1.0, 4.0}) {
        SCOPED_TRACE("quality " + std::to_string(quality) + ", cost " + std::to_string(cost) +
                     (logit ? ", logits" : ""));
        const double limit = cost * 80 * 2 * std::log(2.0) * std::pow(10, -quality / 10) / (66 * n);
        TestScene given = scene;
        given.flags = logit ? L4D_OPACITY_LOGIT : 0;
        std::vector<float> weights(scene.count());
        std::set<uint32_t> kept;
        for (uint32_t i = 0; i < weights.size(); ++i) {
          const double share = std::exp2(0.01 * (static_cast<double>(i) - 299.5));
          const double opacity = static_cast<double>(scene.opacity[i]);
          // Three channels: their errors add up in the weight and are averaged in the image.
          weights[i] = static_cast<float>(std::sqrt(3 * share * limit) / opacity);
          if (logit)
            given.opacity[i] = static_cast<float>(std::log(opacity / (1 - opacity + 1e-9)));
          if (share > 1) kept.insert(i);
        }
        EncodeOptions o;
        o.preset = "default";
        o.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
        o.settings = {{L4D_ENC_QUALITY, quality}, {L4D_ENC_PRUNE_COST, cost}};
        o.weights = {{L4D_WEIGHT_OPACITY, &weights}};
        const Encoded e = encode(given, o);
        EXPECT_EQ(e.report.pruned, scene.count() - kept.size());
        EXPECT_EQ(std::set<uint32_t>(e.order.begin(), e.order.end()), kept);
      }
    }
  }
}

// Of the opacities that a decoded Gaussian could have, the one chosen differs least from the
// original while either is seen.
TEST(SeenSpan, MatchOpacityFindsTheLeastSquares) {
  Random random(9);
  for (int i = 0; i < 300; ++i) {
    const double begin = 0, end = 2;
    const Fading original{random.uniform(0.05, 1), random.uniform(0, 2),
                          std::exp(random.uniform(-3, 9))};
    Fading decoded = original;
    decoded.mean += 0.7 * random.normal() / std::sqrt(original.lambda);
    decoded.lambda *= std::exp(0.7 * random.normal());
    const SeenSpan span({original, decoded}, begin, end);
    const double residual = span.match_opacity(original, &decoded);
    ASSERT_GE(decoded.opacity, 0);
    ASSERT_LE(decoded.opacity, 1);
    // Over instants as dense as can be; the span takes a dozen.
    const auto error = [&](double opacity) {
      double sum = 0;
      constexpr int kTimes = 4000;
      for (int k = 0; k < kTimes; ++k) {
        const double t = begin + (end - begin) * (k + 0.5) / kTimes;
        const auto shown = [&](const Fading& f, double o) {
          const double exponent = f.lambda * (t - f.mean) * (t - f.mean);
          return exponent <= 16 ? o * std::exp(-0.5 * exponent) : 0;
        };
        const double d = shown(original, original.opacity) - shown(decoded, opacity);
        sum += d * d;
      }
      return sum / kTimes;
    };
    const double chosen = error(decoded.opacity), scale = error(0) + 1e-12;
    for (int k = 0; k <= 100; ++k) {
      ASSERT_LE(chosen, error(0.01 * k) + 0.01 * scale) << i << ", opacity " << 0.01 * k;
    }
    EXPECT_GE(residual, -1e-12);
  }
}

// Weighted by how both are seen, the decoded Gaussian is on average where the original is, whatever
// the times at which their positions are given.
TEST(SeenSpan, MatchPositionPutsBothInOnePlace) {
  Random random(10);
  for (int i = 0; i < 300; ++i) {
    const double begin = 0, end = 2;
    const Fading original{1, random.uniform(0, 2), std::exp(random.uniform(-3, 6))};
    Fading decoded = original;
    decoded.mean += 0.3 * random.normal() / std::sqrt(original.lambda);
    decoded.lambda *= std::exp(0.3 * random.normal());
    Moving moving, fitted;
    for (int k = 0; k < 3; ++k) {
      moving.position[k] = random.normal();
      moving.velocity[k] = random.normal();
      fitted.velocity[k] = moving.velocity[k] + 0.5 * random.normal();
    }
    moving.reference = random.uniform(0, 2);
    fitted.reference = random.uniform(0, 2);
    SeenSpan({original, decoded}, begin, end).match_position(original, decoded, moving, &fitted);
    double sum = 0, apart[3] = {0, 0, 0};
    constexpr int kTimes = 4000;
    for (int t = 0; t < kTimes; ++t) {
      const double time = begin + (end - begin) * (t + 0.5) / kTimes;
      const auto fade = [&](const Fading& f) {
        const double exponent = f.lambda * (time - f.mean) * (time - f.mean);
        return exponent <= 16 ? std::exp(-0.5 * exponent) : 0;
      };
      const double w = fade(original) * fade(decoded);
      sum += w;
      for (int k = 0; k < 3; ++k) {
        apart[k] += w * (moving.position[k] + moving.velocity[k] * (time - moving.reference) -
                         fitted.position[k] - fitted.velocity[k] * (time - fitted.reference));
      }
    }
    const double span = std::min(2.0, 8 / std::sqrt(original.lambda));
    // The span takes a dozen instants.
    for (int k = 0; k < 3; ++k) ASSERT_LE(std::fabs(apart[k] / sum), 0.03 * span) << i;
  }
}

}  // namespace
}  // namespace l4d
