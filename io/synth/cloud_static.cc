// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "io/synth/cloud.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kRoomLow{-4, 0, -3};
constexpr Vec3 kRoomHigh{4, 3, 3};

struct Panel {
  Vec3 corner, u, v, normal;  // u and v are whole edges
  double gloss;
};

Panel make_panel(const Vec3& corner, const Vec3& u, const Vec3& v, double gloss) {
  return {corner, u, v, unit(cross(u, v)), gloss};
}

// The six faces of a box, normals outward; of the room, inward.
void append_box(const Vec3& low, const Vec3& high, double gloss, bool inward,
                std::vector<Panel>& panels) {
  for (size_t axis = 0; axis < 3; ++axis) {
    Vec3 u{}, v{};
    u[(axis + 1) % 3] = high[(axis + 1) % 3] - low[(axis + 1) % 3];
    v[(axis + 2) % 3] = high[(axis + 2) % 3] - low[(axis + 2) % 3];
    Vec3 far_corner = low;
    far_corner[axis] = high[axis];
    panels.push_back(inward ? make_panel(low, u, v, gloss) : make_panel(low, v, u, gloss));
    panels.push_back(inward ? make_panel(far_corner, v, u, gloss)
                            : make_panel(far_corner, u, v, gloss));
  }
}

// Walls, floor, ceiling and furniture, seen for the whole sequence.
class Room final : public Part {
 public:
  explicit Room(const Setting& setting) : setting_(setting) {
    append_box(kRoomLow, kRoomHigh, 0.1, true, panels_);
    for (uint64_t box = 0; box < 14; ++box) {
      Rng rng(setting.seed, 10, box);
      const Vec3 size{rng.uniform(0.3, 1.6), rng.uniform(0.3, 1.8), rng.uniform(0.3, 1.2)};
      const Vec3 low{rng.uniform(kRoomLow[0], kRoomHigh[0] - size[0]), 0,
                     rng.uniform(kRoomLow[2], kRoomHigh[2] - size[2])};
      append_box(low, add(low, size), rng.uniform(0, 0.8), false, panels_);
    }
    for (const Panel& panel : panels_) {
      const Vec3 c = cross(panel.u, panel.v);
      const double area = std::sqrt(dot(c, c));
      areas_.push_back(area + (areas_.empty() ? 0 : areas_.back()));
    }
  }

  Particle particle(uint64_t i, uint64_t count) const override {
    Rng rng(setting_.seed, 11, i);
    Particle p;
    const double density = static_cast<double>(count) / areas_.back();
    if (rng.uniform() < 0.04) {
      float_in_air(rng, p);
    } else {
      const double at =
          areas_.back() * ((static_cast<double>(i) + rng.uniform()) / static_cast<double>(count));
      const size_t index = static_cast<size_t>(
          std::upper_bound(areas_.begin(), areas_.end() - 1, at) - areas_.begin());
      lie_on_panel(rng, index, -0.5 * log(density), p);
    }
    p.opacity_logit = trained_opacity_logit(rng);
    p.time = std::clamp(set_lifetime(rng, p), setting_.begin, setting_.begin + setting_.seconds);
    return p;
  }

 private:
  void lie_on_panel(Rng& rng, size_t index, double log_spacing, Particle& p) const {
    const Panel& panel = panels_[index];
    const double a = rng.uniform(), b = rng.uniform();
    p.position = add(panel.corner, add(times(panel.u, a), times(panel.v, b)));
    p.position = add(p.position, times(panel.normal, 0.004 * rng.normal()));
    p.normal = unit(add(panel.normal, times(rng.direction(), 0.08)));
    p.gloss = panel.gloss;
    const double cells_u = std::sqrt(dot(panel.u, panel.u)) * 5;
    const double cells_v = std::sqrt(dot(panel.v, panel.v)) * 5;
    p.color = textured(setting_.seed, index, static_cast<int64_t>(a * cells_u),
                       static_cast<int64_t>(b * cells_v));
    lay_flat(rng, p.normal, log_spacing, p);
  }

  // Training leaves some loose, blurred Gaussians between the surfaces.
  void float_in_air(Rng& rng, Particle& p) const {
    for (size_t k = 0; k < 3; ++k) {
      p.position[k] = rng.uniform(kRoomLow[k] * 1.2, kRoomHigh[k] * 1.2);
      p.log_scale[k] = -2.5 + 0.8 * rng.normal();
    }
    p.normal = rng.direction();
    p.rotation = multiply(turn_z_to(p.normal), rng.turn_about({0, 0, 1}));
    p.color = {0.5 + 0.15 * rng.normal(), 0.5 + 0.15 * rng.normal(), 0.5 + 0.15 * rng.normal()};
  }

  // Returns the mean time. In a scene where anything moves or fades, training gives the static
  // Gaussians wide, scattered time intervals and a slight drift as well; else they are permanent.
  double set_lifetime(Rng& rng, Particle& p) const {
    const double middle = setting_.begin + setting_.seconds / 2;
    const double log_seconds = log(setting_.seconds);
    p.mean_t = middle;
    if (!setting_.temporal) {
      // One float32 step up, so that rounding does not take it below 16 sequences.
      const float log_sigma_t = static_cast<float>(log_seconds + log(16));
      p.log_sigma_t =
          static_cast<double>(std::nextafter(log_sigma_t, std::numeric_limits<float>::infinity()));
      return p.mean_t;
    }
    const double side = rng.uniform() < 0.5 ? -1 : 1;
    if (rng.uniform() < 0.55) {
      p.mean_t = setting_.begin + setting_.seconds * rng.uniform();
      p.log_sigma_t = log_seconds + rng.uniform(0.7, 3.4);
    } else {
      const double away = 0.5 + exp(0.8 + 1.1 * rng.normal());  // sequences from the middle
      p.mean_t = middle + side * away * setting_.seconds;
      p.log_sigma_t = log_seconds + log(away) - rng.uniform(-0.5, 0.7);
    }
    if (setting_.motion) {
      for (double& v : p.velocity) v = 0.005 / setting_.seconds * rng.normal();
    }
    return p.mean_t;
  }

  Setting setting_;
  std::vector<Panel> panels_;
  std::vector<double> areas_;  // cumulative
};

}  // namespace

void lay_flat(Rng& rng, const Vec3& normal, double log_size, Particle& particle) {
  constexpr double kTrainedFloor = -10.39;  // trainers clamp scales near e^-10
  const double common = 0.35 * rng.normal();
  const double u = log_size + common + 0.45 * rng.normal();
  const double v = log_size + common + 0.45 * rng.normal();
  const double flatness = rng.uniform();
  const double across = std::max(std::min(u, v) - (1.4 + 5.5 * flatness * flatness), kTrainedFloor);
  // Local z is across the surface; then the axes are renamed in a cycle.
  const Vec4 turn = multiply(turn_z_to(normal), rng.turn_about({0, 0, 1}));
  const Vec3 scales{u, v, across};
  constexpr Vec4 kCycles[3] = {{1, 0, 0, 0}, {0.5, 0.5, 0.5, 0.5}, {0.5, -0.5, -0.5, -0.5}};
  const size_t cycle = static_cast<size_t>(rng.bits() % 3);
  particle.rotation = multiply(turn, kCycles[cycle]);
  // kCycles[1] takes local x to y, y to z, z to x: local axis k is the old axis k + 1.
  for (size_t k = 0; k < 3; ++k) particle.log_scale[k] = scales[(k + cycle) % 3];
}

double trained_opacity_logit(Rng& rng) {
  const bool solid = rng.uniform() < 0.4;
  const double logit = solid ? 2.5 + 2 * rng.normal() : -2 + 1.2 * rng.normal();
  return std::clamp(logit, -5.3, 14.0);
}

Vec3 textured(uint64_t seed, uint64_t palette, int64_t cell_u, int64_t cell_v) {
  Rng base(seed, 20, palette);
  const Vec3 color{base.uniform(0.15, 0.8), base.uniform(0.15, 0.8), base.uniform(0.15, 0.8)};
  const uint64_t cell = static_cast<uint64_t>(cell_u) * 0x10001 + static_cast<uint64_t>(cell_v);
  Rng variation(seed, 21 + palette * 64, cell);
  return times(color, variation.uniform(0.6, 1.25));
}

std::unique_ptr<Part> make_room(const Setting& setting) { return std::make_unique<Room>(setting); }

}  // namespace l4d::io::synth
