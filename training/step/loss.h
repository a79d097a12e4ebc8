// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

// The loss of one view and its derivative by the rendered pixels:
//
//   loss = (1 - w) mean |x - y| + w (1 - mean S),   x = E rgb + b,   y = alpha t + (1 - alpha) c
//
// rgb are the rendered pixels, E and b the exposure of the camera, t the captured pixels, c the
// background. S is the structural similarity with a Gaussian window of 11 x 11 pixels, sigma 1.5,
// and zeros outside of the image, C1 = 0.01^2, C2 = 0.03^2. Means are over the three channels of
// the pixels that count: those whose mask is not 0. In the others x and y are 0 for S, and the
// derivative is 0.
//
// Contract of loss.cc and loss.cu. loss.cc is the reference, for float and double; device code has
// the same functions for float with pointers to device memory, and sums within 1e-5 of it.
namespace l4d::train {

template <typename T>
struct LossView {
  uint32_t width, height;
  const T* rendered;      // [height, width, 3]
  const uint8_t* target;  // [height, width, 3]
  const uint8_t* alpha;   // [height, width] of the target, or null: opaque
  const uint8_t* mask;    // [height, width], or null: all pixels count
  const T* exposure;      // [3, 4] rows (E, b), or null: identity
  T background[3];        // behind a target with alpha; the renderer has the same
  T ssim_weight;          // w
};

// What the backward pass needs from the forward pass: [3, 3, height, width], by channel, then the
// factors a, b and c of dS/dx = G*a + 2x (G*b) + y (G*c), where G* is the window.
template <typename T>
using LossFactors = std::vector<T>;
template <typename T>
size_t loss_factors_size(const LossView<T>& view) {
  return size_t{9} * view.width * view.height;
}

struct LossSums {
  double absolute = 0;    // sum of |x - y|
  double squared = 0;     // sum of (x - y)^2
  double similarity = 0;  // sum of S
  uint64_t values = 0;    // 3 x pixels that count
  double loss(double ssim_weight) const {
    if (values == 0) return 0;
    const double n = static_cast<double>(values);
    return (1 - ssim_weight) * absolute / n + ssim_weight * (1 - similarity / n);
  }
};

// factors: [loss_factors_size]. Sums are in the order of rows, so they have the same bits always.
template <typename T>
LossSums loss_forward(const LossView<T>& view, T* factors);

// Writes the derivative of `weight` x loss by the rendered pixels to rgb_gradient [height, width,
// 3], and adds that by the exposure to exposure_gradient [3, 4], which may be null. factors, sums:
// of loss_forward for the same view.
template <typename T>
void loss_backward(const LossView<T>& view, const T* factors, const LossSums& sums, double weight,
                   T* rgb_gradient, double* exposure_gradient);

}  // namespace l4d::train
