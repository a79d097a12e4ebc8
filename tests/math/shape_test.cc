// SPDX-License-Identifier: Apache-2.0
// Axes of Gaussians: R diag(scale)^2 R^T is the covariance that the rows have.
#include "libl4dcodec/scene/shape.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "tests/common/random.h"

namespace l4d {
namespace {

using test::Random;

struct Rows {
  double at[12] = {};
};

// The columns of the rotation, in the textbook's formula for w x y z.
void matrix_of(const double* q, double (*m)[3]) {
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  const double r[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                          {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                          {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  std::memcpy(m, r, sizeof r);
}

void expect_shape(const Rows& rows, const char* what) {
  const Shape3 s = shape_of_rows(rows.at);
  double trace = 0;
  for (const double v : rows.at) trace += v * v;
  EXPECT_NEAR(dot4(s.rotation, s.rotation), 1, 1e-14) << what;
  for (int k = 1; k < 4; ++k) EXPECT_GE(s.rotation[0], std::abs(s.rotation[k]) - 1e-15) << what;
  EXPECT_GE(s.scale[0], s.scale[1]) << what;
  EXPECT_GE(s.scale[1], s.scale[2]) << what;
  EXPECT_GE(s.scale[2], 0) << what;
  double m[3][3];
  matrix_of(s.rotation, m);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      double sum = 0;
      for (int k = 0; k < 3; ++k) sum += m[i][k] * s.scale[k] * s.scale[k] * m[j][k];
      EXPECT_NEAR(sum, dot4(rows.at + 4 * i, rows.at + 4 * j), 1e-13 * trace)
          << what << ", entry " << i << j;
    }
  }
}

// rows = R diag(scale) Q: the axes are the columns of R, whatever the orthogonal Q does in 4D.
Rows made_of(const double* q, const double* scale, double angle) {
  double m[3][3];
  matrix_of(q, m);
  Rows rows;
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) rows.at[4 * i + k] = m[i][k] * scale[k];
  }
  for (int i = 0; i < 3; ++i)
    rotate_pair(&rows.at[4 * i + 1], &rows.at[4 * i + 3], 1, std::cos(angle), std::sin(angle));
  return rows;
}

void random_quaternion(Random& random, double* q) {
  for (int k = 0; k < 4; ++k) q[k] = random.uniform(-1, 1);
  const double norm = std::sqrt(dot4(q, q));
  for (int k = 0; k < 4; ++k) q[k] /= norm;
}

TEST(Shape, ReconstructsCovariancesOfAllKinds) {
  Random random(5);
  const std::vector<std::vector<double>> kinds = {{1, 1, 1},
                                                  {1, 1, 0},
                                                  {1, 0, 0},
                                                  {0, 0, 0},
                                                  {1, 1e-4, 1e-8},
                                                  {1e4, 1, 1e-5},
                                                  {3, 3, 1},
                                                  {3, 1, 1},
                                                  {1, 1 + 1e-9, 1 - 1e-9},
                                                  {1e-20, 1e-21, 1e-22},
                                                  {1e19, 1e12, 1}};
  for (const std::vector<double>& kind : kinds) {
    for (int n = 0; n < 200; ++n) {
      double q[4];
      random_quaternion(random, q);
      double scale[3] = {kind[0], kind[1], kind[2]};
      std::swap(scale[n % 3], scale[(n / 3) % 3]);
      expect_shape(made_of(q, scale, random.uniform(0, 6)), "made");
      ASSERT_FALSE(HasFailure()) << kind[0] << " " << kind[1] << " " << kind[2];
    }
  }
  for (int n = 0; n < 2000; ++n) {
    Rows rows;
    for (double& v : rows.at) v = random.uniform(-1, 1) * std::exp(random.uniform(-12, 12));
    expect_shape(rows, "random");
    ASSERT_FALSE(HasFailure());
  }
}

// Thin axes keep their digits: a covariance in binary32 could not hold the ratio of these.
TEST(Shape, FindsThinAxesNextToLongOnes) {
  Random random(6);
  for (int n = 0; n < 500; ++n) {
    // The axes of space: a turn would round the thin ones away before the test begins.
    const double scale[3] = {1e5, 1, 1e-7};
    const double q[4] = {1, 0, 0, 0};
    const Shape3 s = shape_of_rows(made_of(q, scale, random.uniform(0, 6)).at);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(s.scale[k], scale[k], 1e-14 * scale[k]);
  }
}

TEST(Shape, NamesEachRotationInOneWay) {
  const double kHalf = 0.5, kRoot = std::sqrt(0.5);
  // Turns of the cube rename axes or flip them in pairs.
  const double turns[][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
  for (const double* q : turns) {
    const double scale[3] = {3, 2, 1};
    const Shape3 s = shape_of_rows(made_of(q, scale, 0.3).at);
    EXPECT_NEAR(s.rotation[0], 1, 1e-15);
    EXPECT_EQ(s.scale[0], 3);
  }
  // The axes in another order: the quarter or third of a turn between them.
  const double scale[3] = {1, 2, 3}, one[4] = {1, 0, 0, 0};
  const Shape3 s = shape_of_rows(made_of(one, scale, 0).at);
  EXPECT_NEAR(s.rotation[0], kRoot, 1e-15);
  EXPECT_NEAR(std::abs(s.rotation[2]), kRoot, 1e-15);
  const double other[3] = {1, 3, 2};
  const Shape3 third = shape_of_rows(made_of(one, other, 0).at);
  for (const double v : third.rotation) EXPECT_NEAR(std::abs(v), kHalf, 1e-15);
  // Where nothing tells axes apart, they are those of space.
  const double equal[3] = {2, 2, 2};
  const Shape3 ball = shape_of_rows(made_of(one, equal, 0).at);
  EXPECT_EQ(ball.rotation[0], 1);
  EXPECT_EQ(ball.scale[2], 2);
  const Shape3 nothing = shape_of_rows(Rows().at);
  EXPECT_EQ(nothing.rotation[0], 1);
  EXPECT_EQ(nothing.scale[0], 0);
}

}  // namespace
}  // namespace l4d
