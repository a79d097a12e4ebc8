// SPDX-License-Identifier: Apache-2.0
#include "eval/motion.h"

#include <algorithm>
#include <cmath>

namespace l4d::eval {

io::Vec3 Motion::at(double seconds) const {
  const double dt = seconds - anchor;
  return {position[0] + velocity[0] * dt, position[1] + velocity[1] * dt,
          position[2] + velocity[2] * dt};
}

Motion motion_of(const io::Scene& scene, size_t index) {
  return motion_of(scene, index, scene.mean_time(index));
}

Motion motion_of(const io::Scene& scene, size_t index, double mean_t) {
  io::Rotor rotor;
  io::Vec4 scale;
  for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * index + k]);
  for (size_t k = 0; k < 4; ++k) {
    scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * index + k]));
  }
  const io::Slice slice = io::slice(rotor, scale);
  Motion m;
  for (size_t k = 0; k < 3; ++k) {
    m.position[k] = static_cast<double>(scene.position[3 * index + k]);
  }
  m.velocity = slice.velocity;
  m.sigma_t = slice.sigma_t;
  m.mean_t = mean_t;
  const double begin = scene.timeline.time_begin;
  m.anchor = (scene.flags & L4D_POSITION_AT_MEAN_TIME) != 0
                 ? m.mean_t
                 : std::clamp(m.mean_t, begin, begin + io::duration(scene.timeline));
  size_t entry = 0;
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = i; j < 3; ++j) {
      double sum = 0;
      for (size_t k = 0; k < 4; ++k) sum += slice.rows[i][k] * slice.rows[j][k];
      m.covariance[entry++] = sum;
    }
  }
  return m;
}

double linear_opacity(const io::Scene& scene, size_t index) {
  const double value = static_cast<double>(scene.opacity[index]);
  return (scene.flags & L4D_OPACITY_LOGIT) != 0 ? 1 / (1 + std::exp(-value)) : value;
}

VisibleSpan visible_span(const Motion& motion, double begin, double end) {
  return {std::max(begin, motion.mean_t - 4 * motion.sigma_t),
          std::min(end, motion.mean_t + 4 * motion.sigma_t)};
}

}  // namespace l4d::eval
