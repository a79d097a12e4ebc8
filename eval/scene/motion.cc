// SPDX-License-Identifier: Apache-2.0
#include "eval/scene/motion.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/scene/slice.h"
#include "libl4dcodec/scene/timeline.h"

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
  const Slice4D<double> slice =
      slice_attributes<double>(&scene.rotor[8 * index], &scene.log_scale[4 * index]);
  Motion m;
  for (size_t k = 0; k < 3; ++k) {
    m.position[k] = static_cast<double>(scene.position[3 * index + k]);
  }
  std::copy_n(slice.velocity, 3, m.velocity.begin());
  std::copy_n(slice.covariance, 6, m.covariance.begin());
  m.lambda = slice.lambda;
  m.sigma_t = 1 / std::sqrt(slice.lambda);
  m.mean_t = mean_t;
  m.anchor = (scene.flags & L4D_POSITION_AT_MEAN_TIME) != 0
                 ? m.mean_t
                 : reference_time(scene.timeline, m.mean_t);
  const FrameWindow window = window_in(scene, index);
  if (window.is_flat()) {
    m.lambda = 0;
    m.mean_t = window_middle(scene.timeline, window);
    m.sigma_t =
        (time_of_frame(scene.timeline, window.end) - time_of_frame(scene.timeline, window.begin)) /
        (2 * kVisibleSigmas);
  }
  return m;
}

FrameWindow window_in(const io::Scene& scene, size_t index) {
  if (scene.window.empty()) return {};
  return {scene.window[2 * index], scene.window[2 * index + 1]};
}

double linear_opacity(const io::Scene& scene, size_t index) {
  return l4d::linear_opacity(static_cast<double>(scene.opacity[index]),
                             (scene.flags & L4D_OPACITY_LOGIT) != 0);
}

VisibleSpan visible_span(const Motion& motion, double begin, double end) {
  const double reach = kVisibleSigmas * motion.sigma_t;
  return {std::max(begin, motion.mean_t - reach), std::min(end, motion.mean_t + reach)};
}

}  // namespace l4d::eval
