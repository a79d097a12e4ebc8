// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "io/camera/subject.h"
#include "io/scene/rotor_math.h"
#include "io/scene/scene.h"

namespace l4d::io {

// What stands where in a scene: of each cell of a grid around the subject how much it hides, and
// how much it shows.
class SightGrid {
 public:
  SightGrid(const Scene& scene, const Subject& subject);

  // How much of the dense parts is seen from `eye` around the direction of `target`, times how much
  // of the image is free of what is close to the eye. up: not parallel to that direction. free: so
  // far from the eye nothing hides anything, scene units.
  double seen_from(const Vec3& eye, const Vec3& target, const Vec3& up, double free = 0) const;

  // How much of the subject is the same on both sides of the upright plane through it that `level`
  // lies in, from 0 to 1: statues and people have such a plane, and face along it.
  double symmetry(const Vec3& level, const Vec3& up) const;

 private:
  double clear_from(const Vec3& eye, const Vec3& target, const Vec3& up, double free) const;
  size_t cell_of(const Vec3& p) const;  // depth_.size() outside
  Vec3 middle_of(size_t cell) const;
  void hide(const Vec3& p, double opacity, double share);
  void find_dense();
  double depth_between(const Vec3& at, const Vec3& way, double distance) const;

  Subject subject_;
  double cell_;
  std::vector<double> depth_, weight_;
  std::vector<std::pair<Vec3, double>> dense_;
};

}  // namespace l4d::io
