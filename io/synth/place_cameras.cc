// SPDX-License-Identifier: Apache-2.0
#include "io/synth/place_cameras.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "io/camera/read_cameras.h"
#include "io/camera/write_cameras.h"
#include "io/synth/room/room.h"
#include "io/synth/square.h"
#include "io/synth/surface.h"

namespace l4d::io {
namespace {

using namespace synth;  // of vectors

constexpr int kWidth = 960, kHeight = 540;

Camera camera(int id, const char* split, const synth::View& view) {
  const Vec3 forward = unit(view.target - view.eye);
  const Vec3 right = unit(cross(forward, kUp)), down = cross(forward, right);
  const double half = view.degrees / 720;  // turns
  Camera out;
  out.id = id;
  out.split = split;
  l4d_camera& c = out.camera = default_camera();
  c.width = kWidth;
  c.height = kHeight;
  c.fx = c.fy = kHeight / 2.0 * cos_turns(half) / sin_turns(half);
  c.cx = kWidth / 2.0;
  c.cy = kHeight / 2.0;
  double* row = c.world_to_camera;
  for (const Vec3& axis : {right, down, forward}) {
    std::copy_n(axis.begin(), 3, row);
    row[3] = 0.0 - dot(axis, view.eye);
    row += 4;
  }
  return out;
}

// Catmull-Rom through six points, s of 0..1.
Vec3 spline(const Vec3 (&points)[6], double s) {
  const double x = s * 5;
  const int i = std::min(static_cast<int>(x), 4);
  const double f = x - i;
  const auto at = [&](int k) { return points[std::min(std::max(k, 0), 5)]; };
  const Vec3 a = at(i - 1), b = at(i), c = at(i + 1), d = at(i + 2);
  return (b * 2 + (c - a) * f + (a * 2 - b * 5 + c * 4 - d) * (f * f) +
          ((b - c) * 3 + d - a) * (f * f * f)) *
         0.5;
}

}  // namespace

void write_place_cameras(const std::string& path, const std::string& place,
                         const l4d_timeline& timeline) {
  if (place != "square" && place != "room") {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "scene " + place + " has no cameras");
  }
  const Views& views = place == "square" ? square_views() : room_views();
  CameraSet set;
  std::vector<Camera>& cameras = set.cameras;
  for (int k = 0; k < 8; ++k) cameras.push_back(camera(k, "test", views.named[k]));
  for (int k = 0; k < 24; ++k) cameras.push_back(camera(100 + k, "train", views.ring(k / 24.0)));
  const int walk = static_cast<int>(std::min<uint32_t>(150, timeline.num_frames));
  for (int k = 0; k < walk; ++k) {
    const double s = walk > 1 ? k / (walk - 1.0) : 0;
    cameras.push_back(
        camera(200 + k, "test", {spline(views.eyes, s), spline(views.targets, s), views.degrees}));
  }
  set.fps = timeline.num_frames / duration(timeline);
  set.frames = timeline.num_frames;
  write_cameras(path, set);
}

}  // namespace l4d::io
