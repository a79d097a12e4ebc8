// SPDX-License-Identifier: Apache-2.0
#include "io/scene/scene.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/scene/rotor_math.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

// Just beyond what float32 tells from 0 and 1, so that conversions there and back keep both.
constexpr double kMinLogit = -104;
constexpr double kMaxLogit = 18;

// Calls put(row, axis, coordinate) for each coordinate that another instant changes: that of the
// reference time (direction 1) or of the mean time (-1) in place of the other. A Gaussian that does
// not move keeps its bits.
template <typename Put>
void shift_positions(const Scene& scene, double direction, const Put& put) {
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
      put(i, k, static_cast<double>(scene.position[3 * i + k]) + velocity[k] * dt);
    }
  }
}

void round_shifted_positions(Scene& scene, double direction) {
  shift_positions(scene, direction, [&](size_t i, size_t k, double x) {
    scene.position[3 * i + k] = static_cast<float>(x);
  });
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
  round_shifted_positions(scene, 1);
  scene.flags &= ~static_cast<uint32_t>(L4D_POSITION_AT_MEAN_TIME);
}

void positions_to_mean_time(Scene& scene) {
  if ((scene.flags & L4D_POSITION_AT_MEAN_TIME) != 0) return;
  round_shifted_positions(scene, -1);
  scene.flags |= L4D_POSITION_AT_MEAN_TIME;
}

std::vector<double> positions_at_mean_time(const Scene& scene) {
  std::vector<double> positions(scene.position.begin(), scene.position.end());
  if ((scene.flags & L4D_POSITION_AT_MEAN_TIME) != 0) return positions;
  shift_positions(scene, -1, [&](size_t i, size_t k, double x) { positions[3 * i + k] = x; });
  return positions;
}

void opacity_to_logit(Scene& scene) {
  if ((scene.flags & L4D_OPACITY_LOGIT) != 0) return;
  for (float& o : scene.opacity) o = static_cast<float>(logit(static_cast<double>(o)));
  scene.flags |= L4D_OPACITY_LOGIT;
}

void require_valid(const Scene& scene, const std::string& path) {
  const l4d_gaussians gaussians = scene.view();
  for (size_t i = 0; i < scene.count(); ++i) {
    const char* const invalid = invalid_attribute(gaussians, i);
    if (invalid == nullptr) continue;
    throw Error(L4D_ERR_INVALID_SCENE, path + ": Gaussian " + std::to_string(i) +
                                           " has an invalid " + invalid +
                                           ": not finite, or too large");
  }
}

namespace {

// A grid on which both the origin and the positions less it are exact or nearly so, and no coarser
// than the scene is wide.
double rounded_origin(double low, double high) {
  const double middle = low / 2 + high / 2;
  const double half_extent = high / 2 - low / 2;
  // Within 8 half-extents float32 loses at most 3 of its 24 bits: not worth an origin.
  if (std::max(std::abs(low), std::abs(high)) <= 8 * half_extent) return 0;
  const double step = half_extent > 0 ? std::exp2(std::floor(std::log2(half_extent))) : 0;
  return step > 0 ? std::round(middle / step) * step : middle;
}

}  // namespace

void subtract_origin(const double* positions, size_t count, l4d_placement* placement, float* out) {
  for (size_t k = 0; k < 3; ++k) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (size_t i = k; i < 3 * count; i += 3) {
      if (!std::isfinite(positions[i])) continue;
      low = std::min(low, positions[i]);
      high = std::max(high, positions[i]);
    }
    const double origin = low <= high ? rounded_origin(low, high) : 0;
    for (size_t i = k; i < 3 * count; i += 3) out[i] = static_cast<float>(positions[i] - origin);
    placement->origin[k] += placement->scale * origin;
  }
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

namespace {

// The number at the end of a name, and the name without it; -1 if it ends in none.
std::pair<std::string, long> split_number(const std::string& name) {
  constexpr size_t kMostDigits = 9;
  size_t begin = name.size();
  while (begin > 0 && name[begin - 1] >= '0' && name[begin - 1] <= '9') --begin;
  const size_t digits = name.size() - begin;
  if (digits == 0 || digits > kMostDigits) return {name, -1};
  return {name.substr(0, begin), std::stol(name.substr(begin))};
}

}  // namespace

std::string zeros_note(size_t left_out, size_t rows) {
  return std::to_string(left_out) + " of " + std::to_string(rows) +
         " rows are nothing but zeros and were left out.";
}

std::string list_of_names(const std::vector<std::string>& names) {
  constexpr size_t kMost = 20;
  std::string text;
  size_t written = 0;
  for (size_t k = 0; k < names.size();) {
    if (written == kMost) return text + " and " + std::to_string(names.size() - k) + " more";
    const auto [stem, first] = split_number(names[k]);
    size_t end = k + 1;
    while (end < names.size() && first >= 0) {
      const auto next = split_number(names[end]);
      if (next.first != stem || next.second != first + static_cast<long>(end - k)) break;
      ++end;
    }
    if (end - k < 3) end = k + 1;
    text += (text.empty() ? "" : ", ") + names[k];
    if (end - k >= 3) text += " .. " + names[end - 1];
    ++written;
    k = end;
  }
  return text;
}

}  // namespace l4d::io
