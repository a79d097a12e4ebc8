// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "io/synth/place_cameras.h"
#include "io/synth/synth.h"

namespace l4d::io::synth {

// A living room in the evening. Throws Error(L4D_ERR_INVALID_ARGUMENT) on effects that it lacks.
Scene make_living_room(const SynthOptions& options);
const Views& room_views();

}  // namespace l4d::io::synth
