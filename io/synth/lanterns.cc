// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

// A brighter core and halo for some frames, 3.5 times a second.
void flicker(Place& place, const Vec3& p, const Vec3& tint, int64_t number) {
  const double rate = 3.5 / place.density;
  const int64_t count = std::max<int64_t>(1, static_cast<int64_t>(rate * place.action));
  for (int64_t i = 0; i < count; ++i) {
    const auto hash = [&](int64_t k) { return place.random(121, number, i, k); };
    const double at =
        place.action * (static_cast<double>(i) + hash(0)) / static_cast<double>(count);
    const Vec3 off{hash(1) - 0.5, hash(2) - 0.5, hash(3) - 0.5};
    const double sigma = 0.016 + 0.05 * hash(1) * hash(1);
    const Vec3 light = mix(tint, Vec3{1, 0.8, 0.5}, 0.5) * 3;
    place.flash(glow(p + off * 0.03, 0.07, 0.7, light), at, sigma);
    place.flash(glow(p + off * 0.03, 0.24, 0.13, light), at, sigma);
  }
}

void lantern(Place& place, const Vec3& p, int64_t number) {
  constexpr Vec3 kTints[] = {{1.0, 0.50, 0.14}, {1.0, 0.34, 0.10}, {1.0, 0.62, 0.24}};
  const Vec3 tint = kTints[number % 3];
  place.still([&] {
    place.put(place.ball(p, {0.085, 0.11, 0.085}, 0.05), [&](Dot& d) {
      d.emit = tint * (1.25 - 0.75 * std::abs(d.b));
      d.kind = Kind::kUnshaded;
    });
    place.put({glow(p, 0.14, 0.15, tint * 1.5), glow(p + kUp * 1e-3, 0.34, 0.05, tint * 1.5)},
              [](Dot&) {});
  });
  if (!place.counting) place.light.lamps.push_back({p, 0.10, {}, false});
  if (place.flicker) flicker(place, p, tint, number);
}

struct Wire {
  Vec3 from, to;
  Vec3 at(double s) const {
    const Vec3 span = to - from;
    return from + span * s - kUp * (0.22 * length(span) * s * (1 - s));
  }
};

}  // namespace

void make_lanterns(Place& place) {
  const Wire wires[] = {{{-11.9, 5.3, -4.0}, {-6.4, 5.0, 7.2}},
                        {{-6.9, 5.6, -8.9}, {7.0, 5.0, 7.6}},
                        {{11.9, 5.3, -3.0}, {-6.4, 5.0, 7.2}},
                        {{-6.4, 5.0, 7.2}, {7.0, 5.0, 7.6}}};
  const Vec3 iron{0.04, 0.045, 0.05};
  if (place.is_static) {
    for (const Vec3& foot : {Vec3{-6.4, 0, 7.2}, Vec3{7.0, 0, 7.6}}) {
      place.put(place.tube(foot, foot + kUp * 5.05, 0.07, 0.05, 0.12), iron * 2);
    }
  }
  int64_t number = 0;
  for (const Wire& wire : wires) {
    const double long_ = length(wire.to - wire.from);
    const int64_t n = static_cast<int64_t>(long_ / (0.12 * std::max(1.0, place.density)));
    for (int64_t i = 0; i < n && place.is_static; ++i) {
      const double s = (static_cast<double>(i) + 0.5) / static_cast<double>(n);
      Dot d;
      d.p = wire.at(s);
      d.u = unit(wire.at(s + 1e-3) - wire.at(s - 1e-3));
      d.v = unit(cross(d.u, kUp));
      d.n = kUp;
      d.su = 0.67 * long_ / static_cast<double>(n);
      d.sv = 0.007;
      d.thin = 1;
      place.put({d}, Vec3{0.02, 0.02, 0.025});
    }
    const int64_t lanterns = static_cast<int64_t>(long_);
    for (int64_t k = 0; k < lanterns; ++k) {
      const double s = (static_cast<double>(k) + 0.5) / static_cast<double>(lanterns);
      lantern(place, wire.at(s) - kUp * 0.15, number++);
    }
  }
  if (!place.is_static) return;
  for (const Vec3& foot : {Vec3{-6.3, 0, 4.2}, Vec3{0.2, 0, -7.0}, Vec3{8.8, 0, -3.4}}) {
    place.put(place.tube(foot, foot + kUp * 3.2, 0.07, 0.045, 0.11), iron);
    place.put(place.tube(foot, foot + kUp * 0.5, 0.13, 0.08, 0.1), iron);
    place.lamp(foot + kUp * 3.4, 0.14, 3.4, true);
  }
}

}  // namespace l4d::io::synth
