// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "eval/shown_members.h"
#include "io/camera/cameras.h"
#include "io/scene/scene.h"
#include "l4d/l4d.hpp"

namespace l4d::eval {

struct CameraViews {
  io::CameraSet set;
  std::vector<io::View> views;  // as io::select_views orders them

  const io::Camera& camera_of(size_t view) const { return set.cameras[views[view].camera]; }
};

// At most `most` of the views, spread evenly over cameras and time.
CameraViews spread_views(CameraViews views, size_t most);

// Views for a fit, and others to judge the fit by.
struct DealtViews {
  CameraViews fit;
  CameraViews check;  // those of the fit where there are no others
};
// Deals at least one view of every instant to the fit, since a view tells nothing about Gaussians
// of other instants, and more of each instant until there are about `least`; a quarter as many
// others to the check. Cameras take turns.
DealtViews deal_views(const CameraViews& views, size_t least);

// The middle of the sequence: where orbits are laid out.
double middle_of(const l4d_timeline& timeline);
// The scene at an instant, as far as an orbit needs it: positions, opacities with their falloff,
// and what it states of how it is shown.
io::Scene instant_of(const io::Scene& scene, double seconds);
io::Scene instant_of(const DecoderHandle& decoder, double seconds);
io::Scene instant_of(ShownMembers& members, double seconds);

}  // namespace l4d::eval
