// SPDX-License-Identifier: Apache-2.0
// What the tests of rendering on a device share.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <iostream>
#include <string>
#include <vector>

#include "tests/gpu/device.h"
#include "tests/render/scenes.h"

namespace l4d::render {

using test::has_device;

#define L4D_SKIP_WITHOUT_DEVICE() \
  if (!has_device()) GTEST_SKIP() << "there is no CUDA device that this build has code for"

inline RendererHandle make_device() {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = L4D_BACKEND_CUDA;
  return RendererHandle(&options);
}

// Two of three Gaussians with a flat window, of 1 to 5 frames.
inline io::Scene with_windows(io::Scene scene) {
  const uint32_t frames = scene.timeline.num_frames;
  for (uint32_t i = 0; i < scene.count(); ++i) {
    const uint32_t begin = i * 7 % frames;
    const bool flat = i % 3 != 0;
    scene.window.push_back(flat ? begin : 0);
    scene.window.push_back(flat ? std::min(begin + 1 + i % 5, frames) : 0);
  }
  return scene;
}

// Pixels of two images that are further apart than `step` in some channel, and the largest
// distance.
struct ImageDifference {
  size_t beyond = 0;
  double largest = 0;
};
inline ImageDifference difference_of(const std::vector<float>& a, const std::vector<float>& b,
                                     double step) {
  EXPECT_EQ(a.size(), b.size());
  ImageDifference out;
  for (size_t pixel = 0; 3 * pixel + 2 < std::min(a.size(), b.size()); ++pixel) {
    double most = 0;
    for (size_t c = 0; c < 3; ++c) {
      const double d =
          std::fabs(static_cast<double>(a[3 * pixel + c]) - static_cast<double>(b[3 * pixel + c]));
      most = d <= most ? most : d;  // NaN counts
    }
    out.largest = most <= out.largest ? out.largest : most;
    out.beyond += !(most <= step);
  }
  return out;
}

// |a - b| / |b| over all numbers.
inline double relative_distance(const std::vector<float>& a, const std::vector<float>& b) {
  EXPECT_EQ(a.size(), b.size());
  double difference = 0, size = 0;
  for (size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    const double d = static_cast<double>(a[k]) - static_cast<double>(b[k]);
    difference += d * d;
    size += static_cast<double>(b[k]) * static_cast<double>(b[k]);
  }
  return size > 0 ? std::sqrt(difference / size) : std::sqrt(difference);
}

}  // namespace l4d::render
