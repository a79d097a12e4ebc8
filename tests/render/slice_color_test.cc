// SPDX-License-Identifier: Apache-2.0
// Colours of a decoder's slice are those that the reference renderer gives the same Gaussians.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "render/frame/project.h"
#include "tests/common/codec.h"

namespace l4d::render {
namespace {

TEST(SliceColors, AreThoseOfTheRenderer) {
  for (const auto& file : {&test::dynamic_file, &test::transform_file, &test::lossless_file}) {
    const Bytes& bytes = file();
    DecoderHandle d;
    d.open_memory(bytes.data(), bytes.size());
    SliceOptions options;
    options.color = true;
    const double camera[3] = {0.3, -1.5, 4};
    std::copy_n(camera, 3, options.camera_position);
    View<double> view;
    std::copy_n(camera, 3, view.center);
    view.rotation[8] = 1;
    size_t clamped = 0, colored = 0;
    for (const double time : {0.1, 0.9, 1.7}) {
      const SplatArrays s = d.slice(time, options);
      const size_t numbers = 3 * sh_terms(s.sh_degree);
      Frame<double> frame;
      frame.sh_degree = s.sh_degree;
      for (size_t i = 0; i < s.count(); ++i) {
        for (size_t k = 0; k < 3; ++k) {
          frame.position[k].push_back(static_cast<double>(s.position[3 * i + k]));
        }
        frame.sh.push_back(s.sh.data() + numbers * i);
      }
      for (size_t i = 0; i < s.count(); ++i) {
        Splat<double> splat;
        shade(view, frame, i, &splat);
        for (size_t k = 0; k < 3; ++k) {
          ASSERT_EQ(s.color[3 * i + k], static_cast<float>(splat.color[k])) << i;
          clamped += s.color[3 * i + k] == 0;
          colored += s.color[3 * i + k] > 0;
        }
      }
    }
    EXPECT_GT(colored, 1000u);
    EXPECT_GT(clamped + colored, colored) << "nothing was clamped";
  }
}

// A Gaussian at the camera is seen along +z.
TEST(SliceColors, InsideAGaussianTheViewIsAlongZ) {
  const Bytes& bytes = test::dynamic_file();
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  const SplatArrays s = d.slice(0.9);
  SliceOptions options;
  options.color = true;
  for (size_t k = 0; k < 3; ++k) options.camera_position[k] = static_cast<double>(s.position[k]);
  const double along_z[3] = {0, 0, 1};
  double want[3];
  sh_color(s.sh_degree, s.sh.data(), along_z, want);
  clamp_color(want);
  const SplatArrays seen = d.slice(0.9, options);
  for (size_t k = 0; k < 3; ++k) EXPECT_EQ(seen.color[k], static_cast<float>(want[k]));
}

}  // namespace
}  // namespace l4d::render
