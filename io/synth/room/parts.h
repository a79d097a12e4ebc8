// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "io/synth/place.h"

// Things of the living room and what they share. x points right, y up, z to the first view; metres.
namespace l4d::io::synth {

constexpr Vec3 kRoomLow{-3.4, 0, -2.8}, kRoomHigh{3.4, 2.8, 3.2};
constexpr Vec3 kRight{1, 0, 0}, kFront{0, 0, 1};

struct Span {  // of a window or of what hides a wall: the lower and the upper end
  double z0, z1, y0, y1;
};
constexpr Span kWindow{-1.0, 1.2, 1.06, 2.36};  // in the west wall
constexpr double kRugX0 = -1.75, kRugX1 = 1.45, kRugZ0 = -0.62, kRugZ1 = 1.62;
constexpr Vec3 kFirePlace{0.2, 0, -2.35};  // the middle of the hearth's front

constexpr Vec3 kOak{0.27, 0.145, 0.065}, kWalnut{0.13, 0.068, 0.036}, kBrass{0.62, 0.42, 0.13};
constexpr Vec3 kWhitePaint{0.60, 0.57, 0.50};
constexpr Vec3 kWarm{1.0, 0.66, 0.36}, kFire{1.0, 0.46, 0.15}, kDusk{0.30, 0.45, 0.95};  // light

// Where a thing stands that is made about the origin, looking along z: turned about the vertical
// from z towards x.
class Stand {
 public:
  Stand(const Vec3& at, double turns) : at_(at), turns_(turns) {}

  Vec3 way(const Vec3& v) const { return turn_y(v, turns_); }
  Vec3 operator()(const Vec3& p) const { return at_ + way(p); }
  Dot moved(Dot d) const {
    d.p = (*this)(d.p);
    d.u = way(d.u);
    d.v = way(d.v);
    d.n = way(d.n);
    return d;
  }
  Patch operator()(Patch patch) const {
    for (Dot& d : patch) d = moved(d);
    return patch;
  }

 private:
  Vec3 at_;
  double turns_;
};

inline double radius_of(double x, double y) { return std::sqrt(x * x + y * y); }

// How many of what comes and goes: a finer scene has more, but not as many as of cells.
inline int64_t few(const Place& place, double number) {
  return static_cast<int64_t>(number / (place.density * std::max(place.density, 1.0)));
}
// A rectangle whose silhouette stays sharp where a single Gaussian spans it.
Patch slab(const Surfaces& make, const Vec3& o, const Vec3& eu, const Vec3& ev, double w, double h,
           double cell, double jitter = 0);
// A rectangle of Gaussians that are `longer` times as long along ev.
Patch threads(const Surfaces& make, const Vec3& o, const Vec3& eu, const Vec3& ev, double w,
              double h, double cell, double longer);
// A box with its bottom.
Patch crate(const Surfaces& make, const Vec3& low, const Vec3& high, double cell);
// Stops light where a box stands.
void solid(Place& place, const Stand& stand, const Vec3& low, const Vec3& high, const Vec3& color);
// Wood with its grain along x, y or z (0, 1, 2).
Vec3 wood(const Surfaces& make, const Vec3& p, const Vec3& color, size_t grain, uint64_t key);
// A patch of wood that stands still.
void put_wood(Place& place, const Patch& patch, const Vec3& color, size_t grain, uint64_t key,
              double gloss = 0.25);
// A box of wood that also stops light.
void plank(Place& place, const Stand& stand, const Vec3& low, const Vec3& high, double cell,
           const Vec3& color, size_t grain, uint64_t key, double gloss = 0.25);
// A surface of revolution about the vertical through `foot`, by its radii at heights.
Patch turned(const Surfaces& make, const Vec3& foot,
             const std::vector<std::array<double, 2>>& rings, double cell);
// The thickness of thin things, so that no side of them shows through the other.
Patch with_thickness(Patch patch, double thin);

void make_shell(Place& place);  // floor, ceiling, door, and for light the hull
void make_walls(Place& place);
void make_window(Place& place);  // with dusk, rain and curtains
void make_hearth(Place& place);  // with fire, sparks and candles
void make_shelves(Place& place);
void make_pictures(Place& place);
void make_rug(Place& place);
void make_table(Place& place);  // with a mirror ball and a cup of tea
// A lampshade of cloth with a bulb in it, which gives no light.
void make_shade(Place& place, const Vec3& low, const Vec3& high, double r0, double r1);
void make_armchair(Place& place);  // with a lamp beside it
void make_desk(Place& place);
void make_plants(Place& place);  // and the sideboard
void make_clock(Place& place);
void make_fan(Place& place);
void make_rocker(Place& place);  // with a reader in it
void make_cat(Place& place);

}  // namespace l4d::io::synth
