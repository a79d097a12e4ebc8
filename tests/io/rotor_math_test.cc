// SPDX-License-Identifier: Apache-2.0
#include "io/scene/rotor_math.h"

#include <algorithm>
#include <cmath>

#include "tests/io/support.h"

namespace l4d::io {
namespace {

using reference::Random;
using reference::Real;

Rotor random_unit_rotor(Random& random) {
  Rotor r;
  for (double& c : r) c = random.normal();
  return matrix_to_rotor(rotor_to_matrix(r));
}

TEST(RotorMath, MatrixIsOrthogonalAndMatchesThePolynomials) {
  Random random(1);
  for (int n = 0; n < 2000; ++n) {
    Rotor r;
    for (double& c : r) c = random.normal();
    const Matrix4 m = rotor_to_matrix(r);
    for (size_t i = 0; i < 4; ++i) {
      for (size_t j = 0; j < 4; ++j) {
        double product = 0;
        for (size_t k = 0; k < 4; ++k) product += m[4 * i + k] * m[4 * j + k];
        ASSERT_NEAR(product, i == j ? 1 : 0, 2e-15);
      }
    }
    Real expected[4][4];
    reference::matrix(reference::normalize(reference::load(r.data())), expected);
    for (size_t i = 0; i < 16; ++i) {
      ASSERT_NEAR(m[i], static_cast<double>(expected[i / 4][i % 4]), 1e-14);
    }
  }
}

TEST(RotorMath, MatrixToRotorInverts) {
  Random random(2);
  for (int n = 0; n < 2000; ++n) {
    const Rotor r = random_unit_rotor(random);
    EXPECT_GE(r[0], 0);
    const Rotor back = matrix_to_rotor(rotor_to_matrix(r));
    for (size_t k = 0; k < 8; ++k) ASSERT_NEAR(back[k], r[k], 1e-14);
  }
}

TEST(RotorMath, ZeroRotorIsTheIdentity) {
  const Matrix4 m = rotor_to_matrix({0, 0, 0, 0, 0, 0, 0, 0});
  for (size_t i = 0; i < 16; ++i) EXPECT_EQ(m[i], i % 5 == 0 ? 1 : 0);
}

TEST(RotorMath, QuaternionsAgreeWithTheirRotor) {
  Random random(3);
  for (int n = 0; n < 500; ++n) {
    Vec4 q;
    double norm2 = 0;
    for (double& c : q) {
      c = random.normal();
      norm2 += c * c;
    }
    const float unit_scales[3] = {0, -1, -2};
    const float wxyz[4] = {static_cast<float>(q[0]), static_cast<float>(q[1]),
                           static_cast<float>(q[2]), static_cast<float>(q[3])};
    Real expected[6];
    test::reference_covariance3(wxyz, unit_scales, expected);
    const Matrix3 m = quaternion_to_matrix(q);
    const double s2[3] = {1, std::exp(-2.0), std::exp(-4.0)};
    double covariance[6];
    size_t out = 0;
    for (size_t i = 0; i < 3; ++i) {
      for (size_t j = i; j < 3; ++j) {
        covariance[out] = 0;
        for (size_t k = 0; k < 3; ++k) covariance[out] += m[3 * i + k] * s2[k] * m[3 * j + k];
        ++out;
      }
    }
    ASSERT_LT(reference::relative_error6(covariance, expected), 1e-6);  // wxyz is float32
    const Vec4 back = matrix_to_quaternion(m);
    const double sign = q[0] < 0 ? -1 : 1;
    for (size_t k = 0; k < 4; ++k) ASSERT_NEAR(back[k], sign * q[k] / std::sqrt(norm2), 1e-14);
  }
}

TEST(RotorMath, SliceMatchesTheDefinition) {
  Random random(4);
  for (int n = 0; n < 2000; ++n) {
    Rotor r;
    reference::random_rotor(random, random.log_uniform(1e-4, 0.5), r.data());
    Vec4 scale;
    for (size_t k = 0; k < 3; ++k) scale[k] = random.log_uniform(1e-5, 1);
    scale[3] = random.log_uniform(0.01, 1000);
    const Slice s = slice(r, scale);
    const double largest = *std::max_element(scale.begin(), scale.end());

    Real m[4][4], rows[16], velocity[3], lambda, unused[6], covariance[6];
    reference::matrix(reference::normalize(reference::load(r.data())), m);
    for (size_t i = 0; i < 16; ++i) rows[i] = m[i / 4][i % 4] * Real(scale[i % 4]);
    reference::schur(rows, velocity, &lambda, unused);
    reference::minors(rows, covariance);
    double mine[6];
    size_t out = 0;
    for (size_t i = 0; i < 3; ++i) {
      // Every entry of the rotation has an error of about 1e-16, times the largest scale.
      ASSERT_NEAR(s.velocity[i], static_cast<double>(velocity[i]),
                  4e-15 * (1 + std::abs(s.velocity[i])) * largest / s.sigma_t);
      for (size_t j = i; j < 3; ++j) {
        mine[out] = 0;
        for (size_t k = 0; k < 4; ++k) mine[out] += s.rows[i][k] * s.rows[j][k];
        ++out;
      }
    }
    ASSERT_LT(reference::relative_error6(mine, covariance), 1e-9);
    ASSERT_NEAR(s.sigma_t * std::sqrt(static_cast<double>(lambda)), 1, 4e-15 * largest / s.sigma_t);
  }
}

// The import of moving 3D Gaussians is exact, up to the conditioning of the result.
TEST(RotorMath, ShapeOfMovingKeepsVelocityDurationAndCovariance) {
  Random random(5);
  for (int n = 0; n < 3000; ++n) {
    Vec4 q;
    for (double& c : q) c = random.normal();
    const Matrix3 rotation = quaternion_to_matrix(q);
    Vec3 scale, velocity;
    for (size_t k = 0; k < 3; ++k) {
      scale[k] = random.log_uniform(1e-5, 1);
      velocity[k] = random.normal() * random.log_uniform(1e-5, 3);
    }
    const double sigma_t = random.log_uniform(1e-3, 200);
    const Shape4 shape = shape_of_moving(rotation, scale, velocity, sigma_t);

    const Slice s = slice(shape.rotor, shape.scale);
    const double speed = std::sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] +
                                   velocity[2] * velocity[2]);
    ASSERT_NEAR(s.sigma_t / sigma_t, 1, 1e-12 * (1 + 1 / sigma_t));
    Real expected[6];
    double mine[6];
    size_t out = 0;
    for (size_t i = 0; i < 3; ++i) {
      ASSERT_NEAR(s.velocity[i], velocity[i], 1e-12 * (1 + speed) * (1 + 1 / sigma_t));
      for (size_t j = i; j < 3; ++j) {
        mine[out] = 0;
        expected[out] = 0;
        for (size_t k = 0; k < 4; ++k) mine[out] += s.rows[i][k] * s.rows[j][k];
        for (size_t k = 0; k < 3; ++k) {
          expected[out] += Real(rotation[3 * i + k]) * scale[k] * scale[k] * rotation[3 * j + k];
        }
        ++out;
      }
    }
    // Entries of the slice come from differences of numbers near velocity * sigma_t.
    const double largest = *std::max_element(scale.begin(), scale.end());
    ASSERT_LT(reference::relative_error6(mine, expected),
              1e-13 * (1 + (1 + speed) * sigma_t / largest));

    // The order of axes: time last and forward, a proper rotation.
    const Matrix4 m = rotor_to_matrix(shape.rotor);
    for (size_t k = 0; k < 3; ++k) ASSERT_LE(std::abs(m[12 + k]), std::abs(m[15]));
    ASSERT_GT(m[15], 0);
  }
}

TEST(RotorMath, ShapeOfSlowlyMovingStaysNearItsRotation) {
  Random random(6);
  for (int n = 0; n < 500; ++n) {
    Vec4 q;
    for (double& c : q) c = random.normal();
    const Matrix3 rotation = quaternion_to_matrix(q);
    const Vec3 scale{0.01, 0.02, 0.04};
    const Shape4 shape = shape_of_moving(rotation, scale, {1e-4, -2e-4, 1e-4}, 10);
    const Matrix4 m = rotor_to_matrix(shape.rotor);
    for (size_t i = 0; i < 3; ++i) {
      for (size_t k = 0; k < 3; ++k) ASSERT_NEAR(m[4 * i + k], rotation[3 * i + k], 1e-6);
    }
    for (size_t k = 0; k < 3; ++k) ASSERT_NEAR(shape.scale[k], scale[k], 1e-8);
    double temporal = 0;
    for (size_t k = 4; k < 8; ++k) temporal = std::max(temporal, std::abs(shape.rotor[k]));
    EXPECT_LT(temporal, 2e-4);
  }
}

}  // namespace
}  // namespace l4d::io
