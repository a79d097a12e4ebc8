// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "eval/scene/shown_members.h"
#include "io/camera/cameras.h"
#include "io/scene/scene.h"
#include "l4d/l4d.hpp"
#include "l4d/render.h"

namespace l4d::eval {

struct CameraViews {
  io::CameraSet set;
  std::vector<io::View> views;  // as io::select_views orders them

  const io::Camera& camera_of(size_t view) const { return set.cameras[views[view].camera]; }
  // What l4d_measure_importance takes: the cameras of the set, and the views by their numbers.
  std::vector<l4d_camera> pinholes() const;
  std::vector<l4d_view> numbered() const;
};

// At most `most` of the views, spread evenly over cameras and time.
CameraViews spread_views(CameraViews views, size_t most);

// Of at most `cameras` cameras, spread evenly, at most `frames` views each that follow one another,
// in the middle.
CameraViews short_videos(CameraViews views, size_t cameras, size_t frames);

// A stride near 5/8 of n and prime to it: its multiples modulo n visit all of 0..n-1, and those
// that follow one another are far apart.
size_t golden_stride(size_t n);

// Views for a fit, and others to judge the fit by; both in the order of time.
struct DealtViews {
  CameraViews fit;
  CameraViews check;  // those of the fit where there are no others
};
// Deals about `most` views of all cameras and instants to the fit, but at least one of each
// instant, since a view tells nothing about Gaussians of other instants. About two thirds as many
// others go to the check: a quarter of them from instants all over, the others from a few instants
// as most cameras see them. Cameras take turns, so that each serves the fit and the check.
DealtViews deal_views(const CameraViews& views, size_t most);
// Whether a fit in about `most` of the views takes processors long: more than a quarter of an hour
// on two cores. Long sequences have a view of each instant to render, large images many pixels.
bool is_long_fit(const CameraViews& views, size_t most, size_t num_gaussians);

// The middle of the sequence: where orbits are laid out.
double middle_of(const l4d_timeline& timeline);
// The scene at an instant, as far as an orbit needs it: positions, opacities with their falloff,
// and what it states of how it is shown.
io::Scene instant_of(const io::Scene& scene, double seconds);
io::Scene instant_of(const DecoderHandle& decoder, double seconds);
io::Scene instant_of(ShownMembers& members, double seconds);

// Views of a scene that comes without cameras: of an orbit (io::orbit_cameras), within a place and
// around an object, as the first view tells that is stated or would be; each at another instant,
// small enough to cost little beside an encode.
CameraViews made_up_views(const io::Scene& scene, const io::Hold& holder = {});

}  // namespace l4d::eval
