// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <vector>

#include "io/synth/cloud.h"

namespace l4d::io::synth {
namespace {

constexpr double kTwoPi = 6.283185307179586;
// A Gaussian lives, to the eye, about 5 sigma_t.
constexpr double kSigmasPerLife = 5;

// Splits `count` items as evenly as can be over `slots`, in order: the slot of item i, and its
// number within it.
struct Share {
  uint64_t slot, index;
};
Share share(uint64_t i, uint64_t count, uint64_t slots) {
  // floor(i slots / count) without overflow: counts and slots stay below 2^31.
  const uint64_t slot = i * slots / count;
  const uint64_t first = (slot * count + slots - 1) / slots;
  return {slot, i - first};
}

struct Ellipsoid {
  Vec3 radii;
  double log_radius;

  explicit Ellipsoid(Rng& rng, double low, double high) {
    for (double& r : radii) r = rng.uniform(low, high);
    log_radius = log((radii[0] + radii[1] + radii[2]) / 3);
  }

  // A point of the surface with everything that belongs to the material.
  void place(Rng& rng, uint64_t seed, uint64_t palette, uint64_t points, Particle& p) const {
    const Vec3 d = rng.direction();
    p.position = {radii[0] * d[0], radii[1] * d[1], radii[2] * d[2]};
    p.normal = unit({d[0] / radii[0], d[1] / radii[1], d[2] / radii[2]});
    p.color = textured(seed, palette, static_cast<int64_t>((d[0] + 1) * 4),
                       static_cast<int64_t>((d[1] + 1) * 4));
    // 4 pi r^2 / points of area each
    lay_flat(rng, p.normal, log_radius + 1.25 - 0.5 * log(static_cast<double>(points)), p);
  }
};

// ---- objects that move along smooth paths and turn, a chain of short straight pieces each ----
class RigidObjects final : public Part {
 public:
  explicit RigidObjects(const Setting& setting) : setting_(setting) {
    for (uint64_t o = 0; o < kObjects; ++o) objects_.emplace_back(setting.seed, o);
  }

  Particle particle(uint64_t i, uint64_t count) const override {
    const Share part = share(i, count, kObjects);
    const Object& object = objects_[part.slot];
    const uint64_t members = (count + kObjects - 1) / kObjects;
    const uint64_t segments =
        std::max<uint64_t>(1, static_cast<uint64_t>(setting_.seconds / object.segment + 0.5));
    const double length = setting_.seconds / static_cast<double>(segments);
    const Share piece = share(std::min(part.index, members - 1), members, segments);

    // The same point of the body in every segment, so that the material stays as it moves.
    Rng body(setting_.seed, 31 + part.slot, piece.index);
    Particle p;
    object.shape.place(body, setting_.seed, 1000 + part.slot,
                       std::max<uint64_t>(members / segments, 1), p);
    p.gloss = object.gloss;

    Rng rng(setting_.seed, 41, i);
    p.opacity_logit = trained_opacity_logit(rng);
    p.mean_t =
        setting_.begin + length * (static_cast<double>(piece.slot) + 0.5 + 0.15 * rng.normal());
    p.time = p.mean_t;
    p.log_sigma_t = log(length / kSigmasPerLife * 1.6) + 0.1 * rng.normal();

    const double turns = object.turn_rate * p.mean_t;
    const double c = cos_turns(turns), s = sin_turns(turns);
    const auto turned = [&](const Vec3& v) {  // about the vertical
      return Vec3{c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]};
    };
    const Vec3 arm = turned(p.position);
    const Vec3 spin{arm[2], 0, -arm[0]};
    Vec3 center = object.center;
    p.velocity = times(spin, kTwoPi * object.turn_rate);
    for (size_t k = 0; k < 3; ++k) {
      for (size_t j = 0; j < kWaves; ++j) {
        const Wave& wave = object.waves[k][j];
        const double phase = wave.rate * p.mean_t + wave.phase;
        center[k] += wave.amplitude * sin_turns(phase);
        p.velocity[k] += wave.amplitude * wave.rate * kTwoPi * cos_turns(phase);
      }
    }
    p.position = add(center, arm);
    p.normal = turned(p.normal);
    const double half = turns / 2;
    p.rotation = multiply({cos_turns(half), 0, sin_turns(half), 0}, p.rotation);
    return p;
  }

 private:
  static constexpr uint64_t kObjects = 8;
  static constexpr size_t kWaves = 3;
  struct Wave {
    double amplitude, rate, phase;  // scene units, turns per second, turns
  };
  struct Object {
    Object(uint64_t seed, uint64_t index) : Object(Rng(seed, 30, index)) {}
    explicit Object(Rng rng) : shape(rng, 0.12, 0.45) {
      center = {rng.uniform(-2, 2), rng.uniform(0.6, 2), rng.uniform(-1.5, 1.5)};
      gloss = rng.uniform(0, 1);
      turn_rate = rng.uniform(-0.4, 0.4);
      segment = exp(rng.uniform(-1.2, 1.1));  // 0.3 to 3 s
      for (size_t k = 0; k < 3; ++k) {
        for (size_t j = 0; j < kWaves; ++j) {
          const double reach = (k == 1 ? 0.25 : 0.9) / static_cast<double>(j + 1);
          waves[k][j] = {reach * rng.uniform(0.3, 1),
                         rng.uniform(0.04, 0.16) * static_cast<double>(j + 1), rng.uniform()};
        }
      }
    }
    Ellipsoid shape;
    Vec3 center{};
    double gloss = 0, turn_rate = 0;
    double segment = 1;  // seconds
    Wave waves[3][kWaves];
  };

  Setting setting_;
  std::vector<Object> objects_;
};

// ---- sheets in waves, of short-lived Gaussians ----
class DeformingSheets final : public Part {
 public:
  explicit DeformingSheets(const Setting& setting) : setting_(setting) {
    for (uint64_t s = 0; s < kSheets; ++s) {
      Rng rng(setting.seed, 50, s);
      Sheet& sheet = sheets_[s];
      sheet.center = {rng.uniform(-2.5, 2.5), rng.uniform(0.8, 2), rng.uniform(-2, 2)};
      sheet.normal = unit({rng.uniform(-1, 1), 0.2, rng.uniform(-1, 1)});
      sheet.u = unit(cross({0, 1, 0}, sheet.normal));
      sheet.v = cross(sheet.normal, sheet.u);
      for (Ripple& ripple : sheet.ripples) {
        ripple = {rng.uniform(0.02, 0.1), rng.uniform(-1.2, 1.2), rng.uniform(-1.2, 1.2),
                  rng.uniform(0.2, 1.2), rng.uniform()};
      }
    }
  }

  Particle particle(uint64_t i, uint64_t count) const override {
    Rng rng(setting_.seed, 51, i);
    const uint64_t index = i % kSheets;
    const Sheet& sheet = sheets_[index];
    const double life = rng.uniform(0.1, 0.5);
    Particle p;
    p.mean_t = setting_.begin + setting_.seconds * ((static_cast<double>(i) + rng.uniform()) /
                                                    static_cast<double>(count));
    p.time = p.mean_t;
    p.log_sigma_t = log(life / kSigmasPerLife);
    const double a = rng.uniform(-0.6, 0.6), b = rng.uniform(-0.6, 0.6);
    double height = 0, slope_u = 0, slope_v = 0, rise = 0;
    for (const Ripple& r : sheet.ripples) {
      const double phase = r.u * a + r.v * b - r.rate * p.mean_t + r.phase;
      const double slope = r.amplitude * kTwoPi * cos_turns(phase);
      height += r.amplitude * sin_turns(phase);
      slope_u += slope * r.u;
      slope_v += slope * r.v;
      rise -= slope * r.rate;
    }
    p.position = add(sheet.center, add(times(sheet.u, a), times(sheet.v, b)));
    p.position = add(p.position, times(sheet.normal, height));
    p.velocity = times(sheet.normal, rise);
    p.normal =
        unit(add(sheet.normal, add(times(sheet.u, 0.0 - slope_u), times(sheet.v, 0.0 - slope_v))));
    p.gloss = 0.3;
    p.color = textured(setting_.seed, 2000 + index, static_cast<int64_t>((a + 1) * 10),
                       static_cast<int64_t>((b + 1) * 10));
    const double alive =
        static_cast<double>(count) / kSheets * std::min(0.3 / setting_.seconds, 1.0);
    lay_flat(rng, p.normal, -0.5 * log(std::max(alive, 4.0)), p);
    p.opacity_logit = trained_opacity_logit(rng);
    return p;
  }

 private:
  static constexpr uint64_t kSheets = 3;
  struct Ripple {
    double amplitude, u, v, rate,
        phase;  // scene units; turns per unit, per unit, per second; turns
  };
  struct Sheet {
    Vec3 center, normal, u, v;
    Ripple ripples[3];
  };

  Setting setting_;
  Sheet sheets_[kSheets] = {};
};

// ---- lamps under the ceiling that flash ----
class FlickeringLamps final : public Part {
 public:
  explicit FlickeringLamps(const Setting& setting) : setting_(setting) {}

  Particle particle(uint64_t i, uint64_t count) const override {
    constexpr uint64_t kLamps = 6;
    const uint64_t wanted = static_cast<uint64_t>(setting_.seconds * 8) + 1;  // 8 flashes a second
    const uint64_t flashes = std::clamp<uint64_t>(count / 16, 1, wanted);
    const Share part = share(i, count, flashes);
    Rng flash(setting_.seed, 60, part.slot);
    const double start = (static_cast<double>(part.slot) + flash.uniform()) /
                         static_cast<double>(flashes) * setting_.seconds;
    const uint64_t lamp_index = flash.bits() % kLamps;
    const double life = flash.uniform(0.02, 0.1);
    const double brightness = flash.uniform(1, 3);
    Rng lamp(setting_.seed, 61, lamp_index);
    const Vec3 center{lamp.uniform(-3.5, 3.5), lamp.uniform(2.6, 2.9), lamp.uniform(-2.5, 2.5)};
    const Vec3 tint{lamp.uniform(0.8, 1), lamp.uniform(0.7, 1), lamp.uniform(0.5, 1)};

    Rng rng(setting_.seed, 62, i);
    Particle p;
    p.normal = rng.direction();
    p.position = add(center, times(p.normal, 0.15 * rng.uniform()));
    p.mean_t = setting_.begin + start + 0.1 * life * rng.normal();
    p.time = p.mean_t;
    p.log_sigma_t = log(life / kSigmasPerLife);
    p.color = times(tint, brightness);
    const double size = -3 + 0.6 * rng.normal();
    for (double& s : p.log_scale) s = size + 0.3 * rng.normal();
    p.rotation = multiply(turn_z_to(p.normal), rng.turn_about({0, 0, 1}));
    p.opacity_logit = -1 + 1.5 * rng.normal();
    return p;
  }

 private:
  Setting setting_;
};

// ---- objects that stand still, but not for the whole sequence ----
class AppearingObjects final : public Part {
 public:
  explicit AppearingObjects(const Setting& setting) : setting_(setting) {}

  Particle particle(uint64_t i, uint64_t count) const override {
    const uint64_t wanted = static_cast<uint64_t>(setting_.seconds / 1.5) + 3;
    const uint64_t objects = std::clamp<uint64_t>(count / 32, 1, wanted);
    const Share part = share(i, count, objects);
    Rng object(setting_.seed, 70, part.slot);
    const Ellipsoid shape(object, 0.1, 0.4);
    const Vec3 center{object.uniform(-3.5, 3.5), shape.radii[1], object.uniform(-2.5, 2.5)};
    const double middle = (static_cast<double>(part.slot) + object.uniform()) /
                          static_cast<double>(objects) * setting_.seconds;
    const double longest = std::max(setting_.seconds / 2, 0.2);
    const double life = std::min(exp(0.9 + 0.7 * object.normal()), longest);
    const double gloss = object.uniform(0, 0.6);

    Rng rng(setting_.seed, 71, i);
    Particle p;
    shape.place(rng, setting_.seed, 3000 + part.slot, std::max<uint64_t>(count / objects, 1), p);
    p.position = add(p.position, center);
    p.gloss = gloss;
    p.mean_t = setting_.begin + middle + 0.03 * life * rng.normal();
    p.time = p.mean_t;
    p.log_sigma_t = log(life / kSigmasPerLife) + 0.08 * rng.normal();
    p.opacity_logit = trained_opacity_logit(rng);
    return p;
  }

 private:
  Setting setting_;
};

// ---- an object that is made anew in every frame, as pipelines make it that train frame by frame
// ----
class Frames final : public Part {
 public:
  explicit Frames(const Setting& setting) : setting_(setting) {}

  Particle particle(uint64_t i, uint64_t count) const override {
    const Share part = share(i, count, setting_.frames);
    const double frame = static_cast<double>(part.slot);
    const double seconds = setting_.seconds / setting_.frames;
    Rng object(setting_.seed, 75, 0);
    const Ellipsoid shape(object, 0.25, 0.5);
    const double turns = 0.5 * frame * seconds;

    Rng rng(setting_.seed, 76, i);
    Particle p;
    shape.place(rng, setting_.seed, 4000,
                std::max<uint64_t>(count / std::max<uint32_t>(setting_.frames, 1), 1), p);
    p.position = add(p.position, {sin_turns(turns), 1 + 0.3 * cos_turns(turns), 0});
    p.mean_t = setting_.begin + (frame + 0.5) * seconds;
    p.time = p.mean_t;
    p.opacity_logit = trained_opacity_logit(rng);
    p.window[0] = static_cast<uint32_t>(part.slot);
    p.window[1] = p.window[0] + 1;
    return p;
  }

 private:
  Setting setting_;
};

}  // namespace

std::unique_ptr<Part> make_rigid_objects(const Setting& setting) {
  return std::make_unique<RigidObjects>(setting);
}
std::unique_ptr<Part> make_deforming_sheets(const Setting& setting) {
  return std::make_unique<DeformingSheets>(setting);
}
std::unique_ptr<Part> make_flickering_lamps(const Setting& setting) {
  return std::make_unique<FlickeringLamps>(setting);
}
std::unique_ptr<Part> make_appearing_objects(const Setting& setting) {
  return std::make_unique<AppearingObjects>(setting);
}
std::unique_ptr<Part> make_frames(const Setting& setting) {
  return std::make_unique<Frames>(setting);
}

}  // namespace l4d::io::synth
