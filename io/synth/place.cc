// SPDX-License-Identifier: Apache-2.0
#include "io/synth/place.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {

const std::array<const char*, 7> kPlaceEffects = {"static", "rigid", "deform", "flicker",
                                                  "drops",  "view",  "frames"};

namespace synth {
namespace {

void choose_effects(const std::vector<std::string>& names, Place& place) {
  bool* const on[] = {&place.is_static, &place.rigid, &place.deform, &place.flicker,
                      &place.drops,     &place.view,  &place.windows};
  for (bool* effect : on) *effect = names.empty() && effect != &place.windows;
  for (const std::string& name : names) {
    const auto found = std::find(kPlaceEffects.begin(), kPlaceEffects.end(), name);
    if (found == kPlaceEffects.end()) {
      throw Error(L4D_ERR_INVALID_ARGUMENT, "unknown effect " + name);
    }
    *on[found - kPlaceEffects.begin()] = true;
  }
}

void build(const Design& design, Place& place) {
  place.count = 0;
  place.dots.clear();
  place.light = {};
  design.build(place);
}

// The density with just more Gaussians than are asked for.
void choose_density(const Design& design, Place& place, uint64_t gaussians) {
  place.counting = true;
  const double wanted = static_cast<double>(gaussians);
  place.density = std::sqrt(design.detailed / wanted);
  double coarse = 0, fine = 0;  // largest that has enough, smallest that has not
  for (int step = 0; step < 10; ++step) {
    build(design, place);
    const double ratio = static_cast<double>(place.count) / wanted;
    (ratio >= 1 ? coarse : fine) = place.density;
    if (ratio >= 1 && ratio < 1.004) break;
    double next = place.density * std::sqrt(ratio / 1.002);
    if (coarse > 0 && fine > 0 &&
        !(next > std::min(coarse, fine) && next < std::max(coarse, fine))) {
      next = (coarse + fine) / 2;
    }
    place.density = clamp(next, 0.02, 12);
  }
  if (coarse == 0) {  // never enough
    for (place.density = fine; place.count < gaussians && place.density > 1e-3;
         build(design, place))
      place.density *= 0.8;
    coarse = place.density;
  }
  place.density = coarse;
  place.counting = false;
}

// Exactly as many as asked for, the others evenly left out; those that stay grow to fill the gaps.
void thin_out(std::vector<Dot>& dots, uint64_t gaussians) {
  const uint64_t all = dots.size();
  if (all <= gaussians) return;
  const double grow = std::sqrt(static_cast<double>(all) / static_cast<double>(gaussians));
  size_t at = 0;
  for (uint64_t i = 0; i < all; ++i) {
    if ((i + 1) * gaussians / all == i * gaussians / all) continue;
    Dot d = dots[i];
    d.su *= grow;
    d.sv *= grow;
    dots[at++] = d;
  }
  dots.resize(at);
}

void pack(const Dot& d, const l4d_timeline& timeline, size_t i, Scene& scene) {
  const Vec3 w = cross(d.u, d.v);
  const Vec3 size{d.su, d.sv, std::max(std::min(d.su, d.sv) * d.thin, 2e-4)};
  const Matrix3 r{d.u[0], d.v[0], w[0], d.u[1], d.v[1], w[1], d.u[2], d.v[2], w[2]};
  const bool still = d.sigma_t == 0;
  const double sigma_t = still ? 16.01 * duration(timeline) : d.sigma_t;
  Rotor rotor = quaternion_to_rotor(matrix_to_quaternion(r));
  Vec4 scale{size[0], size[1], size[2], sigma_t};
  if (d.velocity != Vec3{0, 0, 0}) {
    const Shape4 moving = shape_of_moving(r, size, d.velocity, sigma_t);
    rotor = moving.rotor;
    scale = moving.scale;
  }
  for (size_t k = 0; k < 3; ++k) scene.position[3 * i + k] = static_cast<float>(d.p[k]);
  for (size_t k = 0; k < 8; ++k) scene.rotor[8 * i + k] = static_cast<float>(rotor[k]);
  for (size_t k = 0; k < 4; ++k) scene.log_scale[4 * i + k] = static_cast<float>(log(scale[k]));
  const double middle = timeline.time_begin + duration(timeline) / 2;
  scene.mean_t[i] = static_cast<float>(still ? middle : d.t);
  scene.opacity[i] = static_cast<float>(log(d.opacity / (1 - d.opacity)));
  if (!scene.window.empty()) std::copy_n(d.window, 2, &scene.window[2 * i]);
}

void state_first_view(const Design& design, Scene& scene) {
  l4d_presentation& p = scene.presentation;
  p.has_bounds = p.has_camera = 1;
  std::copy_n(design.low.begin(), 3, p.bounds_min);
  std::copy_n(design.high.begin(), 3, p.bounds_max);
  std::copy_n(design.first.eye.begin(), 3, p.camera_position);
  std::copy_n(design.first.target.begin(), 3, p.camera_target);
  std::copy_n(kUp.begin(), 3, p.camera_up);
  p.camera_fov = design.first.degrees * kTurn / 360;
  p.metres_per_unit = 1;
}

void light_up(const Place& place, int threads, Scene& scene) {
  const std::vector<Dot>& dots = place.dots;
  std::vector<Vec3> linear(dots.size());
  parallel_for(threads, dots.size(), 1024, [&](size_t begin, size_t end) {
    call(place.check);
    for (size_t i = begin; i < end; ++i) {
      const bool plain = dots[i].kind == Kind::kChrome && !place.view;
      linear[i] = plain ? place.light.plain_chrome(dots[i]) : place.light.shade(place, dots[i]);
    }
  });
  if (place.view) {
    scene.sh = mirror(dots, linear, place.light, threads, place.check);
    return;
  }
  for (size_t i = 0; i < dots.size(); ++i) {
    const Vec3 shown = displayed(linear[i]);
    for (size_t c = 0; c < 3; ++c) {
      scene.sh[3 * i + c] = static_cast<float>((shown[c] - 0.5) / sh_constant::k0);
    }
  }
}

}  // namespace

Dot glow(const Vec3& at, double size, double opacity, const Vec3& light) {
  Dot d;
  d.p = at;
  d.n = {0, 0, 1};
  d.su = d.sv = size;
  d.emit = light;
  d.opacity = opacity;
  d.thin = 1;
  d.kind = Kind::kUnshaded;
  return d;
}

void Place::lamp(const Vec3& at, double radius, double strength, bool shadows) {
  if (!counting) light.lamps.push_back({at, strength, {}, shadows});
  put(ball(at, {radius, radius, radius}, std::max(0.75 * radius, 0.75 * radius / density)),
      [](Dot& d) {
        d.emit = kLit * 3.4;
        d.kind = Kind::kUnshaded;
        d.thin = 0.5;
      });
  put({glow(at, 1.7 * radius, 0.30, kLit * 1.6),
       glow(at + kUp * 1e-3, 3.2 * radius, 0.11, kLit * 1.6)},
      [](Dot&) {});
}

Scene make_place(const Design& design, const SynthOptions& options) {
  Scene scene;
  scene.source = "synth";
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  scene.placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
  set_fps(scene.timeline, options.fps);
  set_duration(scene.timeline, options.seconds);
  state_first_view(design, scene);

  Place place;
  place.seed = options.seed;
  place.check = options.check;
  choose_effects(options.effects, place);
  const double seconds = duration(scene.timeline), n = static_cast<double>(options.gaussians);
  place.begin = scene.timeline.time_begin;
  place.action = std::min(seconds, 20 * std::max(1.0, n / design.detailed));
  place.stretch = seconds / place.action;
  place.frames = scene.timeline.num_frames;
  place.fps = place.frames / seconds;
  choose_density(design, place, options.gaussians);
  build(design, place);
  thin_out(place.dots, options.gaussians);
  if (place.dots.size() != options.gaussians) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "the " + options.scene + " has no detail for that many Gaussians: at most " +
                    std::to_string(place.dots.size()) + " with these effects");
  }
  scene.sh_degree = place.view ? 3 : 0;
  scene.resize(place.dots.size());
  if (place.windows) scene.window.resize(2 * scene.count());
  parallel_for(options.threads, place.dots.size(), 4096, [&](size_t begin, size_t end) {
    call(place.check);
    for (size_t i = begin; i < end; ++i) pack(place.dots[i], scene.timeline, i, scene);
  });
  light_up(place, options.threads, scene);
  return scene;
}

}  // namespace synth
}  // namespace l4d::io
