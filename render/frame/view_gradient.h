// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "render/frame/frame.h"
#include "render/view/view.h"

namespace l4d::render {

// Derivatives by what a view is of, as l4d_gradients::view has them.
constexpr int kViewNumbers = 9;

// Adds those of one Gaussian. A camera that turns and moves sees what it would see of a world that
// does so about its centre, and a longer lens sees one that is as much wider: so all of them are
// derivatives by a linear map of the world about the centre, x -> (1 + B) x, of which the
// covariance S becomes (1 + B) S (1 + B)^T, and by a shift of it.
// Colours stay, as directions do not change.
// position, covariance: of the Gaussian at the instant; by_time: by the instant.
template <typename T>
L4D_HOST_DEVICE void add_view_gradient(const View<T>& view, const T* position /* [3] */,
                                       const T* covariance /* [6] */,
                                       const SplatGradient3D<T>& by_slice, T by_time,
                                       T* out /* [kViewNumbers] */) {
  const T* s = covariance;
  const T* g = by_slice.covariance;
  const T full[9] = {s[0], s[1], s[2], s[1], s[3], s[4], s[2], s[4], s[5]};
  // By the entries, of which the two of a pair have half of what is by the number.
  const T by[9] = {g[0], g[1] / 2, g[2] / 2, g[1] / 2, g[3], g[4] / 2, g[2] / 2, g[4] / 2, g[5]};
  T map[9];  // [3, 3] by B
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      T sum = 0;
      for (int k = 0; k < 3; ++k) sum += by[3 * i + k] * full[3 * k + j];
      map[3 * i + j] =
          2 * sum + (by_slice.position[i] - by_slice.direction[i]) * (position[j] - view.center[j]);
    }
  }
  const T turn[3] = {map[7] - map[5], map[2] - map[6], map[3] - map[1]};
  out[0] += by_time;
  for (int k = 0; k < 3; ++k) {
    const T* axis = view.rotation + 3 * k;
    for (int j = 0; j < 3; ++j) {
      out[1 + k] += axis[j] * turn[j];
      out[4 + k] += axis[j] * by_slice.position[j];
      for (int i = 0; i < 3 && k < 2; ++i) out[7 + k] += axis[i] * map[3 * i + j] * axis[j];
    }
  }
}

}  // namespace l4d::render
