// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

constexpr double kWide = 2.6, kDeep = 1.7;
constexpr Vec3 kPlank{0.33, 0.20, 0.11}, kCloth{0.72, 0.68, 0.60};

class Stall {
 public:
  Stall(Place& place, const Vec3& at, double turns, const Vec3& stripe, int key)
      : place_(place),
        at_(at),
        ex_(turn_y({1, 0, 0}, turns)),
        out_(turn_y({0, 0, 1}, turns)),
        stripe_(stripe),
        key_(key) {}

  void make() {
    for (const double a : {-kWide / 2, kWide / 2}) {
      for (const double c : {-kDeep / 2, kDeep / 2}) {
        place_.put(place_.tube(at(a, 0, c), at(a, c < 0 ? 2.65 : 2.2, c), 0.045, 0.045, 0.12),
                   Vec3{0.20, 0.13, 0.08});
      }
    }
    awning();
    counter();
    if (!place_.counting) occlude();
    for (int k = 0; k < 5; ++k) crate(k);
    place_.lamp(at(0, 2.02, 0.1), 0.07, 1.9, true);
  }

 private:
  Vec3 at(double a, double b, double c) const { return at_ + ex_ * a + kUp * b + out_ * c; }

  void awning() {
    const auto cloth = [&](Dot& d) {
      d.albedo = static_cast<int>(d.a / 0.3) % 2 == 0 ? stripe_ : kCloth;
    };
    const Vec3 run = kUp * 0.62 - out_ * (kDeep + 0.5);
    const Vec3 corner = at(-kWide / 2 - 0.2, 2.12, kDeep / 2 + 0.35);
    place_.put(place_.rectangle(corner, ex_, unit(run), kWide + 0.4, length(run), 0.10, 0.08),
               cloth);
    const Patch flap =
        place_.rectangle(corner - kUp * 0.26, ex_, kUp, kWide + 0.4, 0.27, 0.10, 0.05);
    place_.put(kept(flap,
                    [](const Dot& d) {
                      const double x = 2 * (d.a / 0.3 - std::floor(d.a / 0.3)) - 1;
                      return d.b > 0.13 - 0.13 * std::sqrt(std::max(0.0, 1 - x * x));
                    }),
               cloth);
  }

  void counter() {
    place_.put(place_.rectangle(at(-kWide / 2, 0.92, kDeep / 2), ex_, out_ * -1, kWide, 0.9, 0.12),
               kPlank);
    place_.put(
        place_.rectangle(at(-kWide / 2, 0, kDeep / 2), ex_, kUp, kWide, 0.92, 0.11), [&](Dot& d) {
          d.albedo = kPlank * (0.6 + 0.5 * place_.random(61, key_, static_cast<int>(d.b / 0.18)));
        });
    for (const int s : {-1, 1}) {
      Patch side =
          place_.rectangle(at(s * kWide / 2, 0, kDeep / 2), out_ * -1, kUp, 0.9, 0.92, 0.14);
      if (dot(side.front().n, ex_) * s < 0) turn_over(side);
      place_.put(side, kPlank * 0.8);
    }
  }

  void occlude() {
    const auto body = [&](double low, double high, double front, double back, double half,
                          const Vec3& color) {
      Occluder o{at(0, (low + high) / 2, (front + back) / 2), 0, {}, color, 0};
      o.radius = length(Vec3{2 * half, high - low, front - back}) / 2;
      for (const auto& [n, p] :
           {std::pair{out_, at(0, 0, front)}, std::pair{out_ * -1, at(0, 0, back)},
            std::pair{ex_, at(half, 0, 0)}, std::pair{ex_ * -1, at(-half, 0, 0)},
            std::pair{kUp, at(0, high, 0)}, std::pair{kUp * -1, at(0, low, 0)}}) {
        o.planes.push_back({n, dot(n, p)});
      }
      return o;
    };
    place_.light.occluders.push_back(
        body(0, 0.92, kDeep / 2, kDeep / 2 - 0.9, kWide / 2, kPlank * 0.6));
    // The awning: what lies between two slanted planes.
    Occluder o =
        body(2.0, 2.9, kDeep / 2 + 0.35, -kDeep / 2 - 0.15, kWide / 2 + 0.2, stripe_ * 0.6);
    const Vec3 n = unit(out_ * 0.62 + kUp * (kDeep + 0.5));
    const double d = dot(n, at(0, 2.12, kDeep / 2 + 0.35));
    o.planes.push_back({n, d});
    o.planes.push_back({n * -1, 0.06 - d});
    place_.light.occluders.push_back(o);
  }

  void crate(int k) {
    constexpr Vec3 kGoods[] = {{0.75, 0.30, 0.04},
                               {0.62, 0.06, 0.04},
                               {0.25, 0.42, 0.06},
                               {0.78, 0.62, 0.10},
                               {0.30, 0.07, 0.22}};
    const Vec3 c = at(-kWide / 2 + 0.28 + 0.51 * k, 0.95, kDeep / 2 - 0.12);
    const Vec3 tilt = unit(kUp * 0.45 - out_);
    place_.put(place_.rectangle(c - ex_ * 0.23, ex_, tilt, 0.46, 0.6, 0.13), kPlank * 0.5);
    // Where all is coarse a crate has few fruits, and large ones.
    const int columns = place_.density > 1.5 ? 2 : 4, rows = place_.density > 1.5 ? 2 : 5;
    const double across = 0.45 / columns, along = 0.55 / rows, r = 0.51 * std::min(across, along);
    for (int i = 0; i < columns; ++i) {
      for (int j = 0; j < rows; ++j) {
        const double hash = place_.random(62, 8 * key_ + k, i, j);
        const Vec3 p = c + ex_ * (across * (i + 0.5) - 0.225 + 0.02 * (hash - 0.5)) +
                       tilt * (0.02 + along * (j + 0.5)) + kUp * r;
        const double size = r * (0.98 + 0.15 * hash);
        place_.put(place_.ball(p, {size, size, size}, 0.062), [&](Dot& d) {
          d.albedo = kGoods[(k + key_) % 5] * (0.75 + 0.5 * hash);
          d.thin = 0.4;
        });
      }
    }
  }

  Place& place_;
  const Vec3 at_, ex_, out_, stripe_;
  const int key_;
};

}  // namespace

void make_stalls(Place& place) {
  Stall(place, {-8.6, 0, 0.6}, 0.22, {0.62, 0.09, 0.07}, 1).make();
  Stall(place, {8.6, 0, 1.2}, -0.20, {0.10, 0.28, 0.42}, 2).make();
  Stall(place, {7.6, 0, 4.9}, -0.13, {0.16, 0.36, 0.16}, 3).make();
  Stall(place, {-8.3, 0, -3.4}, 0.20, {0.70, 0.42, 0.08}, 4).make();
}

void make_gazing_ball(Place& place) {
  const Vec3 at{2.5, 0, 3.4};
  Patch stone = place.box(at - Vec3{0.36, 0, 0.36}, at + Vec3{0.36, 0.16, 0.36}, 0.09);
  append(stone, place.tube(at + kUp * 0.16, at + kUp * 0.72, 0.22, 0.17, 0.08));
  append(stone, place.box(at + Vec3{-0.27, 0.72, -0.27}, at + Vec3{0.27, 0.82, 0.27}, 0.08));
  place.put(stone, [&](Dot& d) {
    d.albedo = Vec3{0.40, 0.37, 0.35} * (0.75 + 0.5 * place.noise(d.p, 0.2, 97));
  });
  const Vec3 center = at + kUp * 1.36;
  if (place.is_static || place.view) {
    place.put_always(place.ball(center, {0.55, 0.55, 0.55}, 0.036), [](Dot& d) {
      d.albedo = {0.02, 0.02, 0.02};
      d.kind = Kind::kChrome;
      d.gloss = 1;
      d.thin = 0.1;
    });
  }
  if (place.counting) return;
  place.light.ball(center, 0.54, 0, {0.2, 0.2, 0.22});
  place.light.block(at - Vec3{0.25, 0, 0.25}, at + Vec3{0.25, 0.82, 0.25});
}

}  // namespace l4d::io::synth
