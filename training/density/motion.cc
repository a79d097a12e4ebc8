// SPDX-License-Identifier: Apache-2.0
#include "training/density/motion.h"

#include <cmath>

#include "libl4dcodec/scene/slice.h"
#include "training/model/neighbours.h"

namespace l4d::train {

std::vector<float> neighbour_motion(const ModelState& model, double speed) {
  const size_t n = static_cast<size_t>(model.count);
  std::vector<float> places(4 * n), velocity(3 * n);
  for (size_t i = 0; i < n; ++i) {
    for (size_t c = 0; c < 3; ++c) places[4 * i + c] = model.value.position[3 * i + c];
    places[4 * i + 3] = static_cast<float>(speed * static_cast<double>(model.value.mean_t[i]));
    const Slice4D<float> slice =
        slice_attributes<float>(&model.value.rotor[8 * i], &model.value.log_scale[4 * i]);
    for (size_t c = 0; c < 3; ++c) velocity[3 * i + c] = slice.velocity[c];
  }
  std::vector<float> motion(3 * n, NAN);
  for_each_neighbourhood(places, 4, kMotionNeighbours,
                         [&](size_t i, const std::vector<Neighbour>& nearest) {
                           for (size_t c = 0; c < 3; ++c) {
                             float sum = 0;
                             for (const Neighbour& other : nearest) {
                               sum += velocity[3 * other.point + c];
                             }
                             motion[3 * i + c] = sum / static_cast<float>(nearest.size());
                           }
                         });
  return motion;
}

}  // namespace l4d::train
