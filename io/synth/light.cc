// SPDX-License-Identifier: Apache-2.0
#include "io/synth/light.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace l4d::io::synth {
namespace {

constexpr double kElevation = 0.231;  // tangent of the sun's height
constexpr Vec3 kSunColor{1.9, 0.798, 0.285};
constexpr double kNever = std::numeric_limits<double>::infinity();

// What the far ridge leaves of the sun: none below a plane that slants away from it.
double above_shade(const Vec3& p) {
  const double far = 40.0 - dot(p, sunset());
  return smooth(-0.5, 0.9, p[1] - (15.0 - far * kElevation));
}

double enter_ball(const Occluder& o, const Vec3& from, const Vec3& d) {
  const Vec3 r = from - o.center;
  const double b = dot(r, d), q = b * b - dot(r, r) + o.radius * o.radius;
  return q > 0 ? 0.0 - b - std::sqrt(q) : kNever;
}

double enter_planes(const Occluder& o, const Vec3& from, const Vec3& d) {
  double enter = -kNever, leave = kNever;
  for (const Plane& plane : o.planes) {
    double slope = dot(plane.n, d);
    if (std::abs(slope) < 1e-9) slope = 1e-9;
    const double t = (plane.d - dot(plane.n, from)) / slope;
    if (slope < 0) {
      enter = std::max(enter, t);
    } else {
      leave = std::min(leave, t);
    }
  }
  return leave > enter ? enter : kNever;
}

double sun_share(const Light& light, const Dot& d) {
  const double seen = above_shade(d.p);
  if (seen <= 0.01) return 0;
  const Vec3 side = cross(sun(), kUp);
  constexpr double kJitter[3][2] = {{0, 0}, {0.016, 0.012}, {-0.016, 0.02}};
  double share = 0;
  for (const auto& j : kJitter) {
    const Vec3 to = unit(sun() + kUp * j[1] + side * j[0]);
    share += light.cast(d.p + d.n * 0.04, to, 60).lets / 3;
  }
  return seen * share;
}

// Openness of the half-space above the surface, by rays; a near hit takes more than a far one.
double openness(const Light& light, const Surfaces& hashes, const Dot& d) {
  constexpr int kRays = 14;
  const double reach = light.ambience.reach;
  const Vec3 e1 = unit(cross(d.n, std::abs(d.n[1]) < 0.9 ? kUp : Vec3{1, 0, 0}));
  const Vec3 e2 = cross(d.n, e1);
  const double turn = hashes.random_at(3, d.p);
  double open = 0;
  for (int k = 0; k < kRays; ++k) {
    const double rr = (k + 0.5) / kRays, turns = k * 0.6180339887 + turn;
    const Vec3 to =
        (e1 * cos_turns(turns) + e2 * sin_turns(turns)) * std::sqrt(rr) + d.n * std::sqrt(1 - rr);
    const Hit hit = light.cast(d.p + d.n * 0.03, to, reach);
    double ground = to[1] < -1e-3 ? d.p[1] / (0.0 - to[1]) : kNever;
    if (d.p[1] <= 0.02) ground = kNever;
    const double t = std::min(hit.distance, std::max(ground, 0.0));
    const double near = t >= reach ? 1 : power(t / reach, 0.7);
    open += std::max(near, ground > reach ? hit.lets : 0.0) / kRays;
  }
  return open;
}

// The part of a lamp with a size that no thing hides, by rays to points within it.
double seen_of(const Light& light, const Lamp& lamp, const Dot& d) {
  constexpr int kRays = 6;
  const Vec3 from = d.p + d.n * 0.02;
  double seen = 0;
  for (int k = 0; k < kRays; ++k) {
    const double y = 1 - 2 * (k + 0.5) / kRays;
    const Vec3 around = on_circle(k * 0.6180339887498949, std::sqrt(1 - y * y));
    const Vec3 to = lamp.at + Vec3{around[0], y, around[2]} * lamp.radius - from;
    const double distance = length(to);
    seen += light.cast(from, to * (1 / distance), distance).lets / kRays;
  }
  return seen;
}

double lamp_share(const Light& light, const Lamp& lamp, const Dot& d) {
  const Vec3 to = lamp.at - d.p;
  const double d2 = dot(to, to), reach2 = lamp.strength / 0.006;
  if (d2 >= reach2 || d2 < 1e-12) return 0;
  const double distance = std::sqrt(d2);
  const Vec3 l = to * (1 / distance);
  const bool leaf = d.kind == Kind::kLeaf;
  double k = clamp(dot(d.n, l) * (leaf ? 0.5 : 1) + (leaf ? 0.5 : 0.06), 0, 1);
  const double fade = 1 - d2 / reach2;
  k *= lamp.strength / (d2 + 0.12) * fade * fade;
  if (dot(lamp.facing, lamp.facing) > 0) k *= clamp(0.0 - dot(l, lamp.facing), 0, 1);
  if (!lamp.shadows || k <= 0.004) return k;
  if (lamp.radius > 0) return k * seen_of(light, lamp, d);
  const Hit hit = light.cast(d.p + d.n * 0.03, l, 9);
  if (hit.distance < distance - 0.12) k *= hit.lets;
  return k;
}

}  // namespace

const Vec3& sunset() {
  static const Vec3 kDirection = unit({-0.64, 0, 0.768});
  return kDirection;
}

const Vec3& sun() {
  static const Vec3 kDirection = unit(sunset() + kUp * kElevation);
  return kDirection;
}

Vec3 sky(const Vec3& d) {
  const double up = std::max(d[1], 0.0);
  const double a = clamp(dot(unit({d[0], 0, d[2]}), sunset()), -1, 1) * 0.5 + 0.5;
  const Vec3 low = mix(Vec3{0.30, 0.22, 0.36}, Vec3{1.25, 0.50, 0.20}, power(a, 2.2));
  const Vec3 mid = mix(Vec3{0.13, 0.15, 0.34}, Vec3{0.44, 0.28, 0.33}, power(a, 1.5));
  const Vec3 c =
      mix(mix(low, mid, smooth(0, 0.22, up)), Vec3{0.045, 0.075, 0.21}, smooth(0.12, 0.85, up));
  return c * mix(1, 0.35, smooth(0, 0.12, 0.0 - d[1]));
}

Vec3 displayed(const Vec3& linear) {
  Vec3 out;
  for (size_t k = 0; k < 3; ++k) {
    const double y = power(1 - exp(-1.75 * clamp(linear[k], 0, 100)), 1 / 2.2);
    out[k] = mix(y, y * y * (3 - 2 * y), 0.6);
  }
  return out;
}

void Light::block(const Vec3& low, const Vec3& high) {
  Occluder o{(low + high) * 0.5, length(high - low) / 2, {}, {0.2, 0.18, 0.17}, 0};
  for (size_t k = 0; k < 3; ++k) {
    Vec3 n{};
    n[k] = 1;
    o.planes.push_back({n, high[k]});
    o.planes.push_back({n * -1, 0.0 - low[k]});
  }
  occluders.push_back(o);
}

void Light::ball(const Vec3& center, double radius, double lets, const Vec3& color) {
  occluders.push_back({center, radius, {}, color, lets});
}

void Light::drum(const Vec3& c, double radius, double y0, double y1, const Vec3& color,
                 double tip) {
  const double high = std::max(tip, y1);
  Occluder o{{c[0], (y0 + high) / 2, c[2]}, 0, {}, color, 0};
  o.radius = std::sqrt(radius * radius + (high - y0) * (high - y0) / 4);
  o.planes.push_back({kUp * -1, 0.0 - y0});
  if (tip <= y1) o.planes.push_back({kUp, y1});
  for (int k = 0; k < 12; ++k) {
    const Vec3 n = on_circle((k + 0.5) / 12, 1);
    o.planes.push_back({n, dot(n, c) + radius});
    if (tip <= y1) continue;
    const Vec3 slanted = unit(n * (tip - y1) + kUp * radius);
    o.planes.push_back({slanted, dot(slanted, {c[0], tip, c[2]})});
  }
  occluders.push_back(o);
}

Hit Light::cast(const Vec3& from, const Vec3& d, double reach) const {
  Hit hit{kNever, 1, nullptr};
  for (const Occluder& o : occluders) {
    const Vec3 to = o.center - from;
    const double along = dot(to, d), rr = o.radius * o.radius, d2 = dot(to, to);
    // Behind, too far, or passed by.
    if (along < 0.0 - o.radius || along > reach + o.radius || d2 - along * along > rr) continue;
    const double t = o.planes.empty() ? enter_ball(o, from, d) : enter_planes(o, from, d);
    if (!(t > 1e-3 && t < reach)) continue;
    hit.lets *= o.lets;
    if (t < hit.distance) {
      hit.distance = t;
      hit.what = &o;
    }
  }
  return hit;
}

Vec3 Light::shade(const Surfaces& hashes, const Dot& d) const {
  if (d.kind == Kind::kUnshaded) return d.emit;
  const double open = openness(*this, hashes, d);
  Vec3 sum = mix(ambience.bounce, ambience.up, d.n[1] * 0.5 + 0.5) +
             ambience.glow * (0.6 * clamp(dot(d.n, sunset()), 0, 1));
  sum = sum * open;
  double facing = ambience.outdoors ? dot(d.n, sun()) : 0;
  if (d.kind == Kind::kLeaf) facing = facing * 0.6 + 0.4;
  facing = clamp(facing, 0, 1);
  if (ambience.outdoors && facing > 0.002) {
    sum = sum + kSunColor * (sun_share(*this, d) * facing);
  }
  for (const Lamp& lamp : lamps) {
    const double k = lamp_share(*this, lamp, d);
    if (k > 0) sum = sum + lamp.color * (k * (0.35 + 0.65 * open));
  }
  return d.emit + d.albedo * sum;
}

Vec3 Light::seen_indoors(const Vec3& from, const Vec3& d) const {
  const Hit hit = cast(from, d, 40);
  Vec3 out{};
  if (hit.what != nullptr) {
    const Vec3 p = from + d * hit.distance;
    Vec3 light = mix(ambience.up, ambience.bounce, 0.5);
    for (const Lamp& lamp : lamps) {  // as if what is hit faced every lamp a little
      const Vec3 to = lamp.at - p;
      const double d2 = dot(to, to);
      double k = 0.45 * lamp.strength / (d2 + 0.3);
      if (dot(lamp.facing, lamp.facing) > 0) {
        k *= clamp(0.0 - dot(to, lamp.facing) / std::sqrt(d2 + 1e-12), 0, 1);
      }
      light = light + lamp.color * k;
    }
    out = hit.what->emit + hit.what->color * light;
  }
  for (const Lamp& lamp : lamps) {
    const Vec3 to = lamp.at - from;
    const double d2 = dot(to, to), along = dot(d, to);
    if (along <= 0 || along * along < 0.8 * d2 || dot(lamp.facing, to) > 0) continue;
    if (hit.distance * hit.distance < 0.7 * d2) continue;  // hidden
    const double lobe = power(along * along / d2, 60);
    out = out + lamp.color * (lobe * std::min(lamp.strength, 1.5) * 2.2 / (0.6 + d2 / 8));
  }
  return out;
}

Vec3 Light::seen_along(const Vec3& from, const Vec3& d) const {
  if (!ambience.outdoors) return seen_indoors(from, d);
  const Hit hit = cast(from, d, 40);
  const double to_ground = d[1] < -0.02 ? from[1] / (0.0 - d[1]) : kNever;
  const bool ground = to_ground < hit.distance && to_ground < 14;
  Vec3 out{0.105, 0.085, 0.09};
  if (!ground && hit.what != nullptr) {
    const Vec3 p = from + d * hit.distance;
    const double high = above_shade(p) * clamp(0.25 - dot(d, sun()) * 0.9, 0, 1);
    const double panes =
        sin_turns(p[0] * 0.493) * sin_turns(p[2] * 0.493) * sin_turns(p[1] * 0.407);
    out = hit.what->color * (Vec3{0.20, 0.17, 0.20} + kSunColor * (0.6 * high));
    if (panes > 0.55 && p[1] > 0.9) out = kLit * 0.8;
  } else if (!ground) {
    const double away = clamp(dot(d, sun()), 0, 1);
    out = sky(d) + Vec3{1.0, 0.48, 0.17} * (power(away, 60) * 3 + power(away, 8) * 0.5);
  }
  for (const Lamp& lamp : lamps) {
    const Vec3 to = lamp.at - from;
    const double d2 = dot(to, to), along = dot(d, to);
    if (along <= 0 || along * along < 0.8 * d2) continue;  // 0.8^30 is nothing
    const double lobe = power(along * along / d2, 30);
    out = out + kLit * (lobe * std::min(lamp.strength, 2.5) * 0.8 / (0.6 + d2 / 8));
  }
  return out;
}

}  // namespace l4d::io::synth
