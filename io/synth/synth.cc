// SPDX-License-Identifier: Apache-2.0
#include "io/synth/synth.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "io/synth/cloud.h"
#include "io/synth/room/room.h"
#include "io/synth/sh_basis.h"
#include "io/synth/square.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {

const std::array<const char*, 7> kSynthEffects = {"static", "rigid", "deform", "flicker",
                                                  "appear", "view",  "frames"};

namespace {

using synth::Part;
using synth::Particle;
using synth::Rng;

constexpr size_t kMaxCoefficients = 16;

// A highlight around the mirrored light, and on top of it what training leaves in any scene: noise
// in every coefficient, as strong as the colour was hard to see. So no few directions span it all.
void put_sh(Rng& rng, const Particle& p, uint32_t degree, float* sh /* [K, 3] */) {
  double dc_noise[3];
  for (double& n : dc_noise) n = 0.12 * rng.normal();
  for (size_t c = 0; c < 3; ++c) {
    sh[c] = static_cast<float>((p.color[c] - 0.5) / sh_constant::k0 + dc_noise[c]);
  }
  if (degree == 0) return;

  constexpr double kBandLight[3] = {0.34, 0.2, 0.11};
  constexpr double kBandNoise[3] = {1, 0.9, 0.8};
  const Vec3 light = synth::unit(synth::add(p.normal, {0.3, 0.7, 0.2}));
  double basis[kMaxCoefficients - 1];
  synth::sh_basis(synth::unit(synth::add(light, synth::times(rng.direction(), 0.5))), basis);
  const double shine = p.gloss * synth::exp(0.5 * rng.normal());
  const double noise = 0.05 * synth::exp(0.6 * rng.normal());
  for (size_t k = 1; k < kMaxCoefficients; ++k) {
    const size_t band = k < 4 ? 0 : (k < 9 ? 1 : 2);
    const double shared = rng.normal();  // of the three channels: most noise is in brightness
    for (size_t c = 0; c < 3; ++c) {
      const double value = shine * kBandLight[band] * basis[k - 1] +
                           noise * kBandNoise[band] * (0.8 * shared + 0.6 * rng.normal());
      sh[3 * k + c] = static_cast<float>(value);
    }
  }
}

// Tilts a still Gaussian's axes into time, in the plane of its velocity and the time axis.
Rotor tilted(const Vec4& quaternion, const Vec3& velocity) {
  const Matrix3 r = quaternion_to_matrix(quaternion);
  const double speed = std::sqrt(dot(velocity, velocity));
  const Vec3 n = synth::times(velocity, 1 / speed);
  const double c = 1 / std::sqrt(1 + speed * speed), s = speed * c;
  Matrix4 m;
  for (size_t k = 0; k < 3; ++k) {
    const double along = n[0] * r[k] + n[1] * r[3 + k] + n[2] * r[6 + k];
    for (size_t i = 0; i < 3; ++i) m[4 * i + k] = r[3 * i + k] + n[i] * along * (c - 1);
    m[12 + k] = 0.0 - s * along;
    m[4 * k + 3] = n[k] * s;
  }
  m[15] = c;
  return matrix_to_rotor(m);
}

struct Shape {
  Rotor rotor;
  Vec4 log_scale;
};

Shape shape_of(const Particle& p) {
  Shape shape;
  shape.log_scale = {p.log_scale[0], p.log_scale[1], p.log_scale[2], p.log_sigma_t};
  const bool still = p.velocity == Vec3{0, 0, 0};
  if (still) {
    shape.rotor = quaternion_to_rotor(p.rotation);
    return shape;
  }
  // A tilt of the axes gives the velocity as long as the Gaussian is much longer in time than wide
  // in space; a short one needs its axes found anew.
  const double log_width = *std::max_element(p.log_scale.begin(), p.log_scale.end());
  if (p.log_sigma_t > log_width + 4) {
    shape.rotor = tilted(p.rotation, p.velocity);
    return shape;
  }
  Vec3 scale;
  for (size_t k = 0; k < 3; ++k) scale[k] = synth::exp(p.log_scale[k]);
  const Shape4 found = shape_of_moving(quaternion_to_matrix(p.rotation), scale, p.velocity,
                                       synth::exp(p.log_sigma_t));
  shape.rotor = found.rotor;
  for (size_t k = 0; k < 4; ++k) shape.log_scale[k] = synth::log(found.scale[k]);
  return shape;
}

void put_particle(const Particle& p, Scene& scene, size_t i) {
  const Shape shape = shape_of(p);
  Rotor stored_rotor;
  Vec4 stored_scale;
  for (size_t k = 0; k < 8; ++k) {
    scene.rotor[8 * i + k] = static_cast<float>(shape.rotor[k]);
    stored_rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
  }
  for (size_t k = 0; k < 4; ++k) {
    scene.log_scale[4 * i + k] = static_cast<float>(shape.log_scale[k]);
    stored_scale[k] = synth::exp(static_cast<double>(scene.log_scale[4 * i + k]));
  }
  scene.mean_t[i] = static_cast<float>(p.mean_t);
  if (!scene.window.empty()) std::copy_n(p.window, 2, &scene.window[2 * i]);
  scene.opacity[i] = static_cast<float>(p.opacity_logit);
  // From the stored values: a mean time far from the sequence is a long lever, and the Gaussian has
  // to be in its place when it is seen.
  const double dt = static_cast<double>(scene.mean_t[i]) - p.time;
  const Vec3 velocity = velocity_of(stored_rotor, stored_scale);
  for (size_t k = 0; k < 3; ++k) {
    scene.position[3 * i + k] = static_cast<float>(p.position[k] + velocity[k] * dt);
  }
}

struct Effects {
  bool on[kSynthEffects.size()] = {};

  bool operator[](const char* name) const {
    for (size_t i = 0; i < kSynthEffects.size(); ++i) {
      if (std::string(name) == kSynthEffects[i]) return on[i];
    }
    return false;
  }
};

Effects parse_effects(const std::vector<std::string>& names) {
  Effects effects;
  // All but the last, which shows its Gaussians in another way.
  if (names.empty()) std::fill(std::begin(effects.on), std::end(effects.on) - 1, true);
  for (const std::string& name : names) {
    const auto found = std::find(kSynthEffects.begin(), kSynthEffects.end(), name);
    if (found == kSynthEffects.end()) {
      throw Error(L4D_ERR_INVALID_ARGUMENT, "unknown effect " + name);
    }
    effects.on[found - kSynthEffects.begin()] = true;
  }
  // A scene needs some geometry to have colours on.
  const bool any_part = std::any_of(effects.on, effects.on + 5, [](bool on) { return on; });
  if (!any_part && !effects["frames"]) effects.on[0] = true;
  return effects;
}

struct Portion {
  const char* effect;
  double share;
  std::unique_ptr<Part> (*make)(const synth::Setting&);
};
// Shares of all Gaussians when everything is on; those of effects that are off go to the others.
constexpr Portion kPortions[] = {{"static", 0.75, synth::make_room},
                                 {"rigid", 0.11, synth::make_rigid_objects},
                                 {"deform", 0.07, synth::make_deforming_sheets},
                                 {"flicker", 0.02, synth::make_flickering_lamps},
                                 {"appear", 0.05, synth::make_appearing_objects},
                                 {"frames", 0.5, synth::make_frames}};

// Where the Gaussians of each portion end. Without a number of their own, static ones take a share
// like the others.
std::array<uint64_t, std::size(kPortions)> portion_ends(const Effects& effects,
                                                        const SynthOptions& options) {
  const bool fixed_room = effects["static"] && options.static_gaussians > 0;
  const uint64_t room = fixed_room ? std::min(options.static_gaussians, options.gaussians) : 0;
  double total_share = 0;
  for (const Portion& portion : kPortions) {
    const bool counted = effects[portion.effect] && !(fixed_room && &portion == kPortions);
    total_share += counted ? portion.share : 0;
  }
  std::array<uint64_t, std::size(kPortions)> ends{};
  double share_so_far = 0;
  for (size_t p = 0; p < ends.size(); ++p) {
    const bool counted = effects[kPortions[p].effect] && !(fixed_room && p == 0);
    share_so_far += counted ? kPortions[p].share : 0;
    const double rest = static_cast<double>(options.gaussians - room);
    const double share = total_share > 0 ? share_so_far / total_share : 1;
    ends[p] = std::min(options.gaussians, room + static_cast<uint64_t>(share * rest + 0.5));
    if (fixed_room && p == 0) ends[p] = room;
  }
  // Alone, the room is everything.
  if (total_share == 0) ends[0] = options.gaussians;
  for (size_t p = 1; p < ends.size(); ++p) ends[p] = std::max(ends[p], ends[p - 1]);
  return ends;
}

}  // namespace

Scene synthesize(const SynthOptions& options) {
  constexpr uint64_t kMaxGaussians = 1 << 30;
  if (options.gaussians == 0 || options.gaussians > kMaxGaussians) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "the number of Gaussians must be 1 to 2^30");
  }
  if (!(options.seconds > 0 && options.seconds <= 86400)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "the duration must be above 0 and at most 86400 seconds");
  }
  if (options.scene == "square") return synth::make_square(options);
  if (options.scene == "room") return synth::make_living_room(options);
  if (options.scene != "cloud") {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "unknown scene " + options.scene);
  }
  const Effects effects = parse_effects(options.effects);
  Scene scene;
  scene.source = "synth";
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  scene.placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
  set_fps(scene.timeline, options.fps);
  set_duration(scene.timeline, options.seconds);
  scene.sh_degree = effects["view"] ? 3 : 0;
  scene.resize(static_cast<size_t>(options.gaussians));

  synth::Setting setting;
  setting.seed = options.seed;
  setting.begin = scene.timeline.time_begin;
  setting.seconds = duration(scene.timeline);
  setting.frames = scene.timeline.num_frames;
  setting.motion = effects["rigid"] || effects["deform"];
  setting.temporal = setting.motion || effects["flicker"] || effects["appear"];
  if (effects["frames"]) scene.window.resize(2 * scene.count());

  const std::array<uint64_t, std::size(kPortions)> ends = portion_ends(effects, options);
  uint64_t first = 0;
  for (size_t p = 0; p < ends.size(); ++p) {
    if (ends[p] == first) continue;
    const Portion& portion = kPortions[p];
    const uint64_t end = ends[p];
    const std::unique_ptr<Part> part = portion.make(setting);
    const size_t sh_size = 3 * scene.sh_coefficients();
    // Each Gaussian depends on its number alone.
    parallel_for(options.threads, static_cast<size_t>(end - first), 4096,
                 [&](size_t begin, size_t stop) {
                   call(options.check);
                   for (uint64_t i = first + begin; i < first + stop; ++i) {
                     const Particle particle = part->particle(i - first, end - first);
                     const size_t at = static_cast<size_t>(i);
                     put_particle(particle, scene, at);
                     Rng rng(options.seed, 80, i);
                     put_sh(rng, particle, scene.sh_degree, &scene.sh[sh_size * at]);
                   }
                 });
    first = end;
  }
  return scene;
}

}  // namespace l4d::io
