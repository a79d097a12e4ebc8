// SPDX-License-Identifier: Apache-2.0
// The Gaussians of a scene as .4dgs has them, and the grids that their numbers are rounded to.
#pragma once

#include <string>
#include <vector>

#include "io/formats/fdgs.h"
#include "io/formats/instant.h"
#include "io/scene/rotor_math.h"

namespace l4d::io::fdgs {

// Opacity below which the file hides a Gaussian, as a part of its own: that of kVisibleSigmas, as
// in a stream.
constexpr double kCutoff = 3.3546262790251185e-4;

struct Born {
  size_t row = 0;  // of the scene
  Vec3 position{}, velocity{}, log_scale{};
  Vec4 wxyz{1, 0, 0, 0};
  double time = 0, sigma = 0;  // seconds from the begin of the sequence; infinity: never fades
  double begin = 0, end = 0;   // seconds in which it is seen
  uint32_t window = 0;
};

struct BornScene {
  double seconds = 0;
  std::vector<Born> gaussians;                     // that are seen at any time
  std::vector<std::pair<double, double>> windows;  // the first is the whole sequence
};
// Throws Error in the name of `path`.
BornScene born_scene(const Scene& scene, const std::string& path, WriteNotes* notes);

Grids grids_of(const BornScene& scene);

}  // namespace l4d::io::fdgs
