// SPDX-License-Identifier: Apache-2.0
// Small seeded scenes with the hard cases of trained ones.
#pragma once

#include <cstdint>
#include <vector>

#include "l4d/l4d.h"

namespace l4d::test {

struct SceneOptions {
  uint64_t count = 2000;
  uint32_t sh_degree = 1;
  uint32_t num_frames = 60;
  uint32_t fps_num = 30;
  uint32_t fps_den = 1;
  double time_begin = 0;
  uint64_t seed = 1;
  // Shares of all Gaussians; the rest moves and lives for a part of the sequence.
  double permanent = 0.3;  // no motion, no end
  double outside = 0.1;    // long-lived, mean time up to 20 durations outside the sequence
  double speed = 0.05;     // size of the temporal part of the rotors
  bool moving = true;
};

struct TestScene {
  l4d_timeline timeline{};
  uint32_t sh_degree = 0;
  uint32_t flags = 0;
  std::vector<float> position, mean_t, log_scale, rotor, opacity, sh;  // shapes of l4d_gaussians
  std::vector<double> mean_t_double;  // empty, or in place of mean_t
  std::vector<uint32_t> window;       // empty, or [n, 2]

  size_t count() const { return mean_t.size(); }
  size_t sh_dim() const { return 3 * (sh_degree + 1) * (sh_degree + 1); }
  double duration() const;
  l4d_gaussians view() const;
  void resize(size_t count);
};

TestScene make_scene(const SceneOptions& options);

// The first `count` Gaussians.
TestScene head(const TestScene& scene, size_t count);

}  // namespace l4d::test
