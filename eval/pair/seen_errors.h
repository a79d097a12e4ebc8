// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "eval/scene/motion.h"
#include "io/scene/scene.h"

namespace l4d::eval {

// What a viewer sees of the difference between two Gaussians, on the scale of the first.
struct SeenErrors {
  // Largest distance while the first has half of its greatest opacity in the sequence or more, over
  // its largest standard deviation.
  double position = 0;
  // Largest ratio of a principal variance of one to that of the other; or 1 and the largest change
  // of a variance in any direction in parts of the first's largest.
  double covariance = 1;
  double opacity = 0;  // largest difference at any instant
};

// Sizes below this, in scene units, count as this: 1/4000 of the largest side of the box that holds
// nine tenths of the scene on each axis, and a quarter more, where that is not beyond all of it.
double min_size(const io::Scene& scene);

SeenErrors seen_errors(const Motion& a, double opacity_a, const Motion& b, double opacity_b,
                       double begin, double end, double min_size);

}  // namespace l4d::eval
