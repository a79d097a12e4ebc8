// SPDX-License-Identifier: Apache-2.0
#include "training/init/start.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "libl4dcodec/scene/sh.h"
#include "training/model/neighbours.h"
#include "training/model/random.h"
#include "training/step/schedule.h"

namespace l4d::train {
namespace {

constexpr float kStartOpacity = 0.1f;
constexpr float kDc = static_cast<float>(sh_constant::k0);
constexpr double kMinScale = 1e-4, kMaxScale = 0.05;  // of the radius
// Points farther from the cameras than so many radii, as of the sky, may be larger in proportion.
constexpr double kFar = 2;
constexpr size_t kCloud = 20;                                  // points that say where things are
constexpr float kSpatialNoise = 0.1f, kTemporalNoise = 1e-3f;  // of rotors

// Uniform in the ball of radius 1 (shell: between radii `low` and `high`).
void random_direction(const Random4& r, double* out) {
  const double z = 2 * static_cast<double>(uniform(r.v[0])) - 1;
  const double angle = 6.283185307179586 * static_cast<double>(uniform(r.v[1]));
  const double ring = std::sqrt(std::max(0.0, 1 - z * z));
  out[0] = ring * std::cos(angle);
  out[1] = ring * std::sin(angle);
  out[2] = z;
}

bool third_sees(const Capture& capture, const float* p) {
  size_t seen = 0;
  for (const CaptureCamera& camera : capture.cameras) {
    seen += sees(camera.source.camera, p) ? 1U : 0U;
  }
  return 3 * seen >= capture.cameras.size();
}

}  // namespace

bool sees(const l4d_camera& camera, const float* p) {
  double view[3];
  for (size_t r = 0; r < 3; ++r) {
    const double* m = camera.world_to_camera + 4 * r;
    view[r] = m[0] * static_cast<double>(p[0]) + m[1] * static_cast<double>(p[1]) +
              m[2] * static_cast<double>(p[2]) + m[3];
  }
  if (view[2] <= camera.near_plane) return false;
  const double x = camera.fx * view[0] / view[2] + camera.cx;
  const double y = camera.fy * view[1] / view[2] + camera.cy;
  return x >= 0 && y >= 0 && x < camera.width && y < camera.height;
}

std::vector<Point> random_points(const Capture& capture, uint64_t count, uint64_t seed) {
  const CaptureFrame frame = frame_of(capture);
  std::vector<Point> points;
  points.reserve(static_cast<size_t>(count));
  // Where few places are seen by a third of the cameras, the condition is dropped in the end.
  const uint64_t tries = 200 * count + 1000;
  for (uint64_t k = 0; points.size() < count; ++k) {
    const Random4 r = philox(seed, 0, k, Use::kStart);
    const Random4 s = philox(seed, 1, k, Use::kStart);
    double direction[3];
    random_direction(r, direction);
    const bool shell = points.size() % 2 == 1;
    const double u = static_cast<double>(uniform(r.v[2]));
    const double radius =
        frame.radius * (shell ? std::cbrt(0.729 + u * (3.375 - 0.729)) : std::cbrt(u));
    Point p{};
    for (size_t c = 0; c < 3; ++c) {
      p.position[c] = static_cast<float>(frame.center[c] + radius * direction[c]);
      p.rgb[c] = uniform(s.v[c]);
    }
    if (!shell && k < tries && !third_sees(capture, p.position)) continue;
    points.push_back(p);
  }
  return points;
}

uint64_t fill_up(const Capture& capture, uint64_t count, uint64_t seed,
                 std::vector<Point>* points) {
  const uint64_t wanted = (count + 1) / 2;
  if (points->size() >= wanted) return 0;
  const uint64_t added = wanted - points->size();
  if (points->size() < kCloud) {
    const std::vector<Point> random = random_points(capture, added, seed);
    points->insert(points->end(), random.begin(), random.end());
    return added;
  }
  std::vector<float> positions;
  for (const Point& p : *points) positions.insert(positions.end(), p.position, p.position + 3);
  const std::vector<float> apart = neighbour_distance(positions, 1);
  const auto found = static_cast<uint32_t>(points->size());
  for (uint64_t k = 0; k < added; ++k) {
    const Random4 r = philox(seed, 2, k, Use::kStart);
    const size_t from = static_cast<size_t>(uint64_t{r.v[3]} * found >> 32);
    double direction[3];
    random_direction(r, direction);
    Point copy = (*points)[from];
    const double distance = static_cast<double>(apart[from] * uniform(r.v[2]));
    for (size_t c = 0; c < 3; ++c) {
      copy.position[c] += static_cast<float>(distance * direction[c]);
    }
    points->push_back(copy);
  }
  return added;
}

ModelState start_model(const Capture& capture, const std::vector<Point>& points,
                       const StartOptions& options) {
  const CaptureFrame frame = frame_of(capture);
  const double duration = capture.duration();
  const size_t n = static_cast<size_t>(
      std::min<uint64_t>({options.count, options.capacity, uint64_t{points.size()}}));
  ModelState state;
  state.allocate(options.capacity, options.sh_degree);
  state.count = n;
  const std::vector<uint32_t> order = permutation(
      static_cast<uint32_t>(points.size()), options.seed, 2, static_cast<uint32_t>(Use::kStart));
  std::vector<float> positions(3 * n);
  for (size_t i = 0; i < n; ++i) {
    std::copy_n(points[order[i]].position, 3, &positions[3 * i]);
  }
  // Where points come as clouds of some instants, each cloud stands for the time until the next.
  std::set<float> times;
  for (const Point& p : points) {
    if (p.has_time) times.insert(p.time);
  }
  const bool are_clouds = !times.empty() && times.size() <= capture.frames + size_t{1};
  const std::vector<float> distance = neighbour_distance(positions, 3);
  state.value.position.assign(positions.begin(), positions.end());
  state.value.position.resize(static_cast<size_t>(3 * options.capacity));
  const size_t width = size_t{3} * (options.sh_degree + 1) * (options.sh_degree + 1);
  for (size_t i = 0; i < n; ++i) {
    const Point& p = points[order[i]];
    const Random4 r = philox(options.seed, 3, i, Use::kStart);
    double away = 0;
    for (size_t c = 0; c < 3; ++c) {
      away += std::pow(static_cast<double>(p.position[c]) - frame.center[c], 2);
    }
    const double scale = std::clamp(static_cast<double>(distance[i]), kMinScale * frame.radius,
                                    kMaxScale * std::max(frame.radius, std::sqrt(away) / kFar));
    for (size_t c = 0; c < 3; ++c) {
      state.value.log_scale[4 * i + c] = static_cast<float>(std::log(scale));
    }
    double sigma = std::min(duration, options.longest) / 25 *
                   std::pow(25.0, static_cast<double>(uniform(r.v[0])));
    state.value.mean_t[i] = static_cast<float>(static_cast<double>(uniform(r.v[1])) * duration);
    if (p.has_time) {
      state.value.mean_t[i] = p.time;
      if (are_clouds) sigma = duration / static_cast<double>(times.size());
    }
    // All of it is there at the only instant.
    if (capture.frames == 1) {
      state.value.mean_t[i] = 0;
      sigma = duration;
    }
    sigma = std::clamp(sigma, 0.15 / capture.fps, 30 * duration);
    state.value.log_scale[4 * i + 3] = static_cast<float>(std::log(sigma));
    float noise[8];
    normal4(philox(options.seed, 4, i, Use::kStart), noise);
    normal4(philox(options.seed, 5, i, Use::kStart), noise + 4);
    for (size_t k = 0; k < 8; ++k) {
      state.value.rotor[8 * i + k] =
          (k == 0 ? 1.0f : 0.0f) + noise[k] * (k < 4 ? kSpatialNoise : kTemporalNoise);
    }
    state.value.opacity[i] = std::log(kStartOpacity / (1 - kStartOpacity));
    for (size_t c = 0; c < 3; ++c) state.value.sh[width * i + c] = (p.rgb[c] - 0.5f) / kDc;
    state.id[i] = static_cast<uint32_t>(i);
  }
  state.next_id = static_cast<uint32_t>(n);
  return state;
}

}  // namespace l4d::train
