// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer/closed_loop.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/scene/slice.h"

namespace l4d {
namespace {

double seen_part(const Fading& f, double t) {
  // Beyond the gate a decoder shows nothing.
  return visible_falloff(f.lambda, t - f.mean);
}

}  // namespace

SeenSpan::SeenSpan(std::initializer_list<Fading> any, double begin, double end) {
  double first = end, last = begin;
  for (const Fading& f : any) {
    const double reach = std::sqrt(static_cast<double>(kVisibilityGate) / f.lambda);
    if (f.mean + reach < begin || f.mean - reach > end) continue;
    first = std::min(first, std::max(begin, f.mean - reach));
    last = std::max(last, std::min(end, f.mean + reach));
  }
  // Seen by none: any instant will do.
  if (first > last) first = last = std::clamp(any.begin()->mean, begin, end);
  for (int k = 0; k < kSamples; ++k) {
    time_[k] = first + (last - first) * (k + 0.5) / kSamples;
  }
}

double SeenSpan::matching_mean(const Fading& original, double decoded_lambda) const {
  double sum = 0, weighted = 0;
  for (const double t : time_) {
    const double f = seen_part(original, t);
    sum += f * f;
    weighted += f * f * t;
  }
  if (!(sum > 0)) return original.mean;
  const double middle = weighted / sum;
  return middle - (original.lambda / decoded_lambda) * (middle - original.mean);
}

double SeenSpan::match_opacity(const Fading& original, Fading* decoded) const {
  double both = 0, own = 0, theirs = 0;
  for (const double t : time_) {
    const double f = original.opacity * seen_part(original, t);
    const double g = seen_part(*decoded, t);
    both += f * g;
    own += g * g;
    theirs += f * f;
  }
  decoded->opacity = own > 0 ? std::clamp(both / own, 0.0, 1.0) : original.opacity;
  const double o = decoded->opacity;
  return theirs - 2 * o * both + o * o * own;
}

void SeenSpan::match_position(const Fading& original, const Fading& decoded_fading,
                              const Moving& moving, Moving* decoded) const {
  double sum = 0, elapsed[2] = {0, 0};  // weighted mean of t - reference, of both
  for (const double t : time_) {
    const double w = seen_part(original, t) * seen_part(decoded_fading, t);
    sum += w;
    elapsed[0] += w * (t - moving.reference);
    elapsed[1] += w * (t - decoded->reference);
  }
  if (!(sum > 0)) {
    elapsed[0] = time_[kSamples / 2] - moving.reference;
    elapsed[1] = time_[kSamples / 2] - decoded->reference;
    sum = 1;
  }
  for (int k = 0; k < 3; ++k) {
    decoded->position[k] = moving.position[k] + moving.velocity[k] * (elapsed[0] / sum) -
                           decoded->velocity[k] * (elapsed[1] / sum);
  }
}

}  // namespace l4d
