// SPDX-License-Identifier: Apache-2.0
#include "encoder/component/transform_coder.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "decoder/expand/transform.h"
#include "encoder/prepare/scalar.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/quant/integer_basis.h"

namespace l4d {
namespace {

constexpr size_t kRowGrain = 2048;
// Rows that the axes are found from, evenly spaced: several hundred per entry of their covariance.
constexpr size_t kMaxAxisRows = 65536;
// No row counts more than this many average ones, so that a few large Gaussians do not turn the
// axes.
constexpr double kMaxAxisWeight = 20;
// What a number of the base varies less than this share of the average is not asked about others.
constexpr double kMinBaseVariance = 1e-6;
// Numbers of coefficients beyond the base that a Gaussian may have: fine where most end, coarse
// beyond. Decoders take coefficients of a step two at a time, so that steps are even.
constexpr uint8_t kEobTable[] = {2, 4, 6, 10, 14, 18, 24, 32};

constexpr double kMaxCoefficient = 32767;
// Room for what rounding of the base moves others by.
constexpr double kMostUsedCoefficient = 32700;
constexpr int kMostBaseOctaves = 4;
// Of base colours, in steps: the largest of three channels, in most rows at most.
constexpr double kErrorPerBaseStep = 0.6;
// Numbers that take a bit more for each octave that a row is finer.
constexpr double kNumbersOfRow = 10;
constexpr size_t kMaxNumbers = 48;  // of a row with principal axes

double half_value(double v) {
  return static_cast<double>(half_to_float(float_to_half_saturate(static_cast<float>(v))));
}

// basis: with the padding that loops of a decoder rely on.
TransformSource source_of(const CodedTransform& coded, const std::vector<float>& basis) {
  TransformSource source;
  source.dim = coded.dim;
  source.num_coefficients = coded.steps.size();
  source.basis = basis.data();
  source.steps = coded.steps.data();
  source.step_exponent = coded.step_exponent.data();
  source.eob_index = coded.eob_index.data();
  source.eob_table = coded.eob_table.data();
  for (size_t k = 0; k < coded.coefficient.size(); ++k) {
    source.coefficient[k] = coded.coefficient[k].data();
  }
  return source;
}

// v x 2^exponent, |exponent| <= 1000, as std::ldexp returns it in several times the time.
double times_power(double v, int exponent) {
  const uint64_t bits = static_cast<uint64_t>(1023 + exponent) << 52;
  double power;
  std::memcpy(&power, &bits, sizeof power);
  return v * power;
}

class TransformCoder {
 public:
  TransformCoder(const float* rows, const float* weights, size_t n, size_t dim,
                 const TransformSettings& settings)
      : rows_(rows),
        weights_(weights),
        n_(n),
        dim_(dim),
        base_(settings.principal_axes ? std::min(settings.base, dim) : 0),
        settings_(settings) {
    out_.n = n;
    out_.dim = dim;
  }

  CodedTransform run() {
    find_axes();
    choose_step_exponents();
    quantize();
    choose_eob_indices();
    decode();
    return std::move(out_);
  }

 private:
  double row(size_t i, size_t d) const { return static_cast<double>(rows_[i * dim_ + d]); }

  void find_axes() {
    const size_t step = std::max<size_t>(1, (n_ + kMaxAxisRows - 1) / kMaxAxisRows);
    double mean_weight = 0;
    size_t count = 0;
    for (size_t i = 0; i < n_; i += step, ++count) mean_weight += static_cast<double>(weights_[i]);
    mean_weight /= static_cast<double>(std::max<size_t>(count, 1));
    const auto weight = [&](size_t i) {
      // Rows without weight still say where the others may lie.
      return mean_weight > 0
                 ? std::min(static_cast<double>(weights_[i]) / mean_weight, kMaxAxisWeight) + 1e-3
                 : 1.0;
    };
    std::vector<double> mean(dim_, 0.0);
    double sum = 0;
    for (size_t i = 0; i < n_; i += step) {
      const double w = weight(i);
      sum += w;
      for (size_t d = 0; d < dim_; ++d) mean[d] += w * row(i, d);
    }
    out_.basis.assign((dim_ + 1) * dim_, 0.0f);
    for (size_t d = 0; d < dim_; ++d) {
      mean[d] = settings_.zero_origin ? 0 : half_value(mean[d] / sum);
      out_.basis[d] = static_cast<float>(mean[d]);
    }
    if (!settings_.principal_axes) {
      for (size_t d = 0; d < dim_; ++d) out_.basis[(d + 1) * dim_ + d] = 1.0f;
      return;
    }
    const Eigen::Index size = static_cast<Eigen::Index>(dim_);
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
    std::vector<double> centred(dim_);
    for (size_t i = 0; i < n_; i += step) {
      const double w = weight(i);
      for (size_t d = 0; d < dim_; ++d) centred[d] = row(i, d) - mean[d];
      for (size_t a = 0; a < dim_; ++a) {  // the lower triangle is all the solver reads
        double* column = covariance.data() + a * dim_;
        const double scaled = w * centred[a];
        for (size_t b = a; b < dim_; ++b) column[b] += scaled * centred[b];
      }
    }
    if (base_ > 0) predict_from_base(covariance);
    add_axes(covariance, base_, dim_);
  }

  // Axes of the numbers [begin, end) from their covariance, which is part of a larger one, by
  // falling variance: basis vectors from `begin` on.
  void add_axes(const Eigen::MatrixXd& covariance, size_t begin, size_t end) {
    const auto first = static_cast<Eigen::Index>(begin),
               size = static_cast<Eigen::Index>(end - begin);
    if (size == 0) return;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
        Eigen::MatrixXd(covariance.block(first, first, size, size)));
    for (size_t k = begin; k < end; ++k) {
      // The solver's order is rising. The sign is of no matter but must be settled.
      const auto axis = solver.eigenvectors().col(size - 1 - static_cast<Eigen::Index>(k - begin));
      Eigen::Index largest = 0;
      axis.cwiseAbs().maxCoeff(&largest);
      const double sign = axis[largest] < 0 ? -1.0 : 1.0;
      for (size_t d = begin; d < end; ++d) {
        out_.basis[(k + 1) * dim_ + d] =
            static_cast<float>(half_value(sign * axis[static_cast<Eigen::Index>(d - begin)]));
      }
    }
  }

  // Basis vectors of the base, with their regression of the other numbers, whose covariance is left
  // as that of what it does not explain.
  void predict_from_base(Eigen::MatrixXd& covariance) {
    const auto b = static_cast<Eigen::Index>(base_);
    const Eigen::Index rest = covariance.rows() - b;
    add_axes(covariance, 0, base_);
    const double least = kMinBaseVariance * covariance.trace() / static_cast<double>(dim_);
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
        Eigen::MatrixXd(covariance.topLeftCorner(b, b)));
    const Eigen::VectorXd variance = solver.eigenvalues().cwiseMax(std::max(least, 1e-300));
    const Eigen::MatrixXd cross = covariance.bottomLeftCorner(rest, b);
    const Eigen::MatrixXd slopes = cross * solver.eigenvectors() *
                                   variance.cwiseInverse().asDiagonal() *
                                   solver.eigenvectors().transpose();
    for (size_t k = 0; k < base_; ++k) {
      float* vector = out_.basis.data() + (k + 1) * dim_;
      for (Eigen::Index d = 0; d < rest; ++d) {
        double sum = 0;
        for (Eigen::Index j = 0; j < b; ++j) sum += slopes(d, j) * static_cast<double>(vector[j]);
        vector[b + d] = static_cast<float>(half_value(sum));
      }
    }
    covariance.bottomRightCorner(rest, rest) -= slopes * cross.transpose();
  }

  void choose_step_exponents() {
    out_.step_exponent.resize(n_);
    step0_ = static_cast<float>(std::max(settings_.max_step, least_largest_step()));
    for (size_t i = 0; i < n_; ++i) {
      const double w = std::max(static_cast<double>(weights_[i]), 1e-30);
      const double step = std::sqrt(12 * settings_.distortion / w);
      const double octaves = std::log2(static_cast<double>(step0_) / step);
      out_.step_exponent[i] = nearest_code<uint8_t>(octaves, 0, kTransformStepExponents - 1);
    }
    choose_base_octaves();
    out_.steps.assign(dim_, step0_);
    for (size_t k = 0; k < base_; ++k) {
      out_.steps[k] = std::ldexp(step0_, -base_octaves_);
    }
  }

  // How much finer the base is than the rest, so that rows that have to be finer for their base and
  // all that are finer without need take the fewest bits.
  void choose_base_octaves() {
    if (base_ == 0 || !(settings_.base_error > 0)) return;
    double rows[kTransformStepExponents] = {};
    for (const uint8_t exponent : out_.step_exponent) rows[exponent] += 1;
    double least = HUGE_VAL;
    for (int finer = 0; finer <= kMostBaseOctaves; ++finer) {
      double bits = static_cast<double>(base_) * finer * static_cast<double>(n_);
      for (unsigned e = 0; e < kTransformStepExponents; ++e) {
        const double step = std::ldexp(static_cast<double>(step0_), -static_cast<int>(e) - finer);
        const double octaves = std::log2(kErrorPerBaseStep * step / settings_.base_error);
        bits += rows[e] * kNumbersOfRow * std::max(0.0, octaves);
      }
      if (bits >= least) continue;
      least = bits;
      base_octaves_ = finer;
    }
  }

  // Octaves by which coefficient k has finer steps than the largest.
  int octaves_of(size_t k) const { return k < base_ ? base_octaves_ : 0; }

  // The step in which the longest row fits coefficients, where rows have bounds to keep.
  double least_largest_step() const {
    double longest2 = 0;
    for (size_t i = 0; settings_.keeps && i < n_; ++i) {
      double sum = 0;
      for (size_t d = 0; d < dim_; ++d) {
        const double e = row(i, d) - static_cast<double>(out_.basis[d]);
        sum += e * e;
      }
      longest2 = std::max(longest2, sum);
    }
    return std::ldexp(std::sqrt(longest2) / kMostUsedCoefficient, base_ > 0 ? kMostBaseOctaves : 0);
  }

  void quantize() {
    out_.coefficient.assign(dim_, std::vector<int16_t>(n_));
    const std::vector<double> leaning = base_leaning();
    if (settings_.keeps) decoded_axes_ = decoded_axes();
    parallel_for(settings_.threads, n_, kRowGrain, [&](size_t begin, size_t end) {
      std::vector<double> c(dim_);
      std::vector<float> decoded(dim_);
      for (size_t i = begin; i < end; ++i) {
        const double largest = find_coefficients(i, leaning, c.data());
        // A row that lies far out has to do with coarser steps.
        const auto fits = [&](unsigned exponent) {
          return std::ldexp(largest, static_cast<int>(exponent)) <= kMostUsedCoefficient;
        };
        while (out_.step_exponent[i] > 0 && !fits(out_.step_exponent[i])) --out_.step_exponent[i];
        round_coefficients(i, leaning, c.data(), 0);
        if (settings_.keeps) refine(i, leaning, fits, c.data(), decoded.data());
      }
    });
  }

  // Coefficients of row i in steps of step exponent 0, [dim]. Returns the largest magnitude.
  double find_coefficients(size_t i, const std::vector<double>& leaning, double* c) const {
    double largest = 0;
    for (size_t k = 0; k < dim_; ++k) {
      const float* axis = out_.basis.data() + (k + 1) * dim_;
      double sum = 0;
      for (size_t d = k < base_ ? 0 : base_; d < (k < base_ ? base_ : dim_); ++d) {
        sum += (row(i, d) - static_cast<double>(out_.basis[d])) * static_cast<double>(axis[d]);
      }
      c[k] = sum / static_cast<double>(step0_);
      for (size_t j = 0; j < base_ && k >= base_; ++j) c[k] -= c[j] * leaning[k * base_ + j];
      largest = std::max(largest, times_power(std::fabs(c[k]), octaves_of(k)));
    }
    return largest;
  }

  // Rounds the coefficients of row i in its step exponent. dead: those beyond the base that are
  // smaller than half a step of an exponent lower by so many become 0.
  void round_coefficients(size_t i, const std::vector<double>& leaning, const double* given,
                          int dead) {
    const int exponent = out_.step_exponent[i];
    for (size_t k = 0; k < dim_; ++k) {
      double c = given[k];
      // What rounding of the base changes in other numbers, these make up for.
      for (size_t j = 0; j < base_ && k >= base_; ++j) {
        const double rounded = times_power(out_.coefficient[j][i], -exponent - base_octaves_);
        c += (given[j] - rounded) * leaning[k * base_ + j];
      }
      const double scaled = times_power(c, exponent + octaves_of(k));
      const bool is_dead = dead > 0 && k >= base_ && std::fabs(times_power(scaled, -dead)) < 0.5;
      out_.coefficient[k][i] =
          is_dead ? int16_t{0} : nearest_code<int16_t>(scaled, -kMaxCoefficient, kMaxCoefficient);
    }
  }

  // Codes row i in finer steps until it is within its bounds. Those that fail for a base colour do
  // not pay for details that were too small to code before.
  template <typename Fits>
  void refine(size_t i, const std::vector<double>& leaning, const Fits& fits, double* c,
              float* decoded) {
    const auto kept = [&] {
      reconstruct(i, decoded);
      return settings_.keeps(i, decoded);
    };
    if (kept()) return;
    make_exact(i, c);
    const unsigned first = out_.step_exponent[i];
    for (unsigned e = first + 1; e < kTransformStepExponents && fits(e); ++e) {
      out_.step_exponent[i] = static_cast<uint8_t>(e);
      round_coefficients(i, leaning, c, static_cast<int>(e - first));
      if (kept()) return;
      round_coefficients(i, leaning, c, 0);
      if (kept()) return;
    }
  }

  // What a coefficient of 1 adds to a row in step exponent 0, in the integers of decoders: [dim,
  // dim].
  std::vector<double> decoded_axes() const {
    std::vector<double> axes(dim_ * dim_);
    const IntegerBasis integers = integer_basis(out_.basis.data(), dim_, out_.steps.data(), dim_);
    for (size_t i = 0; i < axes.size(); ++i) {
      axes[i] = settings_.integers
                    ? static_cast<double>(integers.scale) * integers.vectors[i]
                    : static_cast<double>(out_.basis[dim_ + i] * out_.steps[i / dim_]);
    }
    return axes;
  }

  void reconstruct(size_t i, float* decoded) const {
    double sum[kMaxNumbers];
    for (size_t d = 0; d < dim_; ++d) sum[d] = static_cast<double>(out_.basis[d]);
    for (size_t k = 0; k < dim_; ++k) {
      if (out_.coefficient[k][i] == 0) continue;
      add_axis(k, times_power(out_.coefficient[k][i], -int{out_.step_exponent[i]}), sum);
    }
    for (size_t d = 0; d < dim_; ++d) decoded[d] = static_cast<float>(sum[d]);
  }

  void add_axis(size_t k, double by, double* sum) const {
    const double* axis = decoded_axes_.data() + k * dim_;
    for (size_t d = 0; d < dim_; ++d) sum[d] += by * axis[d];
  }

  // The axes of decoders are rounded and so not quite orthogonal: adds to the coefficients what
  // they leave of the row.
  void make_exact(size_t i, double* c) const {
    const double step0 = static_cast<double>(step0_);
    for (int round = 0; round < 3; ++round) {
      double left[kMaxNumbers];
      for (size_t d = 0; d < dim_; ++d) {
        left[d] = static_cast<double>(out_.basis[d]) - row(i, d);
      }
      for (size_t k = 0; k < dim_; ++k) add_axis(k, times_power(c[k], octaves_of(k)), left);
      for (size_t k = 0; k < dim_; ++k) {
        const float* axis = out_.basis.data() + (k + 1) * dim_;
        double along = 0;
        for (size_t d = k < base_ ? 0 : base_; d < (k < base_ ? base_ : dim_); ++d) {
          along += left[d] * static_cast<double>(axis[d]);
        }
        c[k] -= along / step0;
      }
    }
  }

  // How far vectors of the base go along each axis of the other numbers, [dim, base].
  std::vector<double> base_leaning() const {
    std::vector<double> leaning(dim_ * base_, 0.0);
    for (size_t k = base_; k < dim_; ++k) {
      for (size_t j = 0; j < base_; ++j) {
        double sum = 0;
        for (size_t d = base_; d < dim_; ++d) {
          sum += static_cast<double>(out_.basis[(k + 1) * dim_ + d]) *
                 static_cast<double>(out_.basis[(j + 1) * dim_ + d]);
        }
        leaning[k * base_ + j] = sum;
      }
    }
    return leaning;
  }

  void choose_eob_indices() {
    if (settings_.all_coefficients) {
      out_.eob_table.assign(1, static_cast<uint8_t>(dim_));
      out_.eob_index.assign(n_, 1);
      return;
    }
    std::vector<uint8_t> used(n_, 0);
    size_t most = 1;
    for (size_t i = 0; i < n_; ++i) {
      for (size_t k = dim_; k-- > 0 && used[i] == 0;) {
        if (out_.coefficient[k][i] != 0) used[i] = static_cast<uint8_t>(k + 1);
      }
      // The base is there for all.
      used[i] = std::max(used[i], static_cast<uint8_t>(base_));
      most = std::max<size_t>(most, used[i]);
    }
    out_.base = base_;
    out_.steps.resize(most);
    out_.coefficient.resize(most);
    out_.basis.resize((most + 1) * dim_);
    // An EOB table pays for vectors of many numbers that are mostly zero.
    if (base_ > 0 && base_ < most) out_.eob_table.push_back(static_cast<uint8_t>(base_));
    if (dim_ > 4) {
      for (const uint8_t step : kEobTable) {
        const size_t end = base_ + step;
        if (end < most) out_.eob_table.push_back(static_cast<uint8_t>(end));
      }
    }
    out_.eob_table.push_back(static_cast<uint8_t>(most));
    out_.eob_index.assign(n_, 1);
    if (out_.eob_table.size() == 1) return;
    for (size_t i = 0; i < n_; ++i) {
      uint8_t eob_index = 0;
      while (eob_index > 0 ? out_.eob_table[eob_index - 1] < used[i] : used[i] > 0) ++eob_index;
      out_.eob_index[i] = eob_index;
    }
  }

  void decode() {
    out_.decoded.resize(n_ * dim_);
    std::vector<float> padded = out_.basis;
    padded.resize(padded.size() + 16);
    TransformSource source = source_of(out_, padded);
    IntegerBasis integers;
    if (settings_.integers) {
      integers = integer_basis(padded.data(), dim_, out_.steps.data(), out_.steps.size());
      source.integer_basis = integers.vectors.data();
      source.integer_scale = integers.scale;
    }
    const TransformKernels& kernels = transform_kernels_reference();
    parallel_for(settings_.threads, n_, kRowGrain, [&](size_t begin, size_t end) {
      // Not compact: coefficient i of each array is that of Gaussian i.
      for (size_t i = begin; i < end; ++i) {
        TransformCursor cursor;
        cursor.coefficient.fill(i);
        float* const row = out_.decoded.data() + i * dim_;
        if (settings_.integers) {
          kernels.integer_rows(source, cursor, i, i + 1, row, false);
        } else {
          kernels.rows(source, cursor, i, i + 1, row);
        }
      }
    });
  }

  const float* rows_;
  const float* weights_;
  size_t n_;
  size_t dim_;
  size_t base_;  // leading numbers, and coefficients, of the base
  const TransformSettings& settings_;
  float step0_ = 0;
  int base_octaves_ = 0;
  std::vector<double> decoded_axes_;  // [dim, dim]
  CodedTransform out_;
};

}  // namespace

bool refine_row(const float* row, size_t i, CodedTransform& coded) {
  const int step_exponent = coded.step_exponent[i] + 1;
  if (step_exponent >= static_cast<int>(kTransformStepExponents)) return false;
  constexpr size_t kMaxDim = 4;
  int16_t q[kMaxDim];
  for (size_t k = 0; k < coded.dim; ++k) {
    const double c = (static_cast<double>(row[k]) - static_cast<double>(coded.basis[k])) /
                     static_cast<double>(coded.steps[k]);
    const double scaled = std::ldexp(c, step_exponent);
    if (!(std::fabs(scaled) <= kMaxCoefficient)) return false;
    q[k] = nearest_code<int16_t>(scaled, -kMaxCoefficient, kMaxCoefficient);
  }
  coded.step_exponent[i] = static_cast<uint8_t>(step_exponent);
  for (size_t k = 0; k < coded.dim; ++k) coded.coefficient[k][i] = q[k];
  std::vector<float> padded = coded.basis;
  padded.resize(padded.size() + 16);
  TransformCursor cursor;
  cursor.coefficient.fill(i);
  transform_kernels_reference().rows(source_of(coded, padded), cursor, i, i + 1,
                                     coded.decoded.data() + i * coded.dim);
  return true;
}

void drop_unused_coefficients(CodedTransform& coded) {
  size_t used = coded.coefficient.size();
  const auto unused = [](const std::vector<int16_t>& column) {
    return std::all_of(column.begin(), column.end(), [](int16_t q) { return q == 0; });
  };
  while (used > 1 && unused(coded.coefficient[used - 1])) --used;
  coded.steps.resize(used);
  coded.coefficient.resize(used);
  coded.basis.resize((used + 1) * coded.dim);
  coded.eob_table.assign(1, static_cast<uint8_t>(used));
}

CodedTransform code_transform(const float* rows, const float* weights, size_t n, size_t dim,
                              const TransformSettings& settings) {
  return TransformCoder(rows, weights, n, dim, settings).run();
}

}  // namespace l4d
