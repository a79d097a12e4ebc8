// SPDX-License-Identifier: Apache-2.0
#include "training/step/loss.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "io/image/metrics.h"

namespace l4d::train {
namespace {

// A view of random pixels, with all that a loss may have.
struct Example {
  static constexpr uint32_t kWidth = 19, kHeight = 14;
  std::vector<double> rendered;
  std::vector<uint8_t> target, alpha, mask;
  std::vector<double> exposure;

  explicit Example(unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> value(0.05, 0.95);
    const size_t n = size_t{kWidth} * kHeight;
    for (size_t i = 0; i < 3 * n; ++i) {
      rendered.push_back(value(random));
      target.push_back(static_cast<uint8_t>(255 * value(random)));
    }
    for (size_t i = 0; i < n; ++i) {
      alpha.push_back(static_cast<uint8_t>(255 * value(random)));
      mask.push_back(i % 7 == 3 ? 0 : 255);
    }
    exposure = {1.1, 0.02, -0.03, 0.01, 0.04, 0.9, 0.01, -0.02, -0.01, 0.03, 1.05, 0.02};
  }
  LossView<double> view(bool all) const {
    LossView<double> v{};
    v.width = kWidth;
    v.height = kHeight;
    v.rendered = rendered.data();
    v.target = target.data();
    v.ssim_weight = 0.2;
    v.background[0] = 0.2;
    v.background[1] = 0.7;
    v.background[2] = 0.4;
    if (!all) return v;
    v.alpha = alpha.data();
    v.mask = mask.data();
    v.exposure = exposure.data();
    return v;
  }
  double loss(bool all) const {
    const LossView<double> v = view(all);
    std::vector<double> factors(loss_factors_size(v));
    return loss_forward(v, factors.data()).loss(0.2);
  }
};

// Central differences in double against the backward pass, by every pixel and by the exposure.
TEST(Loss, DerivativesAreThoseOfTheLoss) {
  for (const bool all : {false, true}) {
    Example example(7);
    const LossView<double> view = example.view(all);
    std::vector<double> factors(loss_factors_size(view)), gradient(example.rendered.size());
    std::vector<double> by_exposure(12, 0);
    const LossSums sums = loss_forward(view, factors.data());
    loss_backward(view, factors.data(), sums, 1.0, gradient.data(), by_exposure.data());
    const double h = 1e-6;
    double norm = 0, error = 0;
    const auto difference = [&](double* number) {
      const double kept = *number;
      *number = kept + h;
      const double above = example.loss(all);
      *number = kept - h;
      const double below = example.loss(all);
      *number = kept;
      return (above - below) / (2 * h);
    };
    for (size_t i = 0; i < gradient.size(); ++i) {
      const double d = difference(&example.rendered[i]);
      error += (d - gradient[i]) * (d - gradient[i]);
      norm += d * d;
    }
    EXPECT_LT(std::sqrt(error / norm), 1e-6) << all;
    for (size_t i = 0; all && i < 12; ++i) {
      EXPECT_NEAR(difference(&example.exposure[i]), by_exposure[i], 1e-6) << i;
    }
    for (size_t i = 0; all && i < example.mask.size(); ++i) {
      if (example.mask[i] == 0) {
        EXPECT_EQ(gradient[3 * i], 0);
      }
    }
  }
}

TEST(Loss, FloatAgreesWithDouble) {
  const Example example(3);
  const LossView<double> view = example.view(true);
  const std::vector<float> rendered(example.rendered.begin(), example.rendered.end());
  const std::vector<float> exposure(example.exposure.begin(), example.exposure.end());
  LossView<float> small{};
  small.width = view.width;
  small.height = view.height;
  small.rendered = rendered.data();
  small.target = view.target;
  small.alpha = view.alpha;
  small.mask = view.mask;
  small.exposure = exposure.data();
  for (size_t c = 0; c < 3; ++c) small.background[c] = static_cast<float>(view.background[c]);
  small.ssim_weight = 0.2f;
  std::vector<double> factors(loss_factors_size(view)), gradient(rendered.size());
  std::vector<float> small_factors(factors.size()), small_gradient(rendered.size());
  const LossSums sums = loss_forward(view, factors.data());
  const LossSums small_sums = loss_forward(small, small_factors.data());
  EXPECT_NEAR(sums.loss(0.2), small_sums.loss(0.2), 1e-6);
  EXPECT_EQ(sums.values, small_sums.values);
  loss_backward(view, factors.data(), sums, 2.0, gradient.data(), nullptr);
  loss_backward(small, small_factors.data(), small_sums, 2.0, small_gradient.data(), nullptr);
  double norm = 0, error = 0;
  for (size_t i = 0; i < gradient.size(); ++i) {
    error += std::pow(gradient[i] - static_cast<double>(small_gradient[i]), 2);
    norm += gradient[i] * gradient[i];
  }
  EXPECT_LT(std::sqrt(error / norm), 1e-4);
}

// Away from the border, where both have whole windows, S is the similarity that evaluations report.
TEST(Loss, SimilarityIsThatOfEvaluations) {
  constexpr uint32_t kSize = 40;
  std::mt19937 random(1);
  std::uniform_int_distribution<int> level(0, 255);
  std::vector<uint8_t> target(3 * kSize * kSize);
  std::vector<double> rendered(target.size());
  io::Image a(kSize, kSize), b(kSize, kSize);
  for (size_t i = 0; i < target.size(); ++i) {
    target[i] = static_cast<uint8_t>(level(random));
    a.rgb[i] = static_cast<float>(target[i]) / 255;
    b.rgb[i] = std::min(1.0f, a.rgb[i] * 0.8f + 0.1f);
    rendered[i] = static_cast<double>(b.rgb[i]);
  }
  LossView<double> view{};
  view.width = view.height = kSize;
  view.rendered = rendered.data();
  view.target = target.data();
  std::vector<double> factors(loss_factors_size(view));
  const LossSums sums = loss_forward(view, factors.data());
  // The border is a fifth of the image, where zeros around both images make them more alike.
  EXPECT_NEAR(sums.similarity / static_cast<double>(sums.values), io::ssim(a, b), 0.05);
  EXPECT_NEAR(sums.squared / static_cast<double>(sums.values), io::mse(a, b), 1e-9);
}

TEST(Loss, OfEqualImagesIsZero) {
  std::vector<uint8_t> target(3 * 12 * 12, 100);
  std::vector<double> rendered(target.size(), 100.0 / 255);
  LossView<double> view{};
  view.width = view.height = 12;
  view.rendered = rendered.data();
  view.target = target.data();
  view.ssim_weight = 0.2;
  std::vector<double> factors(loss_factors_size(view));
  EXPECT_NEAR(loss_forward(view, factors.data()).loss(0.2), 0, 1e-12);
}

}  // namespace
}  // namespace l4d::train
