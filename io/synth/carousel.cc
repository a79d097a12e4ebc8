// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

constexpr Vec3 kCenter{3.6, 0, -2.6};
constexpr double kTurns = 0.08, kPiece = 0.28;  // turns a second, seconds

// The carousel at rest about the origin. What rises and falls carries its phase.
struct Body {
  Patch dots;
  std::vector<double> bob;  // turns; below 0: does not bob
};

class Carousel {
 public:
  explicit Carousel(Place& place) : place_(place) {}

  void make() {
    const Patch base = place_.tube(kCenter, kCenter + kUp * 0.36, 2.8, 2.8, 0.16);
    place_.put(base, [&](Dot& d) {
      d.albedo =
          Vec3{0.26, 0.24, 0.23} * (0.7 + 0.6 * place_.random(71, static_cast<int>(d.a * 40)));
    });
    platform();
    canopy();
    for (int k = 0; k < 8; ++k) horse(k);
    if (!place_.counting) light();
    place_bodies();
  }

 private:
  template <typename Paint>
  void put(Patch patch, const Paint& paint, double bob = -1, double thin = 0.06) {
    for (Dot& d : patch) {
      d.thin = bob < 0 ? thin : 0.45;
      paint(d);
      body_.dots.push_back(d);
      body_.bob.push_back(bob);
    }
  }
  void put_color(const Patch& patch, const Vec3& color, double bob = -1, double thin = 0.06) {
    put(
        patch, [&](Dot& d) { d.albedo = color; }, bob, thin);
  }

  void platform() {
    put(place_.disc(kUp * 0.42, 0, 2.75, 0.24), [&](Dot& d) {
      d.albedo =
          Vec3{0.40, 0.25, 0.14} * (0.6 + 0.6 * place_.random(72, static_cast<int>(d.a * 32)));
    });
    put(place_.tube(kUp * 0.28, kUp * 0.44, 2.8, 2.8, 0.14), [](Dot& d) {
      d.albedo =
          static_cast<int>(d.a * 16) % 2 == 0 ? Vec3{0.55, 0.06, 0.05} : Vec3{0.70, 0.50, 0.14};
    });
    put(place_.tube(kUp * 0.45, kUp * 3.1, 0.55, 0.55, 0.18), [](Dot& d) {
      d.albedo =
          static_cast<int>(d.a * 12) % 2 == 0 ? Vec3{0.70, 0.52, 0.20} : Vec3{0.62, 0.50, 0.42};
      d.emit = {0.05, 0.03, 0.01};
    });
  }

  void canopy() {
    put(place_.disc(kUp * 4.45, 0, 2.95, 0.2, -1.3), [](Dot& d) {
      d.albedo =
          static_cast<int>(d.a * 16) % 2 == 0 ? Vec3{0.66, 0.07, 0.06} : Vec3{0.80, 0.70, 0.52};
      d.emit = d.albedo * Vec3{0.34, 0.20, 0.10};  // cloth, lit from below
    });
    Patch ceiling = place_.disc(kUp * 3.12, 0, 2.93, 0.42);
    turn_over(ceiling);
    put_color(ceiling, {0.55, 0.42, 0.25});
    const Patch scallops =
        kept(place_.tube(kUp * 2.86, kUp * 3.22, 2.97, 2.97, 0.12), [](const Dot& d) {
          const double x = 2 * std::abs(d.a * 32 - std::floor(d.a * 32) - 0.5);
          return d.b > 0.45 * x * x - 0.02;
        });
    put(scallops, [](Dot& d) {
      d.albedo =
          static_cast<int>(d.a * 32) % 2 == 0 ? Vec3{0.72, 0.52, 0.16} : Vec3{0.10, 0.22, 0.42};
    });
    put_color(place_.ball(kUp * 4.55, {0.16, 0.16, 0.16}, 0.09), {0.8, 0.55, 0.12});
    for (int k = 0; k < 16; ++k) {
      put(place_.ball(on_circle(k / 16.0, 2.99) + kUp * 3.24, {0.05, 0.05, 0.05}, 0.07),
          [](Dot& d) {
            d.emit = kLit * 2.6;
            d.kind = Kind::kUnshaded;
          });
    }
  }

  void horse(int k) {
    constexpr Vec3 kCoats[] = {
        {0.75, 0.72, 0.66}, {0.30, 0.16, 0.08}, {0.60, 0.45, 0.25}, {0.16, 0.15, 0.16}};
    constexpr Vec3 kSaddles[] = {{0.6, 0.05, 0.05}, {0.08, 0.18, 0.5}, {0.1, 0.35, 0.12}};
    constexpr Vec3 kHair{0.12, 0.08, 0.06};
    const double turns = (k + 0.5) / 8, bob = k * 0.375;
    const Vec3 coat = kCoats[k % 4];
    const auto at = [&](double x, double y, double z) { return turn_y({2.05 + x, y, z}, turns); };
    const auto limb = [&](const Vec3& a, const Vec3& b, double r0, double r1, double cell,
                          const Vec3& c) { put_color(place_.tube(a, b, r0, r1, cell), c, bob); };
    const auto bulb = [&](const Vec3& center, const Vec3& radii, double cell, const Vec3& c) {
      Patch patch = place_.ball({0, 0, 0}, radii, cell);
      for (Dot& d : patch) {
        d.p = turn_y(d.p, turns) + center;
        d.u = turn_y(d.u, turns);
        d.v = turn_y(d.v, turns);
      }
      put_color(patch, c, bob);
    };
    put_color(place_.tube(at(0, 0.45, 0), at(0, 3.1, 0), 0.035, 0.035, 0.22), {0.75, 0.55, 0.18},
              -1, 0.6);
    bulb(at(0, 1.25, 0), {0.20, 0.22, 0.45}, 0.115, coat);
    limb(at(0, 1.32, -0.30), at(0, 1.72, -0.58), 0.15, 0.085, 0.105, coat);
    limb(at(0, 1.78, -0.52), at(0, 1.62, -0.84), 0.095, 0.055, 0.095, coat);
    limb(at(0, 1.40, -0.24), at(0, 1.82, -0.50), 0.05, 0.05, 0.11, kHair);
    limb(at(0, 1.30, 0.42), at(0, 0.95, 0.62), 0.07, 0.035, 0.08, kHair);
    constexpr double kLegs[4][3] = {
        {-0.11, -0.28, -0.22}, {0.11, -0.28, -0.05}, {-0.11, 0.30, 0.12}, {0.11, 0.30, 0.25}};
    for (const auto& leg : kLegs) {
      limb(at(leg[0], 1.15, leg[1]), at(leg[0], 0.66, leg[1] + leg[2]), 0.065, 0.035, 0.115, coat);
    }
    bulb(at(0, 1.41, 0.02), {0.215, 0.1, 0.17}, 0.1, kSaddles[k % 3]);
  }

  void light() {
    Light& light = place_.light;
    light.drum(kCenter, 2.75, 0, 0.42, {0.2, 0.18, 0.17});
    light.drum(kCenter, 2.95, 3.05, 3.2, {0.4, 0.2, 0.15}, 4.45);
    light.drum(kCenter, 0.55, 0.4, 3.1, {0.4, 0.3, 0.1});
    for (int k = 0; k < 8; ++k)
      light.lamps.push_back({kCenter + on_circle(k / 8.0, 2.4) + kUp * 2.7, 0.5, {}, false});
    for (int k = 0; k < 6; ++k)
      light.lamps.push_back({kCenter + on_circle(k / 6.0, 3.6) + kUp * 3.0, 0.32, {}, false});
  }

  void place_bodies() {
    const auto none = [](Dot&) {};
    for (size_t i = 0; i < body_.dots.size(); ++i) {
      const double bob = body_.bob[i];
      const auto pose = [&](Dot d, double t) {
        if (bob >= 0) d.p[1] += 0.14 * sin_turns(0.45 * t + bob);
        d.p = turn_y(d.p, kTurns * t) + kCenter;
        d.u = turn_y(d.u, kTurns * t);
        d.v = turn_y(d.v, kTurns * t);
        d.n = cross(d.u, d.v);
        return d;
      };
      if (place_.windows) {
        place_.chain_of_frames({body_.dots[i]}, kPiece, pose, none);
      } else if (place_.rigid) {
        place_.chain({body_.dots[i]}, kPiece, 0.53, pose, none);
      } else {
        place_.put({pose(body_.dots[i], 0)}, none);  // at rest
      }
    }
  }

  Place& place_;
  Body body_;
};

}  // namespace

void make_carousel(Place& place) { Carousel(place).make(); }

}  // namespace l4d::io::synth
