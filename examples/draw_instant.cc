// SPDX-License-Identifier: Apache-2.0
// Opens a stream and draws an instant of it, from the first view that it states, as draw_instant.c
// does.
//
//   draw_instant SCENE.l4d SECONDS OUT.ppm
//   c++ -std=c++17 draw_instant.cc $(pkg-config --cflags --libs l4drender)
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "l4d/render.hpp"

namespace {

using Vec3 = std::array<double, 3>;

Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
Vec3 unit(const Vec3& v) {
  const double length = std::sqrt(dot(v, v));
  return {v[0] / length, v[1] / length, v[2] / length};
}

// Camera axes: x right, y down, z forward.
l4d_camera camera_of(l4d_presentation view, uint32_t width, uint32_t height) {
  if (view.has_camera == 0) {  // a stream need not say it: here, from in front of the origin
    view.camera_position[2] = -4;
    view.camera_up[1] = -1;
    view.camera_fov = 0.9;
  }
  const double* p = view.camera_position;
  const double* t = view.camera_target;
  const Vec3 eye{p[0], p[1], p[2]};
  const Vec3 forward = unit({t[0] - p[0], t[1] - p[1], t[2] - p[2]});
  const Vec3 right =
      unit(cross(forward, {view.camera_up[0], view.camera_up[1], view.camera_up[2]}));
  l4d_camera camera = L4D_INIT(l4d_camera);
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = 0.5 * height / std::tan(0.5 * view.camera_fov);
  camera.cx = 0.5 * width;
  camera.cy = 0.5 * height;
  double* to = camera.world_to_camera;
  for (const Vec3& axis : {right, cross(forward, right), forward}) {
    to = std::copy(axis.begin(), axis.end(), to);
    *to++ = -dot(axis, eye);
  }
  return camera;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: draw_instant SCENE.l4d SECONDS OUT.ppm\n");
    return 2;
  }
  try {
    l4d::DecoderHandle decoder;
    decoder.open_file(argv[1]);
    const l4d_camera camera = camera_of(decoder.presentation(), 640, 360);
    l4d::RendererHandle renderer;
    renderer.set_decoder(decoder);
    renderer.set_time(std::stod(argv[2]));
    std::string ppm = "P6\n640 360\n255\n";
    for (const float v : renderer.render(camera)) {
      ppm += static_cast<char>(std::lround(255 * std::clamp(v, 0.0f, 1.0f)));
    }
    std::ofstream file(argv[3], std::ios::binary);
    file << ppm << std::flush;
    if (!file) {
      std::fprintf(stderr, "draw_instant: %s cannot be written\n", argv[3]);
      return 1;
    }
  } catch (const l4d::Error& error) {
    std::fprintf(stderr, "draw_instant: %s\n", error.what());
    return 1;
  }
}
