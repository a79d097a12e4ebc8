// SPDX-License-Identifier: Apache-2.0
#include "io/scene/scene.h"

#include <algorithm>
#include <cmath>

#include "io/scene/rotor_math.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

// Just beyond what float32 tells from 0 and 1, so that conversions there and back keep both.
constexpr double kMinLogit = -104;
constexpr double kMaxLogit = 18;

// Moves positions from one instant to another along the Gaussians' velocities. A Gaussian that does
// not move keeps its bits.
void shift_positions(Scene& scene, double direction) {
  for (size_t i = 0; i < scene.count(); ++i) {
    const double mean_t = scene.mean_time(i);
    const double dt = (reference_time(scene.timeline, mean_t) - mean_t) * direction;
    if (!(dt != 0)) continue;
    Rotor rotor;
    Vec4 scale;
    for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
    for (size_t k = 0; k < 4; ++k) {
      scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
    }
    const Vec3 velocity = velocity_of(rotor, scale);
    for (size_t k = 0; k < 3; ++k) {
      if (velocity[k] == 0) continue;
      float& x = scene.position[3 * i + k];
      x = static_cast<float>(static_cast<double>(x) + velocity[k] * dt);
    }
  }
}

}  // namespace

void Scene::set_mean_times(std::vector<double> times) {
  mean_t.resize(times.size());
  bool exact = true;
  for (size_t i = 0; i < times.size(); ++i) {
    mean_t[i] = static_cast<float>(times[i]);
    // Times that are no numbers stay so.
    exact = exact && !(static_cast<double>(mean_t[i]) != times[i] && std::isfinite(times[i]));
  }
  mean_t_double = exact ? std::vector<double>() : std::move(times);
}

void positions_to_reference_time(Scene& scene) {
  if ((scene.flags & L4D_POSITION_AT_MEAN_TIME) == 0) return;
  shift_positions(scene, 1);
  scene.flags &= ~static_cast<uint32_t>(L4D_POSITION_AT_MEAN_TIME);
}

void positions_to_mean_time(Scene& scene) {
  if ((scene.flags & L4D_POSITION_AT_MEAN_TIME) != 0) return;
  shift_positions(scene, -1);
  scene.flags |= L4D_POSITION_AT_MEAN_TIME;
}

void opacity_to_logit(Scene& scene) {
  if ((scene.flags & L4D_OPACITY_LOGIT) != 0) return;
  for (float& o : scene.opacity) o = static_cast<float>(logit(static_cast<double>(o)));
  scene.flags |= L4D_OPACITY_LOGIT;
}

double logit(double opacity) {
  if (opacity <= 0) return kMinLogit;
  if (opacity >= 1) return kMaxLogit;
  return std::clamp(std::log(opacity / (1 - opacity)), kMinLogit, kMaxLogit);
}

void set_fps(l4d_timeline& timeline, double fps) {
  if (!(fps > 0 && fps <= 1e6)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "a frame rate must be above 0 and at most 1000000");
  }
  // The NTSC family first: 29.97 means 30000/1001, not 2997/100.
  const double ntsc = std::round(fps * 1.001);
  if (fps != std::round(fps) && std::abs(fps * 1.001 - ntsc) <= 5e-6 * ntsc) {
    timeline.fps_num = static_cast<uint32_t>(ntsc) * 1000;
    timeline.fps_den = 1001;
    return;
  }
  // Continued fraction: the convergents are the simplest fractions for their accuracy.
  double x = fps;
  uint64_t num = 1, den = 0, last_num = 0, last_den = 1;
  for (int step = 0; step < 32; ++step) {
    const double whole = std::floor(x);
    if (whole > 4e9) break;
    const uint64_t next_num = static_cast<uint64_t>(whole) * num + last_num;
    const uint64_t next_den = static_cast<uint64_t>(whole) * den + last_den;
    if (next_num > UINT32_MAX || next_den > UINT32_MAX) break;
    last_num = num, last_den = den;
    num = next_num, den = next_den;
    const double error = static_cast<double>(num) / static_cast<double>(den) - fps;
    if (std::abs(error) <= 1e-12 * fps || x == whole) break;
    x = 1 / (x - whole);
  }
  timeline.fps_num = static_cast<uint32_t>(std::max<uint64_t>(num, 1));
  timeline.fps_den = static_cast<uint32_t>(den);
}

void set_duration(l4d_timeline& timeline, double seconds) {
  const double frames = std::round(seconds * static_cast<double>(timeline.fps_num) /
                                   static_cast<double>(timeline.fps_den));
  if (!(seconds > 0)) throw Error(L4D_ERR_INVALID_ARGUMENT, "a duration must be above 0 seconds");
  if (!(frames <= L4D_MAX_FRAMES)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "the sequence has more than 2^24 frames");
  }
  timeline.num_frames = static_cast<uint32_t>(std::max(frames, 1.0));
}

}  // namespace l4d::io
