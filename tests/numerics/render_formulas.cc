// SPDX-License-Identifier: Apache-2.0
// The renderer: exponentials, seen through images, and the determinant of thin splats.
#include <algorithm>
#include <cmath>

#include "render/frame/project.h"
#include "tests/math/reference.h"
#include "tests/numerics/formula.h"
#include "tests/render/scenes.h"

namespace l4d::numerics {
namespace {

using reference::Real;
using namespace render;

constexpr uint32_t kSize = 192;

// alpha of one Gaussian, fast path against reference, where neither the limit nor the cut decides.
Observed exponential(uint32_t kind) {
  Observed o;
  const RendererHandle reference_path = make_renderer(L4D_BACKEND_REFERENCE);
  const RendererHandle fast = make_renderer(L4D_BACKEND_CPU, 2, kind);
  const l4d_camera camera = axis_camera(kSize, kSize, 500);
  test::Random random(161);
  for (int i = 0; i < 24; ++i) {
    SceneBuilder b;
    const double rgb[3] = {1, 1, 1};
    b.add_ball(random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1), 5, random.uniform(0.1, 0.6),
               random.uniform(0.02, 0.98), rgb);
    const l4d_gaussians g = b.scene().view();
    TestImage image[2];
    for (int k = 0; k < 2; ++k) {
      RendererHandle& r = const_cast<RendererHandle&>(k == 0 ? reference_path : fast);
      r.set_gaussians(g, b.scene().timeline);
      r.set_time(1);
      image[k] = render_both(r, camera);
    }
    for (size_t p = 0; p < image[0].alpha.size(); ++p) {
      const double want = static_cast<double>(image[0].alpha[p]);
      if (want < 1.001 / 255) continue;
      o.add(std::fabs(static_cast<double>(image[1].alpha[p]) - want) / want);
    }
  }
  return o;
}
Observed exp_accurate() { return exponential(L4D_RENDER_EXP_ACCURATE); }
Observed exp_fast() { return exponential(L4D_RENDER_EXP_FAST); }

// Needles of up to `length` pixels in any direction, and the determinant of their covariance in the
// image. `terms` bounds what is added up on the way.
template <typename Body>
void for_needles(double length, const Body& body) {
  const l4d_camera camera = axis_camera(1920, 1080, 1000);
  const View<float> view = make_view<float>(camera);
  const View<Real> wide_view = make_view<Real>(camera);
  reference::Random random(162);
  for (int i = 0; i < 50000; ++i) {
    double axis[3], norm = 0;
    for (double& a : axis) {
      a = random.normal();
      norm += a * a;
    }
    // A line segment with hardly any width: only the dilation remains.
    const double sigma = length / 1000 * 5 * random.log_uniform(1e-2, 1.0);
    const double width = sigma * 1e-6;
    float covariance[6];
    Real wide_covariance[6];
    int n = 0;
    for (int r = 0; r < 3; ++r) {
      for (int c = r; c < 3; ++c) {
        const double v = sigma * sigma * axis[r] * axis[c] / norm + (r == c ? width * width : 0);
        covariance[n] = static_cast<float>(v);
        wide_covariance[n] = Real(covariance[n]);
        ++n;
      }
    }
    const float position[3] = {static_cast<float>(random.uniform(-2.0, 2.0)),
                               static_cast<float>(random.uniform(-2.0, 2.0)), 5.0f};
    const Real wide_position[3] = {position[0], position[1], position[2]};
    Projection<float> p;
    Projection<Real> w;
    if (!project_geometry(view, position, covariance, &p)) continue;
    if (!project_geometry(wide_view, wide_position, wide_covariance, &w)) continue;
    const float det = p.covariance[0] * p.covariance[2] - p.covariance[1] * p.covariance[1];
    const Real exact = w.covariance[0] * w.covariance[2] - w.covariance[1] * w.covariance[1];
    Real rows = 0;
    for (const Real j : w.jacobian) rows += j * j;
    const Real terms = rows * (wide_covariance[0] + wide_covariance[3] + wide_covariance[5]);
    body(det, exact, terms * (w.covariance[0] + w.covariance[2]));
  }
}

Observed determinant() {
  Observed o;
  for_needles(1000, [&](float det, Real exact, Real terms) {
    o.add(static_cast<double>(std::fabs(Real(det) - exact) / (Real(kU32) * terms)));
  });
  return o;
}

Observed determinant_loss() {
  Observed o;
  for_needles(100, [&](float det, Real exact, Real) {
    o.add(static_cast<double>(std::fabs(Real(det) - exact) / exact));
  });
  return o;
}

std::vector<Formula> list() {
  return {
      {"render_exp_accurate", "fast path, accurate exponential", "reference path, binary64",
       "one Gaussian of 10 to 60 pixels, every pixel that it reaches", "relative error of alpha",
       "2e-7 of the exponential; exponent up to 8 and pixel coordinates up to 192, rounded", "",
       1e-5, exp_accurate},
      {"render_exp_fast", "fast path, fast exponential", "reference path, binary64",
       "one Gaussian of 10 to 60 pixels, every pixel that it reaches", "relative error of alpha",
       "polynomial of degree 3, 7.5e-5; render.h promises 1e-4", "", 1e-4, exp_fast},
      {"render_determinant", "xx yy - xy^2 in binary32", "long double",
       "needles of up to 1000 pixels without width, any direction",
       "error : u (xx + yy) |J|^2 tr Sigma",
       "13 roundings of each entry, of terms that a needle seen end on makes cancel", "", 6,
       determinant},
      {"render_determinant_loss", "xx yy - xy^2 in binary32", "long double",
       "needles of up to 100 pixels without width, any direction", "relative error",
       "the above: det is at least 0.3 (xx + yy) - 0.09, and terms are below 1e4", "", 0.01,
       determinant_loss},
  };
}
const Register kRegister(list);

}  // namespace
}  // namespace l4d::numerics
