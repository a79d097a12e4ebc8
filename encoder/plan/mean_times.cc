// SPDX-License-Identifier: Apache-2.0
#include "encoder/plan/mean_times.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/entropy/rans_encoder.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

constexpr unsigned kMaxFineBits = 15;
// Codes of fixed mean times, less some for rounding.
constexpr double kMaxCodes = 65000;
// Targets that steps are tried on.
constexpr size_t kSample = 32768;
constexpr double kQuantiles[] = {0, 0.002, 0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1};

MeanTimeCode code_f16(const MeanTimeCoding& coding, double width, const MeanTimeTarget& target) {
  MeanTimeCode out;
  out.code = float_to_half_saturate(static_cast<float>(target.local / width));
  const unsigned shift = coding.mean_t_shift;
  if (shift > 0) {
    const unsigned cell = unsigned{order_half(out.code)} >> shift;
    out.code = unorder_half(static_cast<uint16_t>((cell << shift) | (1u << (shift - 1))));
  }
  out.local = static_cast<float>(width) * half_to_float(out.code);
  out.within = std::fabs(static_cast<double>(out.local) - target.local) <= target.tolerance;
  return out;
}

MeanTimeCode code_fixed(const MeanTimeCoding& coding, const MeanTimeTarget& target, bool fine) {
  const double step = static_cast<double>(coding.mean_t_step);
  const double zero = coding.mean_t_zero;
  const double last = static_cast<double>((1u << coding.mean_t_bits) - 1);
  MeanTimeCode best;
  best.code =
      static_cast<uint16_t>(std::clamp(std::nearbyint(target.local / step) + zero, 0.0, last));
  // From 0 to 1 inside the step.
  const double inside = target.local / step - (static_cast<double>(best.code) - zero) + 0.5;
  double least = HUGE_VAL;
  for (unsigned bits = 0; bits <= (fine ? kMaxFineBits : 0); ++bits) {
    const double cells = static_cast<double>(1u << bits);
    const double cell = std::clamp(std::floor(inside * cells), 0.0, cells - 1);
    MeanTimeCode out = best;
    out.fine = static_cast<uint16_t>(cells + cell - 1);
    out.local = fixed_mean_time(coding.mean_t_step, coding.mean_t_zero, out.code, out.fine);
    const double error = std::fabs(static_cast<double>(out.local) - target.local);
    out.within = error <= target.tolerance;
    if (out.within) return out;
    if (error < least) best = out;
    least = std::min(least, error);
  }
  return best;
}

// Bits of integers under a table of their own.
class Tokens {
 public:
  void add(uint16_t value) {
    const RansToken token = hybrid_token(value);
    ++count_[token.token];
    raw_ += token.bits;
    ++n_;
  }
  double bits() const {
    double sum = raw_;
    for (const double c : count_) {
      if (c > 0) sum += c * std::log2(n_ / c);
    }
    return sum;
  }

 private:
  std::array<double, kRansHybridTokens> count_{};
  double raw_ = 0, n_ = 0;
};

// Fixed coding with a step of about `step`, for times from low to high.
MeanTimeCoding with_step(const MeanTimeCoding& coding, double step, double low, double high) {
  MeanTimeCoding out = coding;
  out.mean_t = CoordinateCodingId::kFixed;
  step = std::clamp(std::max(step, (high - low) / kMaxCodes), 0x1p-59, 0x1p59);
  out.mean_t_step = static_cast<float>(step);
  step = static_cast<double>(out.mean_t_step);
  out.mean_t_zero = static_cast<unsigned>(std::ceil(-low / step));
  const double last = std::ceil(high / step) + static_cast<double>(out.mean_t_zero);
  out.mean_t_bits = 1;
  while (out.mean_t_bits < kMaxMeanBits &&
         last > static_cast<double>((1u << out.mean_t_bits) - 1)) {
    ++out.mean_t_bits;
  }
  return out;
}

void choose_fixed(const std::vector<MeanTimeTarget>& targets, MeanTimeCoding* coding) {
  double low = 0, high = 0, min_tolerance = HUGE_VAL;
  for (const MeanTimeTarget& t : targets) {
    low = std::min(low, t.local);
    high = std::max(high, t.local);
    min_tolerance = std::min(min_tolerance, t.tolerance);
  }
  std::vector<MeanTimeTarget> sample;
  const size_t stride = targets.size() / kSample + 1;
  for (size_t i = 0; i < targets.size(); i += stride) sample.push_back(targets[i]);
  std::vector<double> tolerance;
  for (const MeanTimeTarget& t : sample) tolerance.push_back(t.tolerance);
  std::sort(tolerance.begin(), tolerance.end());
  // Beyond this the finest cells would be more than the least tolerance wide.
  const double largest = min_tolerance * static_cast<double>(1u << kMaxFineBits);
  MeanTimeCoding best;
  double least = HUGE_VAL;
  for (const double q : kQuantiles) {
    const size_t at = static_cast<size_t>(q * static_cast<double>(tolerance.size() - 1));
    const MeanTimeCoding tried =
        with_step(*coding, std::min(2 * tolerance[at], largest), low, high);
    Tokens whole, fine;
    for (const MeanTimeTarget& t : sample) {
      const MeanTimeCode code = code_fixed(tried, t, true);
      whole.add(code.code);
      fine.add(code.fine);
    }
    const double bits = whole.bits() + fine.bits();
    if (bits >= least) continue;
    least = bits;
    best = tried;
  }
  *coding = best;
  coding->mean_t_fine = std::any_of(targets.begin(), targets.end(), [&](const MeanTimeTarget& t) {
    return code_fixed(*coding, t, true).fine != 0;
  });
}

// The most low bits that all can do without.
unsigned choose_shift(const std::vector<MeanTimeTarget>& targets, double width,
                      const MeanTimeCoding& coding) {
  MeanTimeCoding tried = coding;
  for (unsigned shift = kMaxMeanShift; shift > 0; --shift) {
    tried.mean_t_shift = shift;
    const bool all = std::all_of(targets.begin(), targets.end(), [&](const MeanTimeTarget& t) {
      return code_f16(tried, width, t).within || !code_f16(coding, width, t).within;
    });
    if (all) return shift;
  }
  return 0;
}

}  // namespace

bool mean_time_fits(bool f16, double width, double tolerance) {
  // Half a step of numbers up to half a width: of binary16, and of sums and products of binary32
  // with room for what is below.
  return width * (f16 ? 0x1p-13 : 0x1p-22) <= tolerance;
}

bool fixed_mean_times_fit(double reach, double tolerance) {
  return 2 * reach / kMaxCodes / static_cast<double>(2u << kMaxFineBits) <= 0.5 * tolerance;
}

void choose_mean_times(const std::vector<MeanTimeTarget>& targets, bool f16, int shift,
                       double width, MeanTimeCoding* coding) {
  if (f16 || targets.empty()) {
    coding->mean_t = CoordinateCodingId::kF16;
    coding->mean_t_shift = 0;
    coding->mean_t_shift =
        shift >= 0 ? static_cast<unsigned>(shift) : choose_shift(targets, width, *coding);
    return;
  }
  choose_fixed(targets, coding);
}

MeanTimeCode code_mean_time(const MeanTimeCoding& coding, double width,
                            const MeanTimeTarget& target) {
  return coding.mean_t == CoordinateCodingId::kFixed
             ? code_fixed(coding, target, coding.mean_t_fine)
             : code_f16(coding, width, target);
}

}  // namespace l4d
