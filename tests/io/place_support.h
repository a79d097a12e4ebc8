// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "io/scene/rotor_math.h"
#include "io/synth/synth.h"

// What tests of synthetic places share.
namespace l4d::io::test {

inline Scene place(const char* name, uint64_t gaussians, const std::vector<std::string>& effects,
                   double seconds, int threads, uint64_t seed) {
  SynthOptions options;
  options.scene = name;
  options.gaussians = gaussians;
  options.effects = effects;
  options.seconds = seconds;
  options.threads = threads;
  options.seed = seed;
  return synthesize(options);
}

inline uint64_t hash(const Scene& scene) {  // FNV-1a over the bits of all arrays
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

inline void expect_sound(const Scene& scene) {
  for (const auto* array :
       {&scene.position, &scene.mean_t, &scene.log_scale, &scene.opacity, &scene.sh}) {
    for (const float value : *array) ASSERT_TRUE(std::isfinite(value));
  }
  for (size_t i = 0; i < scene.count(); ++i) {
    const float* r = &scene.rotor[8 * i];
    // Both halves of a rotor of length 1 have length 1: |r| = 1 and r r~ has no pseudoscalar.
    double norm = 0;
    for (size_t k = 0; k < 8; ++k) norm += static_cast<double>(r[k]) * static_cast<double>(r[k]);
    const double off = static_cast<double>(r[0]) * static_cast<double>(r[7]) -
                       static_cast<double>(r[1]) * static_cast<double>(r[6]) +
                       static_cast<double>(r[2]) * static_cast<double>(r[5]) -
                       static_cast<double>(r[3]) * static_cast<double>(r[4]);
    ASSERT_NEAR(norm, 1, 1e-6) << i;
    ASSERT_NEAR(off, 0, 1e-6) << i;
  }
}

struct Moving {
  Vec3 p, v;
  double t;
};

// The Gaussians at their mean times.
inline std::vector<Moving> moving(const Scene& scene) {
  std::vector<Moving> out(scene.count());
  for (size_t i = 0; i < scene.count(); ++i) {
    Rotor rotor;
    Vec4 scale;
    for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
    for (size_t k = 0; k < 4; ++k) {
      scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
    }
    for (size_t k = 0; k < 3; ++k) out[i].p[k] = static_cast<double>(scene.position[3 * i + k]);
    out[i].v = velocity_of(rotor, scale);
    out[i].t = static_cast<double>(scene.mean_t[i]);
  }
  return out;
}

// Those of 5 seconds with one effect.
inline std::vector<Moving> moving(const char* name, const char* effect, uint64_t gaussians) {
  return moving(place(name, gaussians, {effect}, 5, 0, 1));
}

// The largest speed of a Gaussian, metres a second.
inline double fastest(const Scene& scene) {
  double most = 0;
  for (const Moving& m : moving(scene)) most = std::max(most, std::sqrt(dot(m.v, m.v)));
  return most;
}

}  // namespace l4d::io::test
