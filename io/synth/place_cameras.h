// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "io/scene/rotor_math.h"

namespace l4d::io::synth {

struct View {
  Vec3 eye, target;
  double degrees;  // vertical field of view
};

// Where cameras of a place stand.
struct Views {
  View named[8];  // 0: the first view that the scene states
  View (*ring)(double turns);
  Vec3 eyes[6], targets[6];  // of the walk
  double degrees;            // of the walk
};

}  // namespace l4d::io::synth
