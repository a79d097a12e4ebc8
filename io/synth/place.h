// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string>

#include "io/synth/light.h"
#include "io/synth/place_cameras.h"
#include "io/synth/synth.h"

namespace l4d::io::synth {

// A place under construction: a square, a room. It is made several times, first to count its
// Gaussians at some density (then nothing is painted or lit) and then for good.
struct Place : Surfaces {
  bool is_static = true, rigid = true, deform = true, flicker = true, drops = true, view = true;
  bool windows = false;  // the pieces of the carousel have whole frames
  // `action` seconds of motion are spread over the sequence: each takes `stretch` seconds there.
  double begin = 0, action = 5, stretch = 1, fps = 30;
  uint32_t frames = 150;
  bool counting = false;
  uint64_t count = 0;
  std::vector<Dot> dots;
  Light light;
  Check check;

  // Adds the dots of a patch that stands still, after paint(dot) has given them colours.
  template <typename Paint>
  void put(const Patch& patch, const Paint& paint) {
    if (!is_static) return;
    put_always(patch, paint);
  }
  template <typename Paint>
  void put_always(const Patch& patch, const Paint& paint) {
    call(check);
    count += patch.size();
    if (counting) return;
    for (Dot d : patch) {
      paint(d);
      dots.push_back(d);
    }
  }
  void put(const Patch& patch, const Vec3& albedo) {
    put(patch, [&](Dot& d) { d.albedo = albedo; });
  }
  // A surface that moves: pose(dot, t) gives the dot at t seconds of the action. It becomes
  // straight pieces of `piece` seconds that overlap; each dot changes at instants of its own, so
  // a body never fades as a whole. sigma_t is `reach` of the piece.
  template <typename Pose, typename Paint>
  void chain(const Patch& patch, double piece, double reach, const Pose& pose, const Paint& paint) {
    call(check);
    for (const Dot& d : patch) {
      const double phase = random_at(4, d.p + Vec3{d.su, 0, 0});
      const int64_t last = static_cast<int64_t>(std::ceil(action / piece));
      for (int64_t k = -1; k <= last; ++k) {
        const double at = (static_cast<double>(k) + phase) * piece;
        if (at <= -1.3 * piece || at >= action + 1.3 * piece) continue;
        ++count;
        if (!counting) dots.push_back(moved(d, at, reach * piece, pose, paint));
      }
    }
  }
  // A chain whose pieces are there for whole frames, and do not fade.
  template <typename Pose, typename Paint>
  void chain_of_frames(const Patch& patch, double piece, const Pose& pose, const Paint& paint) {
    const uint32_t step =
        static_cast<uint32_t>(std::max(1.0, std::floor(piece * stretch * fps + 0.5)));
    for (const Dot& d : patch) {
      for (uint32_t first = 0; first < frames; first += step) {
        const uint32_t end = std::min(frames, first + step);
        ++count;
        if (counting) continue;
        const double middle = (first + end - 1) / (2 * fps);
        Dot m = moved(d, middle / stretch, (end - first) / (fps * stretch), pose, paint);
        m.window[0] = first;
        m.window[1] = end;
        dots.push_back(m);
      }
    }
  }
  // The dot with time, position and velocity of the sequence at second `at` of the action.
  template <typename Pose, typename Paint>
  Dot moved(const Dot& d, double at, double sigma, const Pose& pose, const Paint& paint) const {
    constexpr double kStep = 1e-3;
    // Times are stored as float32.
    const double t = static_cast<double>(static_cast<float>(begin + at * stretch));
    const double now = (t - begin) / stretch;
    Dot out = pose(d, now);
    out.n = cross(out.u, out.v);
    out.velocity = (pose(d, now + kStep).p - pose(d, now - kStep).p) * (0.5 / kStep / stretch);
    out.t = t;
    out.sigma_t = sigma * stretch;
    paint(out);
    return out;
  }
  // A dot that comes and goes, in seconds of the action.
  void flash(Dot d, double at, double sigma) {
    ++count;
    if (counting) return;
    d.t = static_cast<double>(static_cast<float>(begin + at * stretch));
    d.sigma_t = sigma;
    dots.push_back(d);
  }
  // Makes what stands still; where it is left out, coarsely, for the light that it gives or stops.
  template <typename Make>
  void still(const Make& make) {
    const double wanted = density;
    if (!is_static) density = 12;
    make();
    density = wanted;
  }
  // A luminous ball with two soft halos, which gives light.
  void lamp(const Vec3& at, double radius, double strength, bool shadows);
  // Of a count that grows with the detail.
  int64_t detailed(double number) const {
    return static_cast<int64_t>(number / (density * density));
  }
};

// A soft ball of light, which gives none.
Dot glow(const Vec3& at, double size, double opacity, const Vec3& light);

// What a place has of its own.
struct Design {
  double detailed;  // Gaussians of 5 seconds at density 1
  Vec3 low, high;   // bounds
  View first;
  void (*build)(Place&);
};
// Throws Error(L4D_ERR_INVALID_ARGUMENT) on effects that places lack, and where there is no detail
// for that many Gaussians.
Scene make_place(const Design& design, const SynthOptions& options);

void make_ground(Place& place);
void make_houses(Place& place, std::vector<Vec3>* chimneys);
void make_trees(Place& place);
void make_stalls(Place& place);
void make_surroundings(Place& place);
void make_lanterns(Place& place);
void make_fountain(Place& place);
void make_carousel(Place& place);
void make_flag(Place& place);
void make_smoke(Place& place, const std::vector<Vec3>& chimneys);
void make_juggler(Place& place);
void make_walkers(Place& place);
void make_gazing_ball(Place& place);

}  // namespace l4d::io::synth
