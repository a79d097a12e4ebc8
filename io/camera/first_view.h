// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "io/camera/cameras.h"
#include "io/scene/rotor_math.h"
#include "io/scene/scene.h"

// Where a player stands at first. Each function sets the camera of the presentation and keeps the
// rest of it.
namespace l4d::io {

// The view of the camera nearest to the middle of those that look ahead rather than up or down,
// towards the point of its axis that is nearest to all axes; upright, if it was held askew. alone:
// distance of that point where there is but one camera, scene units. Nothing happens where there is
// none.
void state_first_view(const std::vector<l4d_camera>& cameras, double alone,
                      l4d_presentation* presentation);

// The same of the cameras that train, or of all where none says so; of those that look ahead the
// one that sees most of the dense parts of the scene (below).
// holder: counts what choosing takes, subject_bytes().
void state_first_view(const CameraSet& set, const Scene& scene, l4d_presentation* presentation,
                      const Hold& holder = {});

// Without cameras: of a few dozen places around and within the subject of the scene
// (io/camera/subject.h) the one from where most of its dense parts are seen, past whatever stands
// before them. Nothing happens where no Gaussian is visible.
void state_first_view(const Scene& scene, l4d_presentation* presentation, const Hold& holder = {});

// That of `from`.
void copy_first_view(const l4d_presentation& from, l4d_presentation* presentation);

// The view turned about the point that it looks at, by angles in radians: around its up direction,
// and then upwards, short of the pole. zoom: how many times nearer it is.
l4d_presentation turned(const l4d_presentation& presentation, double angle, double rise = 0,
                        double zoom = 1);

// Puts a camera at `eye`; `forward` has length 1 and is not parallel to `up`, which shows upwards
// in the image.
void place(const Vec3& eye, const Vec3& forward, const Vec3& up, l4d_camera& camera);

// The camera that sees what the presentation's shows, in an image of this size.
l4d_camera camera_of(const l4d_presentation& presentation, uint32_t width, uint32_t height);

}  // namespace l4d::io
