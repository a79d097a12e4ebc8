// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "io/file/memory.h"
#include "io/synth/surface.h"

// Light of the place, baked into the colours of its Gaussians: lamps, and outdoors a low sun beyond
// a ridge and the sky.
namespace l4d::io::synth {

struct Plane {  // inside: n . p <= d
  Vec3 n;
  double d;
};
// What stops rays: a convex body of planes, or a ball where there are none.
struct Occluder {
  Vec3 center;
  double radius;  // of the ball around it
  std::vector<Plane> planes;
  Vec3 color{0.2, 0.18, 0.17};  // as mirrors see it
  double lets = 0;              // light that comes through
  Vec3 emit{};                  // as mirrors see it
};
constexpr Vec3 kLampColor{1.0, 0.56, 0.20};
struct Lamp {
  Vec3 at;
  double strength;
  Vec3 facing{};  // zero: to all sides
  bool shadows = false;
  Vec3 color = kLampColor;
  double radius = 0;  // 0: a point, with hard shadows
};

// What lights a place besides its lamps.
struct Ambience {
  bool outdoors = true;                                     // there are a sun and a sky
  Vec3 up{0.120, 0.165, 0.33}, bounce{0.06, 0.055, 0.065};  // from above, from below
  Vec3 glow{0.15, 0.075, 0.06};                             // from the sunset
  double reach = 3;  // metres in which things near a surface take ambient light from it
  double cell = 1;   // metres within which glossy Gaussians share what they mirror
};

struct Hit {
  double distance;  // infinite: none
  double lets;      // what comes through all that is hit
  const Occluder* what;
};

Vec3 sky(const Vec3& direction);

struct Light {
  Ambience ambience;
  std::vector<Occluder> occluders;
  std::vector<Lamp> lamps;

  void block(const Vec3& low, const Vec3& high);
  void ball(const Vec3& center, double radius, double lets, const Vec3& color);
  // A cylinder of 12 sides, or with a tip above y1, where tip > y1.
  void drum(const Vec3& center, double radius, double y0, double y1, const Vec3& color,
            double tip = 0);
  Hit cast(const Vec3& from, const Vec3& direction, double reach) const;
  // Linear light that leaves the Gaussian, other than what it mirrors.
  Vec3 shade(const Surfaces& hashes, const Dot& d) const;
  // Of chrome in a scene without view dependence: one colour by its normal.
  Vec3 plain_chrome(const Dot& d) const {
    return ambience.outdoors ? sky(d.n) * 0.7 : seen_indoors(d.p, d.n) * 0.7;
  }
  // Linear light that a mirrored ray brings.
  Vec3 seen_along(const Vec3& from, const Vec3& direction) const;

 private:
  Vec3 seen_indoors(const Vec3& from, const Vec3& direction) const;
};

Vec3 displayed(const Vec3& linear);    // 0..1
const Vec3& sunset();                  // unit vector towards it, level
const Vec3& sun();                     // unit vector towards the sun
constexpr Vec3 kLit{1.0, 0.50, 0.14};  // the colour of lamps, looked at

constexpr size_t kShCoefficients = 16;
// Coefficients of what the Gaussians show, [dots, 16, 3]: their light and, where they have a gloss,
// mirrors.
std::vector<float> mirror(const std::vector<Dot>& dots, const std::vector<Vec3>& linear,
                          const Light& light, int threads, const Check& check);

}  // namespace l4d::io::synth
