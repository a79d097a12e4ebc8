// SPDX-License-Identifier: Apache-2.0
// What the writers of formats share that hold the 3D Gaussians of one instant.
#pragma once

#include <cstdint>
#include <string>

#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "io/scene/statements.h"

namespace l4d::io {

// What is known of the Gaussians besides themselves, for formats that have a place for it.
struct InstantSetting {
  l4d_placement placement{{0, 0, 0}, 1, L4D_COORDINATES_UNKNOWN, L4D_COLOR_SRGB};
  l4d_rendering rendering = default_rendering();
  double metres_per_unit = 0;  // of l4d_presentation
  Hold holder;                 // counts what a writer takes besides the Gaussians
  Check check;
};

// Fails with L4D_ERR_INVALID_SCENE, in the name of `path`.
void require_finite(const Splats& splats, const std::string& path);

// The base colour of Gaussian i in linear light, from 0 to 1: what viewers draw that know no
// Gaussians. is_linear: that of the scene is.
void linear_base_color(const Splats& splats, bool is_linear, size_t i, float* rgb);

// Half a turn around x, in place: down becomes up, and forward back, or the other way round.
void turn_around_x(Splats* splats);

// Turns the axes of `placement` into `wanted`, where they are known and others.
void turn_axes(const l4d_placement& placement, uint32_t wanted, Splats* splats);

}  // namespace l4d::io
