// SPDX-License-Identifier: Apache-2.0
#include "decoder/session/bucket.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "l4d/attributes.hpp"
#include "libl4dcodec/scene/sh.h"
#include "libl4dcodec/scene/shape.h"

namespace l4d {
namespace {

// The sequence in the clock of a bucket.
struct LocalSequence {
  float begin, end;
  LocalSequence(const l4d_timeline& timeline, double center) {
    const Sequence sequence = sequence_of(timeline);
    begin = static_cast<float>(sequence.begin - center);
    end = static_cast<float>(sequence.end - center);
  }
};

// Whether Gaussian i of a bucket has a finite covariance, and a finite position wherever the
// sequence takes it. Its rotor can keep it from that, where it is stored as it is.
bool is_finite(const PreparedBucket& bucket, size_t i, const LocalSequence& sequence) {
  float sum = bucket.opacity[i] + bucket.reference[i];
  for (size_t k = 0; k < 6; ++k) sum += 0.0f * bucket.covariance[6 * i + k];
  if (!bucket.lambda.empty()) sum += 0.0f * bucket.lambda[i];
  for (size_t k = 0; k < 3; ++k) {
    const float at = bucket.position[3 * i + k];
    const float v = bucket.moves() ? bucket.velocity[3 * i + k] : 0.0f;
    // Rounding keeps the order of times: what is finite at both ends is so between them.
    sum += 0.0f * (at + v * (sequence.begin - bucket.reference[i]));
    sum += 0.0f * (at + v * (sequence.end - bucket.reference[i]));
  }
  return std::isfinite(sum);
}

// The reach of a Gaussian, with what roundings may add: nothing that an image would show is left
// out.
float roomy_reach(float opacity, float gate, float least) {
  if (!(least > 0)) return gate;
  const float reach = reach_of(opacity, least, gate);
  if (!(reach > -1)) return -1;  // -infinity where there is no opacity at all
  return std::min(gate, reach + 1e-5f * (1 + std::fabs(reach)));
}

}  // namespace

void PreparedBucket::prepare(const SceneHeader& header, const float* rotor, const float* log_scale,
                             size_t begin, size_t end) {
  const LocalSequence sequence(header.timeline, center);
  for (size_t i = begin; i < end; ++i) {
    float rows[3][4];
    const Slice4D<float> s = slice_attributes(rotor + 8 * i, log_scale + 4 * i, rows);
    std::copy_n(s.covariance, 6, covariance.data() + 6 * i);
    if (!scale.empty()) set_shape(rows, i);
    if (moves()) std::copy_n(s.velocity, 3, velocity.data() + 3 * i);
    if (fades()) lambda[i] = s.lambda;
    reference[i] = header.position_at_mean_time
                       ? mean[i]
                       : reference_time(mean[i], sequence.begin, sequence.end);
    opacity[i] = linear_opacity(opacity[i], header.opacity_logit);
  }
}

void PreparedBucket::color_at(size_t i, float t, uint32_t sh_degree, const double* camera,
                              float* out) const {
  float at[3];
  position_at(i, t, at);
  const double seen[3] = {static_cast<double>(at[0]), static_cast<double>(at[1]),
                          static_cast<double>(at[2])};
  const double along_z[3] = {0, 0, 1};
  double direction[3], color[3];
  direction_from(camera, seen, along_z, direction);
  sh_color(sh_degree, sh.data() + 3 * sh_terms(sh_degree) * i, direction, color);
  clamp_color(color);
  for (size_t k = 0; k < 3; ++k) out[k] = static_cast<float>(color[k]);
}

void PreparedBucket::set_shape(const float (*rows)[4], size_t i) {
  double wide[12];
  for (size_t k = 0; k < 12; ++k) wide[k] = static_cast<double>(rows[k / 4][k % 4]);
  const Shape3 shape = shape_of_rows(wide);
  for (size_t k = 0; k < 3; ++k) scale[3 * i + k] = static_cast<float>(shape.scale[k]);
  for (size_t k = 0; k < 4; ++k) rotation[4 * i + k] = static_cast<float>(shape.rotation[k]);
}

void PreparedBucket::finish(const l4d_timeline& timeline, size_t sh_dim) {
  const LocalSequence sequence(timeline, center);
  std::vector<uint8_t> finite(count);
  size_t kept = 0;
  for (size_t i = 0; i < count; ++i) {
    finite[i] = is_finite(*this, i, sequence) ? 1 : 0;
    kept += finite[i];
  }
  if (kept != count) {
    keep_rows(finite, 3, &position);
    keep_rows(finite, 3, &velocity);
    keep_rows(finite, 6, &covariance);
    for (auto* column : {&mean, &reference, &lambda, &opacity}) keep_rows(finite, 1, column);
    keep_rows(finite, sh_dim, &sh);
    keep_rows(finite, 1, &window);
    keep_rows(finite, 3, &scale);
    keep_rows(finite, 4, &rotation);
    if (index.empty()) {
      index.resize(count);
      std::iota(index.begin(), index.end(), 0u);
    }
    keep_rows(finite, 1, &index);
    count = kept;
  }
  if (std::all_of(velocity.begin(), velocity.end(), [](float v) { return v == 0; })) {
    std::vector<float>().swap(velocity);
  }
}

void PreparedBucket::sort(const l4d_timeline& timeline, float gate, float least) {
  if (order.least == least) return;
  order.least = -1;
  order.reach.resize(count);
  const LocalSequence sequence(timeline, center);
  std::vector<uint8_t> group(count);
  constexpr uint8_t kNever = kNumMotionGroups;
  size_t size[kNumMotionGroups + 1] = {};
  for (size_t i = 0; i < count; ++i) {
    const float reach = order.reach[i] = roomy_reach(opacity[i], gate, least);
    float v[3] = {0, 0, 0};
    for (size_t k = 0; k < 3 && moves(); ++k) v[k] = velocity[3 * i + k];
    const float own_lambda = fades() ? lambda[i] : 0;
    const float life = fades() ? half_life(reach, own_lambda) : INFINITY;
    group[i] = kNever;
    if (!(reach < 0)) {
      group[i] = group_of(v, own_lambda, mean[i], life, sequence.begin, sequence.end);
      const bool always = !flat || (window[i].begin == 0 && window[i].end == timeline.num_frames);
      if (group[i] == kStill && !always) group[i] = kFading;
    }
    ++size[group[i]];
  }
  size_t next[kNumMotionGroups] = {0, size[kStill], size[kStill] + size[kFading]};
  order.row.resize(count - size[kNever]);
  for (size_t i = 0; i < count; ++i) {
    if (group[i] != kNever) order.row[next[group[i]]++] = static_cast<uint32_t>(i);
  }
  order.num_still = size[kStill];
  order.num_unmoving = size[kStill] + size[kFading];
  order.least = least;
}

}  // namespace l4d
