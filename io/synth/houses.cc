// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

struct Plan {
  Vec3 corner, along;  // lower left corner of the front, and its direction
  double width, depth;
  int storeys;
  double ridge;
  Vec3 wall, roof, shutters;
  bool timber;
  int door;  // of three bays
  double cell;
};

constexpr double kWindow = 0.92, kWindowHigh = 1.32;

class House {
 public:
  House(Place& place, const Plan& plan, uint64_t key)
      : place_(place), plan_(plan), key_(key), out_(cross(plan.along, kUp)) {
    eave_ = 3.15 + 2.45 * (plan.storeys - 1);
    slope_ = (plan.ridge - eave_) / (plan.width / 2);
    door_ = plan.width * (plan.door + 0.5) / 3 - 0.55;
    middle_ = at(plan.width / 2, plan.ridge / 2, 0.0 - plan.depth / 2);
    find_openings();
  }

  void make() {
    if (!place_.counting) occlude();
    walls();
    for (size_t k = 0; k < windows_.size(); ++k) window(windows_[k], static_cast<int64_t>(k));
    make_door();
    if (plan_.timber) timber();
    for (const int side : {-1, 1}) roof(side);
    const Patch ridge =
        place_.tube(at(plan_.width / 2, plan_.ridge + 0.17, 0.35),
                    at(plan_.width / 2, plan_.ridge + 0.17, 0.0 - plan_.depth), 0.11, 0.11, 0.16);
    place_.put(ridge, plan_.roof * 0.8);
  }

  Vec3 chimney() {
    const Vec3 foot =
        at(plan_.width * 0.76, eave_ + plan_.width * 0.24 * slope_, -0.45 * plan_.depth);
    place_.put(place_.box(foot + Vec3{-0.33, -0.4, -0.33}, foot + Vec3{0.33, 1.25, 0.33}, 0.13),
               Vec3{0.30, 0.15, 0.10});
    return foot + kUp * 1.3;
  }

 private:
  struct Beam {
    double a, b, w, h;
  };

  Vec3 at(double a, double b, double out = 0) const {
    return plan_.corner + plan_.along * a + kUp * b + out_ * out;
  }
  Patch front(double a, double b, double w, double h, double out, double cell,
              double jitter = 0) const {
    return place_.rectangle(at(a, b, out), plan_.along, kUp, w, h, cell, jitter);
  }

  void find_openings() {
    for (int s = 0; s < plan_.storeys; ++s) {
      for (int k = 0; k < 3; ++k) {
        if (s == 0 && k == plan_.door) continue;
        const double low = s == 0 ? 0.95 : 3.85 + 2.45 * (s - 1);
        windows_.push_back({plan_.width * (k + 0.5) / 3 - kWindow / 2, low, kWindow, kWindowHigh});
      }
    }
    windows_.push_back({plan_.width / 2 - 0.35, eave_ + 0.45, 0.7, 0.95});  // of the attic
    for (const Beam& w : windows_) {
      holes_.push_back({w.a - 0.05, w.b - 0.05, w.a + w.w + 0.05, w.b + w.h + 0.05});
    }
    holes_.push_back({door_ - 0.05, 0, door_ + 1.15, 2.4});
    if (!plan_.timber) return;
    for (int s = 0; s <= plan_.storeys; ++s) {
      const double y = s < plan_.storeys ? 3.0 + 2.45 * s : eave_ + 1.75;
      const double half = y <= eave_ ? plan_.width / 2 : (plan_.ridge - y) / slope_;
      beams_.push_back({plan_.width / 2 - half, y - 0.1, 2 * half, 0.2});
    }
    for (int k = 0; k < 4; ++k) {
      const double a = clamp(plan_.width * k / 3, 0.1, plan_.width - 0.1);
      beams_.push_back({a - 0.09, 3.0, 0.18, eave_ - 3.0});
    }
    for (const Beam& b : beams_) {
      holes_.push_back({b.a - 0.06, b.b - 0.06, b.a + b.w + 0.06, b.b + b.h + 0.06});
    }
  }

  void occlude() {
    Occluder o{middle_, 0, {}, plan_.wall * 0.8, 0};
    o.radius = length(Vec3{plan_.width, plan_.ridge, plan_.depth}) / 2;
    const Vec3 e = plan_.along;
    const auto plane = [&](const Vec3& n, const Vec3& p) { o.planes.push_back({n, dot(n, p)}); };
    plane(out_, plan_.corner);
    plane(out_ * -1, plan_.corner - out_ * plan_.depth);
    plane(e * -1, plan_.corner);
    plane(e, plan_.corner + e * plan_.width);
    plane(unit(kUp - e * slope_), at(plan_.width / 2, plan_.ridge));
    plane(unit(kUp + e * slope_), at(plan_.width / 2, plan_.ridge));
    plane(kUp * -1, {0, 0, 0});
    place_.light.occluders.push_back(o);
  }

  void plaster(const Patch& patch) {
    place_.put(patch, [&](Dot& d) {
      const double blotches = 0.6 + 0.8 * place_.noise(d.p, 2.3, key_ + 1);
      const double damp = smooth(0, 1.6, d.p[1] + 0.5 * place_.noise(d.p, 0.8, key_ + 2));
      d.albedo = plan_.wall *
                 ((0.80 + 0.42 * place_.noise(d.p, 0.55, key_) * blotches) * mix(0.72, 1, damp));
    });
  }

  void walls() {
    const auto under_roof = [&](double start, double margin) {
      return [=](const Dot& d) {
        const double from_middle = std::abs(d.a + start - plan_.width / 2);
        return plan_.ridge - d.b - margin > from_middle * slope_;
      };
    };
    const Vec3 e = plan_.along, behind = out_ * -plan_.depth;
    const double w = plan_.width;
    plaster(kept(place_.rectangle(plan_.corner, e, kUp, w, plan_.ridge, plan_.cell, 0.3, holes_),
                 under_roof(0, 0)));
    // A coarse second sheet closes what gaps there are.
    plaster(kept(place_.rectangle(at(0.15, 0, -0.07), e, kUp, w - 0.3, plan_.ridge,
                                  2.3 * plan_.cell, 0.3, holes_),
                 under_roof(0.15, 0.35)));
    plaster(place_.rectangle(plan_.corner + behind, out_, kUp, plan_.depth, eave_, 0.24));
    plaster(place_.rectangle(at(w, 0), out_ * -1, kUp, plan_.depth, eave_, 0.24));
    plaster(kept(place_.rectangle(at(w, 0) + behind, e * -1, kUp, w, plan_.ridge, 0.26),
                 under_roof(0, 0)));
    const Patch plinth = place_.rectangle(at(-0.03, 0, 0.05), e, kUp, w + 0.06, 0.42, 0.11, 0.3,
                                          {{door_, 0, door_ + 1.1, 2.35}});
    place_.put(plinth, [&](Dot& d) {
      const double stone = place_.random(41, static_cast<int64_t>(std::floor(d.a / 0.45)),
                                         static_cast<int64_t>(std::floor(d.b / 0.21)));
      d.albedo = Vec3{0.24, 0.22, 0.21} * (0.7 + 0.6 * stone);
    });
  }

  void window(const Beam& w, int64_t k) {
    const bool dark = place_.random(32, static_cast<int64_t>(key_), k) < 0.28;
    const double hash = place_.random(34, static_cast<int64_t>(key_), k);
    const double lit = dark ? 0 : 0.50 + 0.55 * hash;
    const Vec3 warm = mix(Vec3{1, 0.56, 0.17}, Vec3{1, 0.43, 0.10}, hash);
    place_.put(front(w.a, w.b, w.w, w.h, -0.04, 0.10, 0.1), [&](Dot& d) {
      const double curtain = smooth(0.16, 0.30, std::abs(d.a / w.w - 0.5));
      d.albedo = {0.02, 0.025, 0.035};
      d.emit =
          warm * (lit * (1.20 - 0.70 * d.b / w.h) * (1 - 0.5 * curtain)) + Vec3{0.012, 0.016, 0.03};
      d.gloss = 0.5;
    });
    frame(w);
    const bool shutters = !plan_.timber && w.w == kWindow;
    for (const double a : {w.a - 0.52, w.a + w.w + 0.09}) {
      if (!shutters) break;
      place_.put(front(a, w.b - 0.03, 0.43, w.h + 0.06, 0.05, 0.11, 0.05), [&](Dot& d) {
        const bool light = static_cast<int>(d.b / 0.23) % 2 == 1;
        d.albedo = plan_.shutters * (light ? 1.07 : 0.82);
      });
    }
    if (place_.random(33, static_cast<int64_t>(key_), k) < 0.45) flowers(w, k);
    if (lit > 0.3 && !place_.counting) {
      place_.light.lamps.push_back(
          {at(w.a + w.w / 2, w.b + w.h / 2, 0.3), 0.36 * lit, out_, false});
    }
  }

  void frame(const Beam& w) {
    constexpr double t = 0.07;
    constexpr Vec3 kWood{0.62, 0.58, 0.50};
    const Beam bars[] = {{w.a - t, w.b - t, w.w + 2 * t, t},
                         {w.a - t, w.b + w.h, w.w + 2 * t, t},
                         {w.a - t, w.b, t, w.h},
                         {w.a + w.w, w.b, t, w.h},
                         {w.a + w.w / 2 - 0.025, w.b, 0.05, w.h},
                         {w.a, w.b + w.h * 0.62, w.w, 0.045}};
    for (const Beam& bar : bars) place_.put(front(bar.a, bar.b, bar.w, bar.h, 0.03, 0.13), kWood);
    place_.put(front(w.a - 0.12, w.b - t - 0.05, w.w + 0.24, 0.07, 0.14, 0.12), kWood * 0.9);
    place_.put(place_.rectangle(at(w.a - 0.12, w.b - t + 0.02, 0.16), plan_.along, out_ * -1,
                                w.w + 0.24, 0.14, 0.12, 0),
               kWood);
  }

  void flowers(const Beam& w, int64_t k) {
    const int64_t count = std::max<int64_t>(8, place_.detailed(70));
    const double size = 0.035 * std::sqrt(70.0 / static_cast<double>(count));
    constexpr Vec3 kBlossoms[] = {{0.75, 0.10, 0.12}, {0.85, 0.35, 0.45}, {0.85, 0.65, 0.2}};
    const uint64_t key = 3500 + 100 * key_ + static_cast<uint64_t>(k);
    Patch patch;
    for (int64_t i = 0; i < count; ++i) {
      const Vec3 p = at(w.a - 0.1 + place_.random(key, i, 10) * (w.w + 0.2),
                        w.b - 0.08 + (place_.random(key, i, 11) - 0.3) * 0.2,
                        0.24 + (place_.random(key, i, 12) - 0.5) * 0.18);
      Dot d = place_.leaf(p, out_ + kUp, size, key, i);
      d.n = unit(out_ + kUp);
      d.thin = 0.5;
      const double which = place_.random(key, i, 13);
      d.albedo = which < 0.5 ? Vec3{0.10, 0.25, 0.06} : kBlossoms[static_cast<int>(which * 96) % 3];
      patch.push_back(d);
    }
    place_.put(patch, [](Dot&) {});
  }

  void make_door() {
    const Vec3 wood = plan_.timber ? Vec3{0.25, 0.12, 0.06} : plan_.shutters;
    for (int k = 0; k < 6; ++k) {
      const Patch plank = front(door_ + k * 1.1 / 6, 0, 1.1 / 6 - 0.008, 2.35, -0.015, 0.11, 0.05);
      place_.put(plank, wood * (0.62 + 0.4 * place_.random(42, static_cast<int64_t>(key_), k)));
    }
    for (const Beam& b : {Beam{door_ - 0.1, 0, 0.1, 2.45}, Beam{door_ + 1.1, 0, 0.1, 2.45},
                          Beam{door_, 2.35, 1.1, 0.1}}) {
      place_.put(front(b.a, b.b, b.w, b.h, 0.06, 0.12), Vec3{0.45, 0.42, 0.38});
    }
    const Vec3 c0 = at(door_ - 0.2, 0, 0), c1 = at(door_ + 1.3, 0.14, 0.5);
    Vec3 low, high;
    for (size_t k = 0; k < 3; ++k) {
      low[k] = std::min(c0[k], c1[k]);
      high[k] = std::max(c0[k], c1[k]);
    }
    place_.put(place_.box(low, high, 0.14), Vec3{0.30, 0.28, 0.27});
    place_.lamp(at(door_ + 0.55, 2.75, 0.35), 0.075, 0.55, false);
  }

  void timber() {
    constexpr Vec3 kOak{0.10, 0.058, 0.035};
    for (const Beam& b : beams_) place_.put(front(b.a, b.b, b.w, b.h, 0.05, 0.12, 0.05), kOak);
    for (const int side : {-1, 1}) {
      const double w = plan_.width;
      const Vec3 a = at(w / 2 - side * w * 0.30, eave_, 0.045);
      const Vec3 along = at(w / 2 - side * w * 0.10, eave_ + 1.7, 0.045) - a;
      const Vec3 ev = unit(along);
      place_.put(place_.rectangle(a, cross(ev, out_), ev, 0.16, length(along), 0.12, 0.1), kOak);
    }
  }

  void outwards(Patch& patch) {
    if (dot(patch.front().n, patch.front().p - middle_) < 0) turn_over(patch);
  }

  void roof(int side) {
    const double reach = plan_.width / 2 + 0.35;
    const double long_ = length(Vec3{reach, reach * slope_, 0});
    const Vec3 up = unit(kUp * slope_ - plan_.along * side);
    const Vec3 start = at(plan_.width / 2 + side * reach, eave_ - 0.35 * slope_ + 0.12, 0.35);
    Patch tiles = place_.rectangle(start, out_ * -1, up, plan_.depth + 0.35, long_, 0.135, 0.12);
    outwards(tiles);
    place_.put(tiles, [&](Dot& d) {
      const double row = std::floor(d.b / 0.27);
      const int64_t r = static_cast<int64_t>(row);
      const int64_t column =
          static_cast<int64_t>(std::floor(d.a / 0.25 + 0.5 * static_cast<double>(r % 2)));
      const double tile = place_.random(43 + key_, r, column, side);
      const bool low_edge = d.b / 0.27 - row < 0.28;
      d.albedo = plan_.roof * ((0.62 + 0.62 * tile) * (low_edge ? 0.62 : 1.08) *
                               (0.75 + 0.5 * place_.noise(d.p, 1.5, key_ + 5)));
      d.gloss = 0.15;
    });
    Patch board = place_.rectangle(start + out_ * 0.02 - kUp * 0.22, cross(up, out_) * -side, up,
                                   0.22, long_, 0.13, 0);
    outwards(board);
    place_.put(board, plan_.timber ? Vec3{0.16, 0.09, 0.05} : Vec3{0.50, 0.46, 0.40});
  }

  Place& place_;
  const Plan plan_;
  const uint64_t key_;
  Vec3 out_, middle_;
  double eave_, slope_, door_;
  std::vector<Beam> windows_, beams_;
  std::vector<Opening> holes_;
};

constexpr Vec3 kRed{0.40, 0.135, 0.075}, kBrown{0.30, 0.125, 0.075}, kSlate{0.16, 0.165, 0.20};
constexpr Vec3 kEast{1, 0, 0}, kSouth{0, 0, 1}, kNorth{0, 0, -1}, kCream{0.62, 0.58, 0.50};
const Plan kPlans[] = {
    {{-12.2, 0, -9},
     kEast,
     6.0,
     7.5,
     2,
     9.2,
     {0.62, 0.40, 0.20},
     kRed,
     {0.10, 0.22, 0.16},
     false,
     2,
     0.105},
    {{-6.0, 0, -9}, kEast, 5.6, 7.5, 3, 11.4, {0.54, 0.48, 0.39}, kBrown, kCream, true, 1, 0.105},
    {{-0.2, 0, -9}, kEast, 6.4, 7.5, 2, 9.6, {0.50, 0.23, 0.16}, kSlate, kCream, false, 1, 0.105},
    {{6.4, 0, -9},
     kEast,
     5.8,
     7.5,
     3,
     10.9,
     {0.30, 0.40, 0.46},
     kRed,
     {0.58, 0.30, 0.10},
     false,
     0,
     0.105},
    {{-12.2, 0, -2.0}, kNorth, 6.0, 7.0, 2, 8.8, {0.58, 0.48, 0.42}, kRed, kCream, true, 1, 0.12},
    {{12.4, 0, -8.6},
     kSouth,
     6.2,
     7.0,
     2,
     9.0,
     {0.62, 0.50, 0.24},
     kBrown,
     {0.12, 0.18, 0.30},
     false,
     1,
     0.12},
    {{12.4, 0, -2.0},
     kSouth,
     5.6,
     7.0,
     3,
     10.8,
     {0.60, 0.36, 0.30},
     kSlate,
     kCream,
     false,
     2,
     0.12}};

}  // namespace

void make_houses(Place& place, std::vector<Vec3>* chimneys) {
  uint64_t key = 200;
  for (const Plan& plan : kPlans) {
    House house(place, plan, key);
    house.make();
    chimneys->push_back(house.chimney());
    key += 10;
  }
}

}  // namespace l4d::io::synth
