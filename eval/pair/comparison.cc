// SPDX-License-Identifier: Apache-2.0
#include "eval/pair/comparison.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "eval/pair/pair_meter.h"
#include "eval/parallel.h"

namespace l4d::eval {
namespace {

enum Attribute : size_t {
  kPosition,
  kMeanT,
  kLogScale,
  kRotor,
  kOpacity,
  kSh,
  kVelocity,
  kCovariance,
  kAttributeCount
};
constexpr const char* kNames[kAttributeCount][2] = {
    {"position", "scene units, at A's reference time"},
    {"mean_t", "seconds"},
    {"log_scale", "natural logarithm"},
    {"rotor", "either sign of each half, both normalised"},
    {"opacity", "0 to 1"},
    {"sh", "per coefficient"},
    {"velocity", "scene units per second"},
    {"covariance", "of the slice, relative to A's"}};

constexpr const char* kVisiblePosition = "visible_position";

enum Seen : size_t {
  kSeenPosition,
  kSeenCovariance,
  kSeenOpacity,
  kSeenBaseColor,
  kSeenDirectionalColor,
  kSeenCount
};
constexpr const char* kSeenNames[kSeenCount][2] = {
    {"position_sizes", "distance while seen : largest standard deviation"},
    {"covariance_factor", "ratio of variances; 1 + change : largest variance"},
    {"seen_opacity", "at any instant, with falloff"},
    {"base_color", "of degree 0; colours above 1: in parts of the largest"},
    {"directional_color", "of degrees 1 to 3 in any direction, at most"}};

struct Accumulator {
  double max = 0;
  double sum2 = 0;
  uint64_t count = 0;

  void add(double error) {
    // What is no number is infinitely wrong; std::max would drop it.
    if (std::isnan(error)) error = std::numeric_limits<double>::infinity();
    max = std::max(max, error);
    sum2 += error * error;
    ++count;
  }
  void add(const Accumulator& other) {
    max = std::max(max, other.max);
    sum2 += other.sum2;
    count += other.count;
  }
  double rmse() const { return count == 0 ? 0 : std::sqrt(sum2 / static_cast<double>(count)); }
};
using Accumulators = std::array<Accumulator, kAttributeCount>;

double value(float f) { return static_cast<double>(f); }

// The rotor whose half B is the negative: the same Gaussian, since covariances do not see the sign.
std::array<double, 8> with_other_half(const float* r) {
  return {value(r[7]),  -value(r[6]), value(r[5]),  -value(r[4]),
          -value(r[3]), value(r[2]),  -value(r[1]), value(r[0])};
}

void compare_rotors(const float* a, const float* given, Accumulator& out) {
  std::array<double, 8> b = with_other_half(given);
  double same = 0, other = 0;
  for (size_t k = 0; k < 8; ++k) {
    same += value(a[k]) * value(given[k]);
    other += value(a[k]) * b[k];
  }
  if (std::fabs(same) >= std::fabs(other)) {
    for (size_t k = 0; k < 8; ++k) b[k] = value(given[k]);
  }
  double norm_a = 0;
  double norm_b = 0;
  double dot = 0;
  for (size_t k = 0; k < 8; ++k) {
    norm_a += value(a[k]) * value(a[k]);
    norm_b += b[k] * b[k];
    dot += value(a[k]) * b[k];
  }
  const double scale_a = 1 / std::sqrt(std::max(norm_a, 1e-300));
  const double scale_b = (dot < 0 ? -1 : 1) / std::sqrt(std::max(norm_b, 1e-300));
  for (size_t k = 0; k < 8; ++k) {
    out.add(std::abs(value(a[k]) * scale_a - b[k] * scale_b));
  }
}

double covariance_error(const Motion& a, const Motion& b) {
  double difference = 0;
  double size = 0;
  for (size_t e = 0; e < 6; ++e) {
    const double twice = e == 0 || e == 3 || e == 5 ? 1 : 2;
    const double d = a.covariance[e] - b.covariance[e];
    difference += twice * d * d;
    size += twice * a.covariance[e] * a.covariance[e];
  }
  return difference == 0 ? 0 : std::sqrt(difference / size);
}

void compare_pair(const io::Scene& a, size_t i, const Motion& motion_a, const io::Scene& b,
                  size_t j, const Motion& motion_b, Accumulators& out) {
  // At one instant for both: comparing each at its own reference time would count the error of
  // mean_t times the velocity, which nobody sees.
  const double begin = a.timeline.time_begin;
  const double at = std::clamp(motion_a.mean_t, begin, begin + io::duration(a.timeline));
  const io::Vec3 position_a = motion_a.at(at);
  const io::Vec3 position_b = motion_b.at(at);
  for (size_t k = 0; k < 3; ++k) {
    out[kPosition].add(std::abs(position_a[k] - position_b[k]));
    out[kVelocity].add(std::abs(motion_a.velocity[k] - motion_b.velocity[k]));
  }
  out[kMeanT].add(std::abs(motion_a.mean_t - motion_b.mean_t));
  for (size_t k = 0; k < 4; ++k) {
    out[kLogScale].add(std::abs(value(a.log_scale[4 * i + k]) - value(b.log_scale[4 * j + k])));
  }
  compare_rotors(&a.rotor[8 * i], &b.rotor[8 * j], out[kRotor]);
  out[kOpacity].add(std::abs(linear_opacity(a, i) - linear_opacity(b, j)));
  const size_t width_a = 3 * a.sh_coefficients();
  const size_t width_b = 3 * b.sh_coefficients();
  // A coefficient that one of them lacks is zero there.
  for (size_t k = 0; k < std::max(width_a, width_b); ++k) {
    const double x = k < width_a ? value(a.sh[i * width_a + k]) : 0;
    const double y = k < width_b ? value(b.sh[j * width_b + k]) : 0;
    out[kSh].add(std::abs(x - y));
  }
  out[kCovariance].add(covariance_error(motion_a, motion_b));
}

VisibleError summarise(std::vector<float>& errors) {
  VisibleError result;
  result.gaussians = errors.size() / kSamples;
  if (errors.empty()) return result;
  Accumulator sums;
  for (const float e : errors) sums.add(value(e));
  // The smallest error that 99.9 % do not exceed.
  const size_t rank =
      static_cast<size_t>(std::ceil(0.999 * static_cast<double>(errors.size()))) - 1;
  const auto nth = errors.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(errors.begin(), nth, errors.end());
  result.max = sums.max;
  result.p999 = value(*nth);
  result.rmse = sums.rmse();
  return result;
}

// What 99.9 % do not exceed; and the first of the largest. errors: by Gaussian of B.
SeenError summarise_seen(const char* const names[2], const std::vector<float>& errors,
                         const Pairing& pairing) {
  SeenError out;
  out.name = names[0];
  out.meaning = names[1];
  std::vector<float> sorted;
  for (size_t j = 0; j < errors.size(); ++j) {
    if (pairing.a_of_b[j] == kUnmatched) continue;
    if (sorted.empty() || value(errors[j]) > out.max) {
      out.max = value(errors[j]);
      out.worst = pairing.a_of_b[j];
    }
    sorted.push_back(errors[j]);
  }
  if (sorted.empty()) return out;
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) * 999 / 1000);
  std::nth_element(sorted.begin(), nth, sorted.end());
  out.p999 = value(*nth);
  return out;
}

}  // namespace

Comparison compare_scenes(const io::Scene& a, const DecodedScene& loaded_b, Pairing pairing,
                          uint32_t threads, const std::vector<float>& min_sizes,
                          const DecodedScene* stream_a) {
  const io::Scene& b = loaded_b.scene;
  Comparison result;
  result.count_a = a.count();
  result.count_b = b.count();
  if (!pairing.is_known()) {
    result.pairing = std::move(pairing);
    return result;
  }
  const PairMeter meter(a, loaded_b, min_sizes, stream_a);
  result.min_size = meter.min_size();
  std::vector<Accumulators> sums(num_blocks(b.count()));
  constexpr float kNever = -1;
  std::vector<float> errors(kSamples * b.count(), kNever);
  std::array<std::vector<float>, kSeenCount> seen;
  for (auto& of_kind : seen) of_kind.resize(b.count());
  for_each_block(b.count(), threads, [&](size_t block, size_t first, size_t last) {
    for (size_t j = first; j < last; ++j) {
      const size_t i = pairing.a_of_b[j];
      if (i == kUnmatched) continue;
      const Motion motion_a = meter.motion_a(i), motion_b = meter.motion_b(j);
      compare_pair(a, i, motion_a, b, j, motion_b, sums[block]);
      meter.visible(motion_a, motion_b, &errors[kSamples * j]);
      const SeenErrors e = meter.seen(i, motion_a, j, motion_b);
      seen[kSeenPosition][j] = static_cast<float>(e.position);
      seen[kSeenCovariance][j] = static_cast<float>(e.covariance);
      seen[kSeenOpacity][j] = static_cast<float>(e.opacity);
      const ColorErrors colors = meter.colors(i, j);
      seen[kSeenBaseColor][j] = static_cast<float>(colors.base);
      seen[kSeenDirectionalColor][j] = static_cast<float>(colors.directional);
    }
  });
  Accumulators total;
  for (const Accumulators& block : sums) {
    for (size_t k = 0; k < kAttributeCount; ++k) total[k].add(block[k]);
  }
  for (size_t k = 0; k < kAttributeCount; ++k) {
    result.attributes.push_back({kNames[k][0], kNames[k][1], total[k].max, total[k].rmse()});
  }

  const auto collect = [&](uint64_t first, uint64_t count, std::vector<float>& out) {
    for (uint64_t j = kSamples * first; j < kSamples * (first + count); ++j) {
      if (errors[j] != kNever) out.push_back(errors[j]);
    }
  };
  std::vector<std::vector<float>> by_layer(loaded_b.levels.size());
  for (const l4d_bucket_span& span : loaded_b.spans) {
    collect(span.first, span.count, by_layer[span.layer]);
  }
  for (uint32_t l = 0; l < by_layer.size(); ++l) {
    VisibleError layer = summarise(by_layer[l]);
    layer.layer = l;
    layer.level = loaded_b.levels[l];
    result.layers.push_back(layer);
  }
  std::vector<float> all;
  collect(0, b.count(), all);
  result.visible = summarise(all);
  for (size_t k = 0; k < kSeenCount; ++k) {
    result.seen.push_back(summarise_seen(kSeenNames[k], seen[k], pairing));
  }
  result.pairing = std::move(pairing);
  return result;
}

double Comparison::max_error(const std::string& name) const {
  if (name == kVisiblePosition) return visible.max;
  for (const AttributeError& e : attributes) {
    if (name == e.name) return e.max;
  }
  for (const SeenError& e : seen) {
    if (name == e.name) return e.max;
  }
  throw io::Error(L4D_ERR_INVALID_ARGUMENT, "no error is called " + name);
}

std::vector<std::string> error_names() {
  std::vector<std::string> names = {kVisiblePosition};
  for (const auto& attribute : kNames) names.push_back(attribute[0]);
  for (const auto& seen : kSeenNames) names.push_back(seen[0]);
  return names;
}

}  // namespace l4d::eval
