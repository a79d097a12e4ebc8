// SPDX-License-Identifier: Apache-2.0
#include "io/image/metrics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "tests/io/support.h"

namespace l4d::io {
namespace {

// A smooth picture with noise; values leave [0, 1].
Image picture(uint32_t width, uint32_t height, uint64_t seed, double noise) {
  Image image(width, height);
  reference::Random random(seed);
  for (size_t i = 0; i < image.rgb.size(); ++i) {
    const size_t x = i / 3 % width, y = i / 3 / width;
    const double smooth =
        0.5 + 0.6 * std::sin(0.1 * static_cast<double>(x + i % 3) + 0.07 * static_cast<double>(y));
    image.rgb[i] = static_cast<float>(smooth + noise * random.normal());
  }
  return image;
}

// SSIM from its definition: a window of 121 weights at every place.
double direct_ssim(const Image& a, const Image& b) {
  double window[11][11], weight_sum = 0;
  for (int r = 0; r < 11; ++r) {
    for (int c = 0; c < 11; ++c) {
      window[r][c] = std::exp(-((r - 5) * (r - 5) + (c - 5) * (c - 5)) / (2 * 1.5 * 1.5));
      weight_sum += window[r][c];
    }
  }
  double total = 0;
  size_t count = 0;
  for (size_t y = 0; y + 11 <= a.height; ++y) {
    for (size_t x = 0; x + 11 <= a.width; ++x) {
      for (size_t channel = 0; channel < 3; ++channel) {
        double mean_a = 0, mean_b = 0, aa = 0, bb = 0, ab = 0;
        for (size_t r = 0; r < 11; ++r) {
          for (size_t c = 0; c < 11; ++c) {
            const size_t at = 3 * ((y + r) * a.width + x + c) + channel;
            const double w = window[r][c] / weight_sum;
            const double va = std::clamp(static_cast<double>(a.rgb[at]), 0.0, 1.0);
            const double vb = std::clamp(static_cast<double>(b.rgb[at]), 0.0, 1.0);
            mean_a += w * va;
            mean_b += w * vb;
            aa += w * va * va;
            bb += w * vb * vb;
            ab += w * va * vb;
          }
        }
        const double c1 = 0.0001, c2 = 0.0009;
        total += (2 * mean_a * mean_b + c1) * (2 * (ab - mean_a * mean_b) + c2) /
                 ((mean_a * mean_a + mean_b * mean_b + c1) *
                  (aa - mean_a * mean_a + bb - mean_b * mean_b + c2));
        ++count;
      }
    }
  }
  return total / static_cast<double>(count);
}

TEST(Metrics, MseClampsAndMeansOverChannels) {
  Image a(2, 1), b(2, 1);
  a.rgb = {0.5F, -3, 7, NAN, 0.25F, 1};
  b.rgb = {0.25F, 0, 1, 0, 0.5F, 0.5F};
  EXPECT_DOUBLE_EQ(mse(a, b), (0.0625 + 0.0625 + 0.25) / 6);
  EXPECT_DOUBLE_EQ(mse(b, a), mse(a, b));
  EXPECT_EQ(mse(a, a), 0);
}

TEST(Metrics, PsnrByHand) {
  EXPECT_DOUBLE_EQ(psnr_of_mse(0.01), 20);
  EXPECT_NEAR(psnr_of_mse(1 / (255.0 * 255)), 48.1308036, 1e-7);
  EXPECT_EQ(psnr_of_mse(1), 0);
  EXPECT_EQ(psnr_of_mse(0), std::numeric_limits<double>::infinity());
}

TEST(Metrics, SsimIsThatOfTheDefinition) {
  const struct {
    uint32_t width, height;
    double noise;
  } cases[] = {{11, 11, 0.1}, {40, 23, 0.02}, {24, 80, 0.3}, {13, 150, 0.1}};
  for (const auto& c : cases) {
    const Image a = picture(c.width, c.height, 1, 0);
    const Image b = picture(c.width, c.height, 2, c.noise);
    const double expected = direct_ssim(a, b);
    EXPECT_LT(expected, 0.999);
    for (const uint32_t threads : {0U, 1U, 2U, 5U}) {
      EXPECT_NEAR(ssim(a, b, threads), expected, 2e-6);
      EXPECT_EQ(ssim(a, b, threads), ssim(a, b));
    }
  }
}

// A mask leaves the figures of its own pixels, and not of what is black beside them.
TEST(Metrics, MasksLeaveTheirPixels) {
  Image a(40, 24), b(40, 24);
  std::mt19937 random(3);
  const auto noise = [&] { return static_cast<float>(random() % 1000) / 999; };
  std::vector<uint8_t> mask(size_t{40} * 24);
  double sum = 0;
  for (size_t i = 0; i < mask.size(); ++i) {
    mask[i] = i % 40 < 13 ? 255 : 0;
    for (size_t c = 3 * i; c < 3 * i + 3; ++c) {
      a.rgb[c] = noise();
      b.rgb[c] = mask[i] != 0 ? noise() : a.rgb[c];
      sum += std::pow(static_cast<double>(a.rgb[c] - b.rgb[c]), 2);
    }
  }
  EXPECT_NEAR(mse(a, b, mask), sum / (3 * 13 * 24), 1e-9);
  // Windows around the mask's columns 5 to 12 reach column 17.
  Image left_a(18, 24), left_b(18, 24);
  for (size_t y = 0; y < 24; ++y) {
    for (size_t x = 0; x < size_t{3} * 18; ++x) {
      left_a.rgb[y * 54 + x] = a.rgb[y * 120 + x];
      left_b.rgb[y * 54 + x] = b.rgb[y * 120 + x];
    }
  }
  EXPECT_NEAR(ssim(a, b, 1, mask), ssim(left_a, left_b), 1e-6);
  EXPECT_EQ(ssim(a, b, 1, mask), ssim(a, b, 4, mask));
  EXPECT_GT(ssim(a, b), 2 * ssim(a, b, 1, mask));
  const std::vector<uint8_t> none(mask.size());
  EXPECT_TRUE(std::isnan(mse(a, b, none)));
  EXPECT_TRUE(std::isnan(ssim(a, b, 1, none)));
  EXPECT_THROW(mse(a, b, {1, 2}), Error);
}

TEST(Metrics, SsimOfEqualAndOfFlatImages) {
  const Image a = picture(50, 30, 1, 0.1);
  EXPECT_NEAR(ssim(a, a), 1, 1e-6);
  Image dark(20, 20), light(20, 20);
  std::fill(dark.rgb.begin(), dark.rgb.end(), 0.25F);
  std::fill(light.rgb.begin(), light.rgb.end(), 0.75F);
  EXPECT_NEAR(ssim(dark, light), (2 * 0.25 * 0.75 + 1e-4) / (0.0625 + 0.5625 + 1e-4), 1e-3);
}

TEST(Metrics, SizesMustFit) {
  const auto status = [](const Image& a, const Image& b) {
    return std::make_pair(test::status_of([&] { mse(a, b); }),
                          test::status_of([&] { ssim(a, b); }));
  };
  const std::pair<l4d_status, l4d_status> both(L4D_ERR_INVALID_ARGUMENT, L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status(Image(20, 30), Image(30, 20)), both);
  EXPECT_EQ(status(Image(), Image()), both);
  EXPECT_EQ(status(Image(10, 30), Image(10, 30)).second, L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status(Image(10, 30), Image(10, 30)).first, L4D_OK);
}

TEST(Metrics, FidelityOfSeveralViews) {
  FidelityAccumulator accumulator;
  EXPECT_TRUE(std::isnan(accumulator.result().psnr));
  EXPECT_TRUE(std::isnan(accumulator.result().mean_ssim));
  accumulator.add(0.01, 0.9);
  accumulator.add(0.0001, 0.8);
  accumulator.add(0.001, 0.7);
  const Fidelity fidelity = accumulator.result();
  EXPECT_EQ(fidelity.views, 3U);
  EXPECT_NEAR(fidelity.psnr, -10 * std::log10(0.0037), 1e-12);
  EXPECT_NEAR(fidelity.min_psnr, 20, 1e-12);
  EXPECT_NEAR(fidelity.mean_psnr, 30, 1e-12);
  EXPECT_NEAR(fidelity.mean_ssim, 0.8, 1e-12);
  FidelityAccumulator equal;
  equal.add(0, 1);
  EXPECT_TRUE(std::isinf(equal.result().psnr) && std::isinf(equal.result().min_psnr));
}

}  // namespace
}  // namespace l4d::io
