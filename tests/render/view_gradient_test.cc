// SPDX-License-Identifier: Apache-2.0
// Derivatives by cameras and clocks against differences: what a camera sees of a moving Gaussian,
// with the camera itself turned and moved.
#include "render/frame/view_gradient.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/rendering.h"
#include "render/frame/project_gradient.h"
#include "render/frame/slice_gradient.h"
#include "tests/math/reference.h"
#include "tests/render/differences.h"

namespace l4d::render {
namespace {

using reference::Random;

constexpr uint32_t kDegree = 3;

struct Case {
  l4d_camera camera{};
  l4d_rendering rendering = default_rendering();
  Gaussian4D<double> gaussian;
  std::vector<float> sh;
  std::vector<double> weights;  // of what is seen
};

// exp([w]) by its series.
void turn(const double* w, double* x /* [3] */) {
  double term[3] = {x[0], x[1], x[2]};
  for (int n = 1; n < 20; ++n) {
    const double next[3] = {w[1] * term[2] - w[2] * term[1], w[2] * term[0] - w[0] * term[2],
                            w[0] * term[1] - w[1] * term[0]};
    for (int k = 0; k < 3; ++k) x[k] += term[k] = next[k] / n;
  }
}

// The camera of a case with one of its numbers changed, as l4d_gradients::view counts them.
l4d_camera changed(l4d_camera camera, int number, double by) {
  double* m = camera.world_to_camera;
  double w[3] = {0, 0, 0};
  if (number >= 1 && number < 4) w[number - 1] = by;
  for (int c = 0; c < 4; ++c) {
    double x[3] = {m[c], m[4 + c], m[8 + c]};
    turn(w, x);
    for (int r = 0; r < 3; ++r) m[4 * r + c] = x[r];
  }
  if (number >= 4 && number < 7) m[4 * (number - 4) + 3] += by;
  if (number == 7) camera.fx *= std::exp(by);
  if (number == 8) camera.fy *= std::exp(by);
  return camera;
}

Instant<double> instant_at(double time) { return {time, -100, 100, false, false}; }

// Weighted: where it is in the image, its conic, how opaque it is, and its colour.
double seen(const Case& of, const l4d_camera& camera, double time) {
  const View<double> view = make_view<double>(camera, of.rendering);
  const Slice3D<double> slice = slice_at(of.gaussian, instant_at(time));
  Projection<double> projection;
  EXPECT_TRUE(project_geometry(view, slice.position, slice.covariance, &projection));
  EXPECT_FALSE(projection.clamped[0] || projection.clamped[1]);
  const double* c = projection.covariance;
  const double det = c[0] * c[2] - c[1] * c[1];
  double direction[3], color[3];
  view_direction(view, slice.position, direction);
  sh_color(kDegree, of.sh.data(), direction, color);
  const double values[] = {view.fx * projection.slope[0] + view.cx,
                           view.fy * projection.slope[1] + view.cy,
                           c[2] / det,
                           -c[1] / det,
                           c[0] / det,
                           slice.opacity * compensation(view, projection),
                           color[0],
                           color[1],
                           color[2]};
  double sum = 0;
  for (size_t k = 0; k < 9; ++k) sum += of.weights[k] * values[k];
  return sum;
}

std::vector<double> analytic(const Case& of) {
  const View<double> view = make_view<double>(of.camera, of.rendering);
  const Slice3D<double> slice = slice_at(of.gaussian, instant_at(0));
  Projection<double> projection;
  EXPECT_TRUE(project_geometry(view, slice.position, slice.covariance, &projection));
  SplatGradient2D<double> by_splat;
  std::copy_n(&of.weights[0], 2, by_splat.mean);
  std::copy_n(&of.weights[2], 3, by_splat.conic);
  by_splat.opacity = of.weights[5];
  SplatGradient3D<double> by_slice;
  geometry_gradient(view, slice.covariance, projection, by_splat, slice.opacity, &by_slice);
  double* const no_sh = nullptr;
  shade_gradient(view, kDegree, slice.position, of.sh.data(), &of.weights[6], false,
                 by_slice.direction, no_sh);
  for (int k = 0; k < 3; ++k) by_slice.position[k] += by_slice.direction[k];
  const double by_time = slice_gradient(of.gaussian, instant_at(0), by_slice).time;
  std::vector<double> out(kViewNumbers);
  add_view_gradient(view, slice.position, slice.covariance, by_slice, by_time, out.data());
  return out;
}

Case random_case(Random& random) {
  Case of;
  of.rendering.compensation = 1;
  l4d_camera& camera = of.camera;
  camera.struct_size = sizeof camera;
  camera.width = 160;
  camera.height = 90;
  camera.fx = random.uniform(60, 200);
  camera.fy = random.uniform(60, 200);
  camera.cx = 80;
  camera.cy = 45;
  camera.near_plane = 0.02;
  double rotor[8], matrix[16];
  reference::random_rotor(random, 0, rotor);
  rotor_to_matrix(normalized_halves(rotor), matrix);
  const double z = random.uniform(2, 6);
  const double there[3] = {z * random.uniform(-0.2, 0.2), z * random.uniform(-0.1, 0.1), z};
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) camera.world_to_camera[4 * r + c] = matrix[4 * r + c];
    camera.world_to_camera[4 * r + 3] = random.uniform(-3, 3);
  }
  const View<double> view = make_view<double>(camera, of.rendering);
  Gaussian4D<double>& g = of.gaussian;
  for (size_t k = 0; k < 3; ++k) {
    g.position[k] = view.center[k];
    for (size_t r = 0; r < 3; ++r) g.position[k] += view.rotation[3 * r + k] * there[r];
    g.log_scale[k] = random.uniform(-2.5, -1.5);
  }
  g.mean_t = random.uniform(-0.3, 0.3);
  g.log_scale[3] = random.uniform(-1, 0.5);
  reference::random_rotor(random, 0, g.rotor);
  g.opacity = random.uniform(0.2, 0.9);
  for (size_t k = 0; k < 3 * sh_terms(kDegree); ++k) {
    of.sh.push_back(static_cast<float>(random.uniform(-0.3, 0.3)));
  }
  for (size_t k = 0; k < 9; ++k) of.weights.push_back(random.uniform(-1, 1) * (k < 2 ? 0.01 : 1));
  return of;
}

TEST(ViewGradient, IsThatOfTheCameraAndItsClock) {
  Random random(17);
  double worst[kViewNumbers] = {}, size[kViewNumbers] = {};
  for (int n = 0; n < 200; ++n) {
    const Case of = random_case(random);
    // What moved out of the frame's margin meanwhile is another case.
    const View<double> view = make_view<double>(of.camera, of.rendering);
    const Slice3D<double> slice = slice_at(of.gaussian, instant_at(0));
    Projection<double> projection;
    if (!project_geometry(view, slice.position, slice.covariance, &projection)) continue;
    if (projection.clamped[0] || projection.clamped[1]) continue;
    const std::vector<double> found = analytic(of);
    for (int k = 0; k < kViewNumbers; ++k) {
      const auto at = [&](double by) {
        return std::vector<double>{seen(of, changed(of.camera, k, by), k == 0 ? by : 0)};
      };
      const double numeric = differences::derivative<double>(at, 0.0, 1e-3)[0];
      worst[k] = std::max(worst[k], std::abs(found[static_cast<size_t>(k)] - numeric));
      size[k] = std::max(size[k], std::abs(numeric));
    }
  }
  for (int k = 0; k < kViewNumbers; ++k) {
    EXPECT_GT(size[k], 0.1) << k;
    EXPECT_LT(worst[k], 1e-8 * size[k]) << k;
  }
}

}  // namespace
}  // namespace l4d::render
