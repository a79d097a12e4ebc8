// SPDX-License-Identifier: Apache-2.0
#include "decoder/expand/transform.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "encoder/component/transform_coder.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/quant/integer_basis.h"
#include "tests/common/random.h"

namespace l4d::test {
namespace {

struct Data {
  size_t n, dim;
  std::vector<float> rows, weights;
};

// Vectors with few strong directions, as SH have, and weights over many octaves.
Data correlated(size_t n, size_t dim, uint64_t seed) {
  Random random(seed);
  const size_t rank = std::max<size_t>(1, dim / 4);
  std::vector<double> axes(rank * dim);
  for (double& a : axes) a = random.normal();
  Data d{n, dim, std::vector<float>(n * dim), {}};
  for (size_t i = 0; i < n; ++i) {
    for (size_t r = 0; r < rank; ++r) {
      const double c = random.normal() / static_cast<double>(1 + r);
      for (size_t k = 0; k < dim; ++k)
        d.rows[i * dim + k] += static_cast<float>(c * axes[r * dim + k]);
    }
    d.weights.push_back(std::exp2(random.uniformf(-20, 0)));
  }
  return d;
}

TransformSettings settings(double distortion, bool axes) {
  TransformSettings s;
  s.distortion = distortion;
  s.max_step = 0.5;
  s.principal_axes = axes;
  s.threads = 1;
  return s;
}

double squared_error(const Data& d, const std::vector<float>& decoded, size_t i) {
  double sum = 0;
  for (size_t k = 0; k < d.dim; ++k) {
    const double e =
        static_cast<double>(d.rows[i * d.dim + k]) - static_cast<double>(decoded[i * d.dim + k]);
    sum += e * e;
  }
  return sum;
}

class TransformTest : public testing::TestWithParam<std::pair<size_t, bool>> {};

// Each number is off by half a step at most, along orthogonal axes, but for the rounding of the
// basis.
TEST_P(TransformTest, ErrorsAreThoseOfTheSteps) {
  const auto [dim, axes] = GetParam();
  const Data d = correlated(3000, dim, 11 + dim);
  const CodedTransform c =
      code_transform(d.rows.data(), d.weights.data(), d.n, dim, settings(1e-6, axes));
  ASSERT_LE(c.steps.size(), dim);
  for (size_t i = 0; i < d.n; ++i) {
    const double step = std::ldexp(static_cast<double>(c.steps[0]), -c.step_exponent[i]);
    double length = 0;
    for (size_t k = 0; k < dim; ++k) {
      length += static_cast<double>(d.rows[i * dim + k]) * static_cast<double>(d.rows[i * dim + k]);
    }
    const double allowed =
        std::sqrt(static_cast<double>(dim)) * step / 2 + 4e-3 * std::sqrt(length);
    EXPECT_LE(std::sqrt(squared_error(d, c.decoded, i)), 1.01 * allowed + 1e-5) << i;
  }
}

// A weight four times as large halves the step, between the largest step and the finest step
// exponent.
TEST_P(TransformTest, StepExponentsFollowWeights) {
  const auto [dim, axes] = GetParam();
  const Data d = correlated(2000, dim, 5);
  const CodedTransform c =
      code_transform(d.rows.data(), d.weights.data(), d.n, dim, settings(1e-7, axes));
  for (size_t i = 0; i < d.n; ++i) {
    const double step = std::sqrt(12 * 1e-7 / static_cast<double>(d.weights[i]));
    const double octaves = std::log2(0.5 / step);
    EXPECT_NEAR(c.step_exponent[i], std::clamp(octaves, 0.0, 15.0), 0.51) << i;
  }
}

// What the encoder believes is what a decoder makes of the coefficients that a page would hold.
TEST_P(TransformTest, DecodedRowsAreTheDecoders) {
  const auto [dim, axes] = GetParam();
  const Data d = correlated(777, dim, 3);
  TransformSettings s = settings(1e-5, axes);
  s.integers = axes;
  const CodedTransform c = code_transform(d.rows.data(), d.weights.data(), d.n, dim, s);
  std::vector<std::vector<int16_t>> compact(c.steps.size());
  for (size_t k = 0; k < compact.size(); ++k) {
    for (size_t i = 0; i < d.n; ++i) {
      const size_t count = c.eob_index[i] == 0 ? 0 : c.eob_table[c.eob_index[i] - 1u];
      if (k < count) compact[k].push_back(c.coefficient[k][i]);
      EXPECT_TRUE(k < count || c.coefficient[k][i] == 0);
    }
  }
  std::vector<float> basis = c.basis;
  basis.resize(basis.size() + 16);
  TransformSource source;
  source.dim = dim;
  source.num_coefficients = c.steps.size();
  source.basis = basis.data();
  source.steps = c.steps.data();
  source.step_exponent = c.step_exponent.data();
  if (c.eob_table.size() > 1) source.eob_index = c.eob_index.data();
  source.eob_table = c.eob_table.data();
  for (size_t k = 0; k < compact.size(); ++k) {
    compact[k].resize(compact[k].size() + kCoefficientPadding);
    source.coefficient[k] = compact[k].data();
  }
  std::vector<float> out(d.n * dim);
  TransformCursor cursor;
  const IntegerBasis integers = integer_basis(basis.data(), dim, c.steps.data(), c.steps.size());
  if (s.integers) {
    source.integer_basis = integers.vectors.data();
    source.integer_scale = integers.scale;
    transform_kernels_simd().integer_rows(source, cursor, 0, d.n, out.data(), false);
  } else {
    transform_kernels_simd().rows(source, cursor, 0, d.n, out.data());
  }
  EXPECT_EQ(std::memcmp(out.data(), c.decoded.data(), out.size() * sizeof(float)), 0);
}

INSTANTIATE_TEST_SUITE_P(Dimensions, TransformTest,
                         testing::Values(std::pair<size_t, bool>{3, false},
                                         std::pair<size_t, bool>{4, false},
                                         std::pair<size_t, bool>{12, true},
                                         std::pair<size_t, bool>{27, true},
                                         std::pair<size_t, bool>{48, true}));

TEST(Transform, PrincipalAxesNeedFewerCoefficients) {
  const Data d = correlated(4000, 48, 21);
  const auto nonzero = [&](bool axes) {
    const CodedTransform c =
        code_transform(d.rows.data(), d.weights.data(), d.n, 48, settings(1e-6, axes));
    size_t count = 0;
    for (const auto& channel : c.coefficient) {
      for (const int16_t q : channel) count += q != 0;
    }
    return count;
  };
  EXPECT_LT(4 * nonzero(true), 3 * nonzero(false));
}

TEST(Transform, HardInputs) {
  // One row, equal rows, no weight at all, rows far out: finite, and as near as steps allow.
  for (const float far : {0.0f, 1.0f, 3e4f}) {
    for (const float weight : {0.0f, 1e-30f, 1.0f}) {
      for (const size_t n : {size_t{1}, size_t{5}}) {
        Data d{n, 4, std::vector<float>(4 * n, far), std::vector<float>(n, weight)};
        const CodedTransform c =
            code_transform(d.rows.data(), d.weights.data(), n, 4, settings(1e-8, true));
        for (size_t i = 0; i < n; ++i) {
          EXPECT_LE(std::sqrt(squared_error(d, c.decoded, i)),
                    0.5 + 2e-3 * static_cast<double>(far))
              << far << " " << weight << " " << n;
          EXPECT_LT(c.step_exponent[i], 16);
        }
      }
    }
  }
}

// Where the steps that a weight asks for do not reach, coarser ones do.
TEST(Transform, RowsFarOutTakeCoarserSteps) {
  Random random(21);
  for (const float far : {10.0f, 1e3f, 8e3f}) {  // the coarsest step reaches 8191
    Data d{300, 4, std::vector<float>(1200), std::vector<float>(300, 1.0f)};
    for (float& v : d.rows) v = static_cast<float>(0.01 * random.normal());
    for (const size_t i : {size_t{7}, size_t{8}}) {
      d.weights[i] = 1e6f;
      for (size_t k = 0; k < 4; ++k) d.rows[4 * i + k] = (i == 7 ? 1.0f : -1.0f) * far;
    }
    const CodedTransform c =
        code_transform(d.rows.data(), d.weights.data(), d.n, 4, settings(1e-8, true));
    for (size_t i = 0; i < d.n; ++i) {
      const double size = i == 7 || i == 8 ? static_cast<double>(far) : 0.0;
      EXPECT_LE(std::sqrt(squared_error(d, c.decoded, i)), 0.5 + 1e-3 * size) << far << ", " << i;
    }
  }
}

TEST(Transform, ThreadsDoNotMatter) {
  const Data d = correlated(9000, 12, 8);
  TransformSettings s = settings(1e-6, true);
  const CodedTransform a = code_transform(d.rows.data(), d.weights.data(), d.n, 12, s);
  s.threads = 3;
  const CodedTransform b = code_transform(d.rows.data(), d.weights.data(), d.n, 12, s);
  EXPECT_EQ(a.decoded, b.decoded);
  EXPECT_EQ(a.coefficient, b.coefficient);
  EXPECT_EQ(a.basis, b.basis);
}

}  // namespace
}  // namespace l4d::test
