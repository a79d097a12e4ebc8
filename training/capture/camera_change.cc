// SPDX-License-Identifier: Apache-2.0
#include "training/capture/camera_change.h"

#include <algorithm>
#include <cmath>

#include "training/capture/capture.h"

namespace l4d::train {

l4d_camera changed(const l4d_camera& camera, const CameraChange& change) {
  l4d_camera out = camera;
  const double* w = &change[kTurn];
  const double square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = std::sqrt(square);
  // Rodrigues: x + a w x x + b w x (w x x).
  const double a = angle > 0 ? std::sin(angle) / angle : 1;
  const double b = angle > 0 ? (1 - std::cos(angle)) / square : 0.5;
  for (size_t k = 0; k < 4; ++k) {
    const double* m = camera.world_to_camera;
    const double x[3] = {m[k], m[4 + k], m[8 + k]};
    const double dot = w[0] * x[0] + w[1] * x[1] + w[2] * x[2];
    for (size_t r = 0; r < 3; ++r) {
      const size_t s = (r + 1) % 3, t = (r + 2) % 3;
      const double moved = k == 3 ? change[kMove + r] : 0;
      out.world_to_camera[4 * r + k] =
          x[r] + a * (w[s] * x[t] - w[t] * x[s]) + b * (w[r] * dot - square * x[r]) + moved;
    }
  }
  out.fx *= std::exp(change[kFocal]);
  out.fy *= std::exp(change[kFocal]);
  return out;
}

double Capture::time_of(uint32_t view) const {
  const double time = views[view].time, later = cameras[views[view].camera].change[kTime];
  return later == 0 ? time : std::clamp(time + later, 0.0, duration());
}

io::CameraSet camera_set(const Capture& capture) {
  io::CameraSet set;
  set.fps = capture.fps;
  set.frames = capture.frames;
  for (const CaptureCamera& from : capture.cameras) {
    io::Camera camera = from.source;
    if (camera.video.empty() && camera.images.empty()) {
      throw io::Error(L4D_ERR_FEATURE_UNSUPPORTED,
                      capture.path + ": its images have cameras of their own, and no clocks");
    }
    camera.camera = changed(camera.camera, from.change);
    camera.time_offset += from.change[kTime];
    camera.split = from.split;
    set.cameras.push_back(std::move(camera));
  }
  return set;
}

}  // namespace l4d::train
