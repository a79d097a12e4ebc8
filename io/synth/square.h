// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "io/scene/rotor_math.h"
#include "io/synth/synth.h"

namespace l4d::io::synth {

// A market square at dusk. Throws Error(L4D_ERR_INVALID_ARGUMENT) on effects that it lacks.
Scene make_square(const SynthOptions& options);

// Where the first view stands, what it looks at, and its vertical field of view in degrees.
struct View {
  Vec3 eye, target;
  double degrees;
};
constexpr View kFirstView{{-1.5, 2.6, 13.4}, {0.3, 3.15, -3.0}, 40};

}  // namespace l4d::io::synth
