// SPDX-License-Identifier: Apache-2.0
#include "tests/common/test_scene.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/layers.h"
#include "tests/common/random.h"

namespace l4d::test {
namespace {

void random_half(Random& random, double* half) {
  for (int k = 0; k < 4; ++k) half[k] = random.normal();
  normalize_half(half);
}

// A rotor whose temporal part has about the length `speed`.
void random_rotor(Random& random, double speed, float* out) {
  RotorHalves<double> h;
  random_half(random, h.a);
  for (int k = 0; k < 4; ++k) h.b[k] = h.a[k] + speed * random.normal();
  if (speed > 0) normalize_half(h.b);
  double rotor[8];
  rotor_of_halves(h, rotor);
  for (int k = 0; k < 8; ++k) out[k] = static_cast<float>(rotor[k]);
}

}  // namespace

double TestScene::duration() const { return sequence_duration(timeline); }

l4d_gaussians TestScene::view() const {
  l4d_gaussians g = L4D_INIT(l4d_gaussians);
  g.count = count();
  g.sh_degree = sh_degree;
  g.flags = flags;
  g.position = position.data();
  g.mean_t = mean_t.data();
  g.mean_t_double = mean_t_double.empty() ? nullptr : mean_t_double.data();
  g.window = window.empty() ? nullptr : window.data();
  g.log_scale = log_scale.data();
  g.rotor = rotor.data();
  g.opacity = opacity.data();
  g.sh = sh.data();
  return g;
}

void TestScene::resize(size_t n) {
  position.resize(3 * n);
  mean_t.resize(n);
  if (!window.empty()) window.resize(2 * n);
  log_scale.resize(4 * n);
  rotor.resize(8 * n);
  opacity.resize(n);
  sh.resize(sh_dim() * n);
}

TestScene make_scene(const SceneOptions& options) {
  TestScene s;
  s.timeline.time_begin = options.time_begin;
  s.timeline.num_frames = options.num_frames;
  s.timeline.fps_num = options.fps_num;
  s.timeline.fps_den = options.fps_den;
  s.sh_degree = options.sh_degree;
  s.resize(options.count);
  const double duration = s.duration();
  const double levels = num_layers(options.num_frames);
  Random random(options.seed);
  for (size_t i = 0; i < s.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) s.position[3 * i + k] = static_cast<float>(3 * random.normal());
    for (size_t k = 0; k < 3; ++k) s.log_scale[4 * i + k] = random.uniformf(-6, -2);
    s.opacity[i] = random.uniformf(0.01, 1);
    for (size_t k = 0; k < s.sh_dim(); ++k) {
      s.sh[s.sh_dim() * i + k] = static_cast<float>((k < 3 ? 1.0 : 0.2) * random.normal());
    }
    const double kind = random.uniform();
    double mean = random.uniform(0, duration);
    double sigma = 0;
    double speed = options.moving ? options.speed : 0;
    if (kind < options.permanent) {
      sigma = 100 * duration;
      mean = 0.5 * duration;
      speed = 0;
    } else if (kind < options.permanent + options.outside) {
      mean = duration * random.uniform(-20, 20);
      sigma = duration * random.uniform(2, 10);
    } else {
      sigma = duration / 8 * std::exp2(-random.uniform(-2, levels));
    }
    s.mean_t[i] = static_cast<float>(options.time_begin + mean);
    s.log_scale[4 * i + 3] = static_cast<float>(std::clamp(std::log(sigma), -15.9, 15.9));
    random_rotor(random, speed, s.rotor.data() + 8 * i);
  }
  return s;
}

TestScene head(const TestScene& scene, size_t count) {
  TestScene s = scene;
  s.resize(count);
  return s;
}

}  // namespace l4d::test
