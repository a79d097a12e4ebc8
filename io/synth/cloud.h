// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>

#include "io/synth/synth_math.h"

namespace l4d::io::synth {

// One Gaussian as the parts of a scene describe it.
struct Particle {
  Vec3 position{};    // where it is at `time`
  double time = 0;    // seconds
  Vec3 velocity{};    // scene units per second
  double mean_t = 0;  // seconds
  double log_sigma_t = 0;
  Vec4 rotation{1, 0, 0, 0};  // w x y z
  Vec3 log_scale{};
  Vec3 color{};  // seen from everywhere, about 0..1; lights above 1
  Vec3 normal{0, 1, 0};
  double gloss = 0;
  double opacity_logit = 0;
  uint32_t window[2] = {0, 0};  // frames; 0, 0: it fades around mean_t
};

struct Setting {
  uint64_t seed = 0;
  double begin = 0;       // of the sequence, seconds
  double seconds = 0;     // its length
  bool temporal = false;  // something in the scene comes and goes
  bool motion = false;    // something moves
  uint32_t frames = 1;    // in the sequence
};

// Gaussian `i` of the `count` of one part.
class Part {
 public:
  virtual ~Part() = default;
  virtual Particle particle(uint64_t i, uint64_t count) const = 0;
};

std::unique_ptr<Part> make_room(const Setting& setting);
std::unique_ptr<Part> make_rigid_objects(const Setting& setting);
std::unique_ptr<Part> make_deforming_sheets(const Setting& setting);
std::unique_ptr<Part> make_flickering_lamps(const Setting& setting);
std::unique_ptr<Part> make_appearing_objects(const Setting& setting);
std::unique_ptr<Part> make_frames(const Setting& setting);

// ---- what parts share ----

// A surface element: flat across `normal`, about `size` wide, with a random turn in its plane and a
// random one of its three axes across. Trained scenes choose that axis freely too.
void lay_flat(Rng& rng, const Vec3& normal, double log_size, Particle& particle);
// Trained scenes hold many faint Gaussians and a group of nearly opaque ones.
double trained_opacity_logit(Rng& rng);
// A colour of a palette, varied from cell to cell like a texture.
Vec3 textured(uint64_t seed, uint64_t palette, int64_t cell_u, int64_t cell_v);

}  // namespace l4d::io::synth
