// SPDX-License-Identifier: Apache-2.0
#include "io/formats/fdgs_born.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "io/scene/shape3.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io::fdgs {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
// Integers of positions, times and velocities stay below, so that differences fit as well.
constexpr double kMostBins = 1 << 30;
// An opacity that varies by less than this in the whole sequence is one that never fades.
constexpr double kFlat = 0.002;

double opacity_left(double time, const Born& g) {
  return falloff(1 / (g.sigma * g.sigma), time - g.time);
}

void move_to(double time, Born* g) {
  for (size_t k = 0; k < 3; ++k) g->position[k] += g->velocity[k] * (time - g->time);
  g->time = time;
}

// Shape, velocity and sigma, as the slices of the scene have them.
void set_shape(const Scene& scene, Born* g) {
  Rotor rotor;
  Vec4 scale;
  for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * g->row + k]);
  for (size_t k = 0; k < 4; ++k) {
    scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * g->row + k]));
  }
  if (rotor[4] == 0 && rotor[5] == 0 && rotor[6] == 0 && rotor[7] == 0) {
    const Rotor unit = quaternion_to_rotor({rotor[0], -rotor[3], rotor[2], -rotor[1]});
    g->wxyz = {unit[0], -unit[3], unit[2], -unit[1]};
    for (size_t k = 0; k < 3; ++k) {
      g->log_scale[k] = static_cast<double>(scene.log_scale[4 * g->row + k]);
    }
    g->sigma = scale[3];
    return;
  }
  const Slice at = slice(rotor, scale);
  const Shape3 shape = shape_of_rows(at.rows);
  g->wxyz = shape.wxyz;
  for (size_t k = 0; k < 3; ++k) g->log_scale[k] = std::log(std::max(shape.scale[k], 1e-30));
  g->velocity = at.velocity;
  g->sigma = at.sigma_t;
}

bool is_finite(const Born& g) {
  double sum = g.time + std::log(g.sigma);
  for (size_t k = 0; k < 3; ++k) sum += g.position[k] + g.velocity[k] + g.log_scale[k];
  for (const double q : g.wxyz) sum += q;
  return std::isfinite(sum);
}

// When a Gaussian that fades is seen; false if it never is.
bool set_fade(double seconds, Born* g) {
  const double least = std::min(opacity_left(0, *g), opacity_left(seconds, *g));
  if (least > 1 - kFlat) {
    g->sigma = kNever;
    g->end = seconds;
    move_to(seconds / 2, g);
    return true;
  }
  if (opacity_left(std::clamp(g->time, 0.0, seconds), *g) < kCutoff) return false;
  // A hundredth more for what sigma and time are rounded by.
  const double half = 1.01 * kVisibleSigmas * g->sigma + 1e-3;
  g->begin = std::max(g->time - half, 0.0);
  g->end = std::min(g->time + half, seconds);
  return true;
}

// The largest power of two that is not above it.
double power_below(double x) { return std::ldexp(1.0, std::ilogb(x)); }
double power_above(double x) { return x > power_below(x) ? 2 * power_below(x) : x; }

// A 256th of the median of sizes, unless that takes too many bins.
double position_step(const std::vector<Born>& gaussians, double extent) {
  std::vector<double> sizes;
  for (const Born& g : gaussians) {
    sizes.push_back(*std::max_element(g.log_scale.begin(), g.log_scale.end()));
  }
  const auto middle = sizes.begin() + static_cast<ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  const double size = std::clamp(std::exp(*middle), 1e-12, 1e12);
  const double fine = power_below(size / 256);
  return extent > 0 ? std::max(fine, power_above(extent / kMostBins)) : fine;
}

// So that no Gaussian is displaced by more than a position is rounded while it is seen.
double velocity_step(const std::vector<Born>& gaussians, double position) {
  Grids unit;
  unit.motion = 1;
  double step = position, least = 0;
  for (const Born& g : gaussians) {
    const double own = motion_step(unit, kCutoff, g.sigma, g.end - g.begin);
    const double span = std::max(std::fabs(g.begin - g.time), std::fabs(g.end - g.time));
    double speed = 0;
    for (const double v : g.velocity) speed = std::max(speed, std::fabs(v));
    if (speed == 0) continue;
    step = std::min(step, position / (span * own));
    least = std::max(least, speed / (own * kMostBins));
  }
  return std::max(step, least);
}

double birth_step(const std::vector<Born>& gaussians) {
  Grids grids;
  grids.time = 1.0 / 8192;
  const auto fits = [&](const Born& g) {
    return std::fabs(g.time) / time_step(grids, g.sigma) < kMostBins;
  };
  while (!std::all_of(gaussians.begin(), gaussians.end(), fits)) grids.time *= 2;
  return grids.time;
}

}  // namespace

BornScene born_scene(const Scene& scene, const std::string& path, WriteNotes* notes) {
  require_valid(scene, path);
  BornScene out;
  out.seconds = duration(scene.timeline);
  out.windows.push_back({0, out.seconds});
  const std::vector<double> positions = positions_at_mean_time(scene);
  const double frame = static_cast<double>(scene.timeline.fps_den) / scene.timeline.fps_num;
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> windows;
  uint64_t unseen = 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    Born g;
    g.row = i;
    for (size_t k = 0; k < 3; ++k) g.position[k] = positions[3 * i + k];
    g.time = scene.mean_time(i) - scene.timeline.time_begin;
    set_shape(scene, &g);
    if (!is_finite(g)) {
      throw Error(L4D_ERR_INVALID_SCENE,
                  path + ": a number of Gaussian " + std::to_string(i) + " is not finite");
    }
    if (!scene.window.empty() && scene.window[2 * i] < scene.window[2 * i + 1]) {
      const std::pair<uint32_t, uint32_t> frames(scene.window[2 * i], scene.window[2 * i + 1]);
      g.begin = frames.first * frame;
      g.end = frames.second * frame;
      g.sigma = kNever;
      move_to((g.begin + g.end) / 2, &g);
      const auto [known, is_new] =
          windows.emplace(frames, static_cast<uint32_t>(out.windows.size()));
      if (is_new) out.windows.push_back({g.begin, g.end});
      g.window = known->second;
    } else if (!set_fade(out.seconds, &g)) {
      ++unseen;
      continue;
    }
    out.gaussians.push_back(g);
  }
  if (unseen > 0) {
    notes->emplace("Gaussians that are not seen at any time of the sequence were left out", unseen);
  }
  return out;
}

Grids grids_of(const BornScene& scene) {
  Grids grids;
  grids.scale_log = grids.sigma_log = 1.0 / 128;
  grids.rotation = grids.opacity = 1.0 / 2048;
  grids.color = 1.0 / 512;
  grids.position = grids.motion = 1;
  grids.time = 1.0 / 8192;
  if (scene.gaussians.empty()) return grids;
  double extent = 0;
  for (size_t k = 0; k < 3; ++k) {
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (const Born& g : scene.gaussians) {
      low = std::min(low, g.position[k]);
      high = std::max(high, g.position[k]);
    }
    grids.origin[k] = low / 2 + high / 2;
    extent = std::max(extent, high - low);
  }
  grids.position = position_step(scene.gaussians, extent);
  grids.motion = velocity_step(scene.gaussians, grids.position);
  grids.time = birth_step(scene.gaussians);
  return grids;
}

}  // namespace l4d::io::fdgs
