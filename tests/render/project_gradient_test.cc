// SPDX-License-Identifier: Apache-2.0
// Derivatives of projection and colour against differences of their definitions in long double.
#include "render/frame/project_gradient.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "libl4dcodec/math/rotor.h"
#include "tests/math/reference.h"
#include "tests/render/differences.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

using differences::Errors;
using reference::Random;
using reference::Real;

constexpr int kCases = 400;
constexpr size_t kOutputs = 9;  // mean 2, conic 3, colour 3, factor of the opacity

void random_rotation(Random& random, double* rotation /* [3, 3] */) {
  double rotor[8], matrix[16];
  reference::random_rotor(random, 0, rotor);
  rotor_to_matrix(normalized_halves(rotor), matrix);
  for (int i = 0; i < 9; ++i) rotation[i] = matrix[4 * (i / 3) + i % 3];
}

l4d_camera random_camera(Random& random) {
  l4d_camera camera{};
  camera.struct_size = sizeof camera;
  camera.width = 160;
  camera.height = 90;
  camera.fx = random.uniform(60, 200);
  camera.fy = random.uniform(60, 200);
  camera.cx = random.uniform(60, 100);
  camera.cy = random.uniform(30, 60);
  camera.near_plane = 0.02;
  double rotation[9];
  random_rotation(random, rotation);
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) camera.world_to_camera[4 * r + c] = rotation[3 * r + c];
    camera.world_to_camera[4 * r + 3] = random.uniform(-3, 3);
  }
  return camera;
}

struct Kind {
  const char* name;
  double log_scale[2];
  double slope;  // |x/z| and |y/z| are up to this many times those of the frame's margin
  uint32_t degree;
  bool compensates = false;
};

struct Case {
  l4d_camera camera;
  Frame<double> frame;
  std::vector<float> sh;
};

// The projection from its definition, [kOutputs], in which the bounds of the slopes are the view's.
std::vector<Real> project_by_definition(const View<double>& view, uint32_t degree, const float* sh,
                                        const Real* position, const Real* s, bool clamp_colors) {
  Real camera[3], turned[3][3];
  const Real full[3][3] = {{s[0], s[1], s[2]}, {s[1], s[3], s[4]}, {s[2], s[4], s[5]}};
  const auto w = [&](int i, int j) { return Real(view.rotation[3 * i + j]); };
  for (int i = 0; i < 3; ++i) {
    camera[i] = Real(view.translation[i]);
    for (int j = 0; j < 3; ++j) {
      camera[i] += w(i, j) * position[j];
      turned[i][j] = 0;
      for (int a = 0; a < 3; ++a) {
        for (int b = 0; b < 3; ++b) turned[i][j] += w(i, a) * full[a][b] * w(j, b);
      }
    }
  }
  const Real z = camera[2], focal[2] = {Real(view.fx), Real(view.fy)};
  Real jacobian[2][3] = {};
  for (int k = 0; k < 2; ++k) {
    const Real slope = std::clamp(camera[k] / z, Real(view.min_slope[k]), Real(view.max_slope[k]));
    jacobian[k][k] = focal[k] / z;
    jacobian[k][2] = -focal[k] * slope / z;
  }
  Real c[2][2];
  for (int k = 0; k < 2; ++k) {
    for (int l = 0; l < 2; ++l) {
      c[k][l] = k == l ? Real(view.rules.dilation) : 0;
      for (int a = 0; a < 3; ++a) {
        for (int b = 0; b < 3; ++b) c[k][l] += jacobian[k][a] * turned[a][b] * jacobian[l][b];
      }
    }
  }
  const Real det = c[0][0] * c[1][1] - c[0][1] * c[1][0];
  const Real dilation = Real(view.rules.dilation);
  const Real bare = (c[0][0] - dilation) * (c[1][1] - dilation) - c[0][1] * c[1][0];
  std::vector<Real> out = {focal[0] * camera[0] / z + Real(view.cx),
                           focal[1] * camera[1] / z + Real(view.cy), c[1][1] / det, -c[0][1] / det,
                           c[0][0] / det};
  Real direction[3], norm = 0, color[3], basis[kMaxShTerms];
  for (int i = 0; i < 3; ++i) {
    direction[i] = position[i] - Real(view.center[i]);
    norm += direction[i] * direction[i];
  }
  for (Real& d : direction) d /= std::sqrt(norm);
  sh_basis(degree, direction[0], direction[1], direction[2], basis);
  for (size_t k = 0; k < 3; ++k) {
    color[k] = 0.5L;
    for (size_t t = 0; t < sh_terms(degree); ++t) color[k] += basis[t] * Real(sh[3 * t + k]);
    out.push_back(clamp_colors ? std::max(color[k], Real(0)) : color[k]);
  }
  out.push_back(view.rules.compensates ? std::sqrt(bare / det) : Real(1));
  return out;
}

// Position and direction are drawn in camera axes. Nothing lies at a bound of the slopes or at a
// zero colour, where there is no derivative.
Case random_case(Random& random, const Kind& kind, const View<double>& view) {
  Case c;
  c.frame.sh_degree = kind.degree;
  EXPECT_TRUE(c.frame.resize(1, unlimited()).ok());
  const double z = random.log_uniform(0.5, 20);
  double camera[3] = {0, 0, z};
  for (int k = 0; k < 2; ++k) {
    do {
      const double middle = (view.max_slope[k] + view.min_slope[k]) / 2;
      const double half = (view.max_slope[k] - view.min_slope[k]) / 2;
      camera[k] = z * (middle + half * kind.slope * random.uniform(-1, 1));
    } while (std::fabs(camera[k] / z - view.min_slope[k]) < 0.02 ||
             std::fabs(camera[k] / z - view.max_slope[k]) < 0.02);
  }
  for (int j = 0; j < 3; ++j) {
    double p = view.center[j];
    for (int i = 0; i < 3; ++i) p += view.rotation[3 * i + j] * camera[i];
    c.frame.position[j][0] = p;
  }
  double axes[9], s2[3];
  random_rotation(random, axes);
  for (double& v : s2) v = std::exp(2 * random.uniform(kind.log_scale[0], kind.log_scale[1]));
  size_t entry = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      double sum = 0;
      for (int k = 0; k < 3; ++k) sum += axes[3 * i + k] * s2[k] * axes[3 * j + k];
      c.frame.covariance[entry++][0] = sum;
    }
  }
  c.frame.opacity[0] = random.uniform(0.1, 0.999);
  c.sh.resize(3 * sh_terms(kind.degree));
  double direction[3], color[3];
  const double position[3] = {c.frame.position[0][0], c.frame.position[1][0],
                              c.frame.position[2][0]};
  view_direction(view, position, direction);
  do {
    for (float& v : c.sh) v = static_cast<float>(random.normal());
    sh_color(kind.degree, c.sh.data(), direction, color);
  } while (std::any_of(color, color + 3, [](double v) { return std::fabs(v) < 0.02; }));
  c.frame.sh[0] = c.sh.data();
  return c;
}

void check(const Kind& kind, bool clamp_colors, double bound) {
  Random random(41);
  Errors errors;
  int num_clamped = 0, num_black = 0;
  for (int n = 0; n < kCases; ++n) {
    const l4d_camera camera = random_camera(random);
    View<double> view = make_view<double>(camera);
    view.rules.compensates = kind.compensates;
    if (kind.compensates) view.rules.dilation = 0.1;
    Case c = random_case(random, kind, view);
    Real position[3], covariance[6];
    double narrow_position[3], narrow_covariance[6];
    for (size_t k = 0; k < 3; ++k) {
      narrow_position[k] = c.frame.position[k][0];
      position[k] = Real(narrow_position[k]);
    }
    for (size_t k = 0; k < 6; ++k) {
      narrow_covariance[k] = c.frame.covariance[k][0];
      covariance[k] = Real(narrow_covariance[k]);
    }
    Projection<double> projection;
    ASSERT_TRUE(project_geometry(view, narrow_position, narrow_covariance, &projection));
    num_clamped += projection.clamped[0] || projection.clamped[1];

    // Steps in which the thinnest extent of the splat hardly changes.
    const Real z = Real(projection.camera[2]);
    const Real xx = Real(projection.covariance[0]), yy = Real(projection.covariance[2]);
    const Real xy = Real(projection.covariance[1]);
    const Real largest = (xx + yy) / 2 + std::sqrt((xx - yy) * (xx - yy) / 4 + xy * xy);
    const Real smallest = (xx * yy - xy * xy) / largest;
    Real spread = 0;
    for (const double j : projection.jacobian) spread += Real(j) * Real(j);
    const Real position_step = 2e-3L * z * std::sqrt(smallest / largest);
    const Real covariance_step = 2e-3L * smallest / spread;

    const auto forward = [&](const Real* p, const Real* s) {
      return project_by_definition(view, kind.degree, c.sh.data(), p, s, clamp_colors);
    };
    std::vector<Real> by_position[3], by_covariance[6];
    for (size_t k = 0; k < 3; ++k) {
      const auto moved = [&](Real value) {
        Real p[3] = {position[0], position[1], position[2]};
        p[k] = value;
        return forward(p, covariance);
      };
      by_position[k] = differences::derivative(moved, position[k], position_step);
    }
    for (size_t k = 0; k < 6; ++k) {
      const auto changed = [&](Real value) {
        Real s[6];
        std::copy_n(covariance, 6, s);
        s[k] = value;
        return forward(position, s);
      };
      by_covariance[k] = differences::derivative(changed, covariance[k], covariance_step);
    }
    const std::vector<Real> value = forward(position, covariance);
    if (clamp_colors) num_black += std::count(value.begin() + 5, value.begin() + 8, Real(0)) > 0;
    Real direction[3], norm = 0, basis[kMaxShTerms];
    for (int k = 0; k < 3; ++k) {
      direction[k] = position[k] - Real(view.center[k]);
      norm += direction[k] * direction[k];
    }
    for (Real& d : direction) d /= std::sqrt(norm);
    sh_basis(kind.degree, direction[0], direction[1], direction[2], basis);

    // All outputs together, then mean, conic and colour by themselves.
    double weight[kOutputs];
    for (double& w : weight) w = random.normal();
    const double by_opacity = random.normal();
    for (const auto& [first, last] : {std::pair(0, 8), {0, 2}, {2, 5}, {5, 8}}) {
      double part[kOutputs] = {};
      std::copy(weight + first, weight + last, part + first);
      // The splat's opacity is the Gaussian's, times the factor.
      part[8] = by_opacity * c.frame.opacity[0];
      SplatGradient2D<double> upstream;
      std::copy_n(part, 2, upstream.mean);
      std::copy_n(part + 2, 3, upstream.conic);
      std::copy_n(part + 5, 3, upstream.color);
      upstream.opacity = by_opacity;
      SplatGradient3D<double> gradient;
      std::vector<double> sh_gradient(c.sh.size(), 7.0);  // to be overwritten
      project_gradient(view, c.frame, 0, projection, upstream, clamp_colors, &gradient,
                       sh_gradient.data());
      const auto combine = [&](const std::vector<Real>& derivative) {
        Real sum = 0;
        for (size_t j = 0; j < kOutputs; ++j) sum += Real(part[j]) * derivative[j];
        return static_cast<double>(sum);
      };
      Real size = 0;
      for (size_t j = 0; j < kOutputs; ++j) size += std::fabs(Real(part[j]) * value[j]);
      // The determinant of a long splat is a difference: it multiplies rounding of the conic.
      const Real rounding = 4 * std::numeric_limits<Real>::epsilon() * size * largest / smallest;
      std::vector<double> ours(gradient.position, gradient.position + 3), numeric;
      for (const auto& d : by_position) numeric.push_back(combine(d));
      errors.add("position", ours, numeric, static_cast<double>(rounding / position_step));
      ours.assign(gradient.covariance, gradient.covariance + 6);
      numeric.clear();
      for (const auto& d : by_covariance) numeric.push_back(combine(d));
      errors.add("covariance", ours, numeric, static_cast<double>(rounding / covariance_step));
      errors.add("opacity", {gradient.opacity}, {by_opacity * static_cast<double>(value[8])});
      numeric.clear();
      for (size_t t = 0; t < sh_terms(kind.degree); ++t) {
        for (size_t k = 0; k < 3; ++k) {
          // The image is linear in a colour, and a colour in its coefficients.
          const bool black = clamp_colors && value[5 + k] == 0;
          numeric.push_back(black ? 0 : part[5 + k] * static_cast<double>(basis[t]));
        }
      }
      errors.add("sh", sh_gradient, numeric);
    }
  }
  errors.report(std::string(kind.name) + (clamp_colors ? "" : ", colours without clamp"), bound);
  if (kind.slope > 1) {
    EXPECT_GT(num_clamped, kCases / 4);
  }
  if (clamp_colors) {
    EXPECT_GT(num_black, kCases / 20);
  }
}

constexpr Kind kDegree0 = {"degree 0", {-4, 0}, 0.9, 0};
constexpr Kind kDegree1 = {"degree 1", {-4, 0}, 0.9, 1};
constexpr Kind kDegree2 = {"degree 2", {-4, 0}, 0.9, 2};
constexpr Kind kDegree3 = {"degree 3", {-4, 0}, 0.9, 3};
constexpr Kind kClampedSlope = {"clamped slopes", {-4, 0}, 2.5, 3};
constexpr Kind kExtreme = {"scales e^-10 to e^3", {-10, 3}, 1.5, 3};

constexpr Kind kCompensated = {"compensated opacity", {-4, 0}, 0.9, 1, true};

TEST(ProjectGradient, CompensatedOpacity) { check(kCompensated, true, 1e-8); }
TEST(ProjectGradient, Degree0) { check(kDegree0, true, 1e-8); }
TEST(ProjectGradient, Degree1) { check(kDegree1, true, 1e-8); }
TEST(ProjectGradient, Degree2) { check(kDegree2, true, 1e-8); }
TEST(ProjectGradient, Degree3) { check(kDegree3, true, 1e-8); }
TEST(ProjectGradient, ColorsWithoutClamp) { check(kDegree3, false, 1e-8); }
TEST(ProjectGradient, ClampedSlopes) { check(kClampedSlope, true, 1e-8); }
TEST(ProjectGradient, LargeScaleRatios) { check(kExtreme, true, 1e-6); }

TEST(ProjectGradient, AgreesWithProject) {
  Random random(42);
  double worst = 0;
  int seen = 0;
  for (int n = 0; n < 2000; ++n) {
    const View<double> view = make_view<double>(random_camera(random));
    const Case c = random_case(random, kDegree3, view);
    Splat<double> splat;
    if (!project(view, c.frame, 0, &splat)) continue;
    shade(view, c.frame, 0, &splat);
    ++seen;
    Real position[3], covariance[6];
    for (size_t k = 0; k < 3; ++k) position[k] = Real(c.frame.position[k][0]);
    for (size_t k = 0; k < 6; ++k) covariance[k] = Real(c.frame.covariance[k][0]);
    const std::vector<Real> expected =
        project_by_definition(view, 3, c.sh.data(), position, covariance, true);
    const double ours[kOutputs] = {
        splat.mean[0],  splat.mean[1],  splat.conic[0],
        splat.conic[1], splat.conic[2], splat.color[0],
        splat.color[1], splat.color[2], splat.opacity / c.frame.opacity[0]};
    for (size_t k = 0; k < kOutputs; ++k) {
      worst = std::max(worst, std::fabs(ours[k] - static_cast<double>(expected[k])));
    }
  }
  std::cout << "project: largest difference to the definition " << worst << " of " << seen << "\n";
  EXPECT_GT(seen, 1000);
  EXPECT_LT(worst, 1e-9);
}

TEST(ProjectGradient, WithoutShGradient) {
  Random random(43);
  const View<double> view = make_view<double>(random_camera(random));
  for (const Kind& kind : {kDegree0, kDegree3}) {
    const Case c = random_case(random, kind, view);
    Splat<double> splat;
    Projection<double> projection;
    project(view, c.frame, 0, &splat, &projection);
    const SplatGradient2D<double> upstream{{1, 2}, {3, 4, 5}, 6, {7, 8, 9}};
    SplatGradient3D<double> with, without;
    std::vector<double> sh(c.sh.size());
    project_gradient(view, c.frame, 0, projection, upstream, true, &with, sh.data());
    project_gradient<double>(view, c.frame, 0, projection, upstream, true, &without, nullptr);
    for (int k = 0; k < 3; ++k) EXPECT_EQ(with.position[k], without.position[k]);
    for (int k = 0; k < 6; ++k) EXPECT_EQ(with.covariance[k], without.covariance[k]);
    EXPECT_EQ(with.opacity, without.opacity);
  }
}

// Of functions on the sphere the basis is an orthonormal one, whatever signs it chooses. The rule
// below is exact for polynomials up to degree 7 in z, and in the angle.
TEST(SphericalHarmonics, BasisIsOrthonormal) {
  static constexpr double kNode[4] = {-0.861136311594052575, -0.339981043584856265,
                                      0.339981043584856265, 0.861136311594052575};
  static constexpr double kWeight[4] = {0.347854845137453857, 0.652145154862546143,
                                        0.652145154862546143, 0.347854845137453857};
  constexpr int kAngles = 16;
  constexpr double kTurn = 6.283185307179586;
  double gram[kMaxShTerms][kMaxShTerms] = {};
  for (int i = 0; i < 4; ++i) {
    const double z = kNode[i], r = std::sqrt(1 - z * z);
    for (int a = 0; a < kAngles; ++a) {
      const double angle = kTurn * (a + 0.3) / kAngles;
      double basis[kMaxShTerms];
      sh_basis(3, r * std::cos(angle), r * std::sin(angle), z, basis);
      for (size_t k = 0; k < kMaxShTerms; ++k) {
        for (size_t l = 0; l < kMaxShTerms; ++l) {
          gram[k][l] += kWeight[i] * kTurn / kAngles * basis[k] * basis[l];
        }
      }
    }
  }
  for (size_t k = 0; k < kMaxShTerms; ++k) {
    for (size_t l = 0; l < kMaxShTerms; ++l) EXPECT_NEAR(gram[k][l], k == l ? 1 : 0, 1e-12);
  }
}

// Signs and order: real harmonics with the Condon-Shortley phase, m from -l to l.
TEST(SphericalHarmonics, BasisIsThatOfTheDefinition) {
  Random random(77);
  for (int i = 0; i < 200; ++i) {
    const double z = random.uniform(-1, 1), angle = random.uniform(0, 6.283185307179586);
    const double r = std::sqrt(1 - z * z);
    double basis[kMaxShTerms];
    sh_basis(3, r * std::cos(angle), r * std::sin(angle), z, basis);
    for (int l = 0; l <= 3; ++l) {
      for (int m = -l; m <= l; ++m) {
        const int a = std::abs(m);
        double factorials = 1;  // (l - a)! / (l + a)!
        for (int k = l - a + 1; k <= l + a; ++k) factorials /= k;
        const double phase = a % 2 == 0 ? 1 : -1;
        const double legendre =
            phase * std::assoc_legendre(static_cast<unsigned>(l), static_cast<unsigned>(a), z);
        const double around = m == 0  ? 1
                              : m > 0 ? std::sqrt(2.0) * std::cos(a * angle)
                                      : std::sqrt(2.0) * std::sin(a * angle);
        const double norm = std::sqrt((2 * l + 1) / (4 * 3.14159265358979323846) * factorials);
        EXPECT_NEAR(basis[static_cast<size_t>(l * l + l + m)], norm * legendre * around, 1e-12)
            << l << ", " << m;
      }
    }
  }
}

}  // namespace
}  // namespace l4d::render
