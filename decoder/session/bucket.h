// SPDX-License-Identifier: Apache-2.0
// A decoded bucket made ready for slicing: everything of a Gaussian that does not change with time,
// as a structure of arrays.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "l4d/decode.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/scene/prepare.h"
#include "libl4dcodec/scene/window.h"

namespace l4d {

struct PreparedBucket {
  uint32_t layer = 0;
  uint32_t bucket = 0;
  size_t count = 0;
  bool permanent = false;
  bool flat = false;  // shown as `window` says, and not as mean and lambda do
  double center = 0;
  std::vector<float> position;      // [n, 3] at `reference`
  std::vector<float> mean;          // [n] seconds from center
  std::vector<float> reference;     // [n] seconds from center
  std::vector<float> velocity;      // [n, 3]; empty where none of them moves
  std::vector<float> lambda;        // [n]; empty where permanent or flat
  std::vector<FrameWindow> window;  // [n]; empty unless flat
  std::vector<float> covariance;    // [n, 6]
  std::vector<float> opacity;       // [n] in [0, 1]
  std::vector<float> sh;            // [n, sh_dim]
  // The axes of the covariances, [n, 3] and [n, 4] as in Shape3; empty where nobody wanted them.
  std::vector<float> scale, rotation;
  // [n] place among all Gaussians of the bucket; empty where every one of them is here.
  std::vector<uint32_t> index;

  // Of a PreparedBucket, the Gaussians that reach an opacity: first those that look the same at all
  // times of the sequence, then those that only fade, then those that move.
  struct Order {
    float least = -1;           // the opacity; negative: nothing is in order yet
    std::vector<uint32_t> row;  // [num_unmoving + moving ones]
    std::vector<float> reach;   // [n] by row: shown while lambda dt^2 is at most this
    size_t num_still = 0;
    size_t num_unmoving = 0;
  };
  Order order;

  bool moves() const { return !velocity.empty(); }
  // All of them look the same at all times.
  bool still() const { return permanent && !moves(); }
  float time_in(double time) const { return static_cast<float>(time - center); }
  bool is_visible(size_t i, float t, float gate) const {
    return permanent || l4d::is_visible(lambda[i], t - mean[i], gate);
  }
  void position_at(size_t i, float t, float* out /* [3] */) const {
    for (size_t k = 0; k < 3; ++k) {
      out[k] = position[3 * i + k];
      if (moves()) out[k] += velocity[3 * i + k] * (t - reference[i]);
    }
  }
  bool fades() const { return !permanent && !flat; }
  float opacity_at(size_t i, float t) const {
    return fades() ? opacity[i] * falloff(lambda[i], t - mean[i]) : opacity[i];
  }
  // As seen from `camera`, at the instant `t`.
  void color_at(size_t i, float t, uint32_t sh_degree, const double* camera /* [3] */,
                float* out /* [3] */) const;
  l4d_gaussian_id id_of(size_t i) const { return {layer, bucket, index.empty() ? i : index[i]}; }
  static uint64_t memory_bytes(size_t n, unsigned sh_dim, bool flat, bool with_shape) {
    const unsigned more = (flat ? 2u : 0u) + (with_shape ? 7u : 0u);
    return uint64_t{n} * (3 + 1 + 1 + 3 + 1 + 6 + 1 + 2 + 1 + sh_dim + more) * sizeof(float);
  }

  // Gaussians [begin, end) of arrays that hold what was decoded: position, mean, opacity and sh.
  // The others have their lengths; `scale` and `rotation` are filled unless they are empty.
  void prepare(const SceneHeader& header, const float* rotor, const float* log_scale, size_t begin,
               size_t end);
  // Leaves out Gaussians that are not finite, and velocities where all are 0.
  void finish(const l4d_timeline& timeline, size_t sh_dim);
  // Puts the Gaussians in order for an opacity, if they are not.
  void sort(const l4d_timeline& timeline, float gate, float least);

 private:
  // rows: their outer products are the covariance of Gaussian i.
  void set_shape(const float (*rows)[4] /* [3, 4] */, size_t i);
};

}  // namespace l4d
