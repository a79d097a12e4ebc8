// SPDX-License-Identifier: Apache-2.0
#include "eval/pair/pair_meter.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace l4d::eval {
namespace {

// [Gaussians]: 1 for those of permanent layers.
std::vector<uint8_t> permanent_of(const DecodedScene& loaded) {
  std::vector<uint8_t> out(loaded.scene.count());
  for (const l4d_bucket_span& span : loaded.spans) {
    if (!loaded.permanent[span.layer]) continue;
    std::fill_n(out.begin() + static_cast<std::ptrdiff_t>(span.first), span.count, 1);
  }
  return out;
}

double distance(const io::Vec3& x, const io::Vec3& y) {
  double sum = 0;
  for (size_t k = 0; k < 3; ++k) sum += (x[k] - y[k]) * (x[k] - y[k]);
  return std::sqrt(sum);
}

}  // namespace

PairMeter::PairMeter(const io::Scene& a, const DecodedScene& b, const std::vector<float>& min_sizes,
                     const DecodedScene* stream_a)
    : a_(a),
      b_(b),
      min_sizes_(min_sizes),
      mean_t_a_(stream_a == nullptr || stream_a->mean_t.empty() ? nullptr : &stream_a->mean_t),
      begin_(a.timeline.time_begin),
      end_(begin_ + io::duration(a.timeline)),
      scale_(b.scene.placement.scale / a.placement.scale),
      min_size_(b.stated.stated != 0 ? scale_ * b.stated.min_size : eval::min_size(a)),
      b_never_fades_(permanent_of(b)) {
  for (size_t k = 0; k < 3; ++k) {
    offset_[k] = (b.scene.placement.origin[k] - a.placement.origin[k]) / a.placement.scale;
  }
  if (stream_a != nullptr) a_never_fades_ = permanent_of(*stream_a);
}

Motion PairMeter::motion_a(size_t i) const {
  return mean_t_a_ == nullptr ? motion_of(a_, i) : motion_of(a_, i, (*mean_t_a_)[i]);
}

Motion PairMeter::motion_b(size_t j) const {
  Motion m = b_.mean_t.empty() ? motion_of(b(), j) : motion_of(b(), j, b_.mean_t[j]);
  for (size_t k = 0; k < 3; ++k) {
    m.position[k] = offset_[k] + scale_ * m.position[k];
    m.velocity[k] *= scale_;
  }
  for (double& entry : m.covariance) entry *= scale_ * scale_;
  return m;
}

SeenErrors PairMeter::seen(size_t i, Motion a, size_t j, Motion b) const {
  // What is permanent is always there, whatever its temporal scale.
  const auto keep = [](const std::vector<uint8_t>& never_fades, size_t k, Motion* m) {
    if (!never_fades.empty() && never_fades[k] != 0) {
      m->sigma_t = std::numeric_limits<double>::infinity();
    }
  };
  keep(a_never_fades_, i, &a);
  keep(b_never_fades_, j, &b);
  const double own = min_sizes_.empty() ? 0 : static_cast<double>(min_sizes_[i]);
  return seen_errors(a, linear_opacity(a_, i), b, linear_opacity(this->b(), j), begin_, end_,
                     std::max(min_size_, own));
}

// A coefficient that one of them lacks is zero there.
ColorErrors PairMeter::colors(size_t i, size_t j) const {
  float padded[2][3 * kMaxShTerms] = {};
  const size_t terms_a = a_.sh_coefficients(), terms_b = b().sh_coefficients();
  std::copy_n(&a_.sh[3 * terms_a * i], 3 * terms_a, padded[0]);
  std::copy_n(&b().sh[3 * terms_b * j], 3 * terms_b, padded[1]);
  return color_errors(padded[0], padded[1], std::max(terms_a, terms_b));
}

void PairMeter::visible(const Motion& a, const Motion& b, float* errors) const {
  const VisibleSpan span = visible_span(a, begin_, end_);
  if (span.empty()) return;
  for (size_t s = 0; s < kSamples; ++s) {
    const double share = static_cast<double>(s) / (kSamples - 1);
    const double t = span.begin + (span.end - span.begin) * share;
    const double error = distance(a.at(t), b.at(t));
    errors[s] =
        std::isnan(error) ? std::numeric_limits<float>::infinity() : static_cast<float>(error);
  }
}

}  // namespace l4d::eval
