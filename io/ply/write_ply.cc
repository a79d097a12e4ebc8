// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/ply/ply.h"
#include "io/ply/read_ply.h"
#include "io/ply/scene_ply.h"
#include "io/scene/rotor_math.h"
#include "io/scene/shape3.h"
#include "io/scene/statements.h"

namespace l4d::io {
namespace {

void append_indexed(std::vector<std::string>& names, const char* name, size_t count) {
  for (size_t k = 0; k < count; ++k) names.push_back(std::string(name) + std::to_string(k));
}

void append_placement(const Scene& scene, std::vector<std::string>& comments) {
  const std::vector<std::string> more =
      placement_statements(scene.placement, scene.rendering, scene.presentation);
  comments.insert(comments.end(), more.begin(), more.end());
}

// sh: [K, 3] coefficient-major, its f_rest part goes out channel-major.
float* put_sh_rest(const float* sh, size_t coefficients, float* out) {
  for (size_t c = 0; c < 3; ++c) {
    for (size_t k = 1; k < coefficients; ++k) *out++ = sh[3 * k + c];
  }
  return out;
}

// Whether float32 moves a position by more than a thousandth of the size of its Gaussian, as it
// does with map coordinates. A size is at least 1/4000 of the scene.
bool float_is_coarse(const Scene& scene, const std::vector<double>& positions /* [N, 3] */) {
  double extent = 0;
  for (size_t k = 0; k < 3; ++k) {
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (size_t i = k; i < positions.size(); i += 3) {
      low = std::min(low, positions[i]);
      high = std::max(high, positions[i]);
    }
    extent = std::max(extent, high - low);
  }
  for (size_t i = 0; i < scene.count(); ++i) {
    const float* axes = &scene.log_scale[4 * i];
    const double largest = std::exp(static_cast<double>(*std::max_element(axes, axes + 3)));
    const double size = std::max(largest, extent / 4000);
    for (size_t k = 0; k < 3; ++k) {
      const double x = positions[3 * i + k];
      if (std::fabs(x - static_cast<double>(static_cast<float>(x))) > 1e-3 * size) return true;
    }
  }
  return false;
}

// exact: positions that float32 does not hold, [N, 3]; empty: those of the scene.
void write_l4d_rows(const std::string& path, const Scene& scene, const std::vector<double>& exact,
                    const Check& check) {
  std::vector<std::string> comments = clock_statements(scene.timeline);
  comments.insert(comments.begin(), "l4d_ply 1");
  append_placement(scene, comments);
  const size_t coefficients = scene.sh_coefficients();
  const bool double_times = !scene.mean_t_double.empty();
  const bool double_positions = !exact.empty();
  std::vector<std::string> names = {"x", "y", "z"};
  if (double_positions) names = {"x:double", "y:double", "z:double"};
  names.push_back(double_times ? "t:double" : "t");
  append_indexed(names, "scale_", 4);
  append_indexed(names, "rotor_", 8);
  names.push_back("opacity");
  append_indexed(names, "f_dc_", 3);
  append_indexed(names, "f_rest_", 3 * (coefficients - 1));
  const bool windows = !scene.window.empty();
  if (windows) names.insert(names.end(), {"window_begin", "window_end"});

  PlyWriter writer(path, comments, scene.count(), names, check);
  for (size_t i = 0; i < scene.count(); ++i) {
    float* out = writer.next_row();
    if (double_positions) {
      for (size_t k = 0; k < 3; ++k) out = PlyWriter::put_double(exact[3 * i + k], out);
    } else {
      out = std::copy_n(&scene.position[3 * i], 3, out);
    }
    if (double_times) {
      out = PlyWriter::put_double(scene.mean_t_double[i], out);
    } else {
      *out++ = scene.mean_t[i];
    }
    out = std::copy_n(&scene.log_scale[4 * i], 4, out);
    out = std::copy_n(&scene.rotor[8 * i], 8, out);
    *out++ = scene.opacity[i];
    const float* sh = &scene.sh[3 * coefficients * i];
    out = put_sh_rest(sh, coefficients, std::copy_n(sh, 3, out));
    // float32 holds every number of a frame.
    for (size_t k = 0; windows && k < 2; ++k) *out++ = static_cast<float>(scene.window[2 * i + k]);
  }
  writer.finish();
}

// Gaussians in space that move along lines and fade, in a time of the file's own.
struct MovingShapes {
  std::vector<Shape3> shapes;
  std::vector<Vec3> velocities;
  std::vector<double> durations;  // standard deviations
  bool moving = false;
  double shortest = 0.02;  // what FreeTimeGS enforces; its players raise shorter ones to it
};

// unit: seconds of its time 1.
MovingShapes moving_shapes(const Scene& scene, double unit) {
  const size_t count = scene.count();
  MovingShapes out;
  out.shapes.resize(count);
  out.velocities.assign(count, Vec3{0, 0, 0});
  out.durations.resize(count);
  for (size_t i = 0; i < count; ++i) {
    Rotor rotor;
    Vec4 scale;
    for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
    for (size_t k = 0; k < 4; ++k) {
      scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
    }
    if (rotor[4] == 0 && rotor[5] == 0 && rotor[6] == 0 && rotor[7] == 0) {
      const Vec4 wxyz{rotor[0], -rotor[3], rotor[2], -rotor[1]};
      const Rotor unit_rotor = quaternion_to_rotor(wxyz);  // readers may not normalise
      out.shapes[i] = {{unit_rotor[0], -unit_rotor[3], unit_rotor[2], -unit_rotor[1]},
                       {scale[0], scale[1], scale[2]}};
      out.durations[i] = scale[3] / unit;
    } else {
      const Slice at = slice(rotor, scale);
      out.shapes[i] = shape_of_rows(at.rows);
      out.durations[i] = at.sigma_t / unit;
      for (size_t k = 0; k < 3; ++k) {
        out.velocities[i][k] = at.velocity[k] * unit;
        out.moving |= at.velocity[k] != 0;
      }
    }
    if (out.durations[i] > 0) out.shortest = std::min(out.shortest, out.durations[i]);
  }
  return out;
}

// The scene with positions at mean times and logits.
Scene moving_scene(const Scene& source, const std::string& path, const char* format) {
  if (!source.window.empty()) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path + ": " + format + " has no flat windows; .ply and .4dgs have");
  }
  require_valid(source, path);
  Scene scene = source;
  positions_to_mean_time(scene);
  opacity_to_logit(scene);
  return scene;
}

// The columns of a 3DGS PLY, and those of time, rate and velocity behind it.
std::vector<std::string> moving_names(size_t coefficients, const char* time, const char* width,
                                      const char* velocity) {
  std::vector<std::string> names = {"x", "y", "z", "nx", "ny", "nz"};
  append_indexed(names, "f_dc_", 3);
  append_indexed(names, "f_rest_", 3 * (coefficients - 1));
  names.push_back("opacity");
  append_indexed(names, "scale_", 3);
  append_indexed(names, "rot_", 4);
  names.push_back(time);
  names.push_back(width);
  append_indexed(names, velocity, 3);
  return names;
}

// unit: seconds of its time 1; begin: its time 0.
void write_moving_rows(PlyWriter* writer, const Scene& scene, const MovingShapes& found,
                       double begin, double unit) {
  const size_t coefficients = scene.sh_coefficients();
  for (size_t i = 0; i < scene.count(); ++i) {
    float* out = writer->next_row();
    out = std::copy_n(&scene.position[3 * i], 3, out);
    out = std::fill_n(out, 3, 0.0F);
    const float* sh = &scene.sh[3 * coefficients * i];
    out = put_sh_rest(sh, coefficients, std::copy_n(sh, 3, out));
    *out++ = scene.opacity[i];
    for (double s : found.shapes[i].scale) *out++ = static_cast<float>(std::log(s));
    for (double q : found.shapes[i].wxyz) *out++ = static_cast<float>(q);
    *out++ = static_cast<float>((scene.mean_time(i) - begin) / unit);
    *out++ = static_cast<float>(std::log(found.durations[i]));
    for (double v : found.velocities[i]) *out++ = static_cast<float>(v);
  }
  writer->finish();
}

// What readers of such a file do not learn of the clock.
WriteNotes lost_clock(const char* format, const l4d_timeline& timeline) {
  // Without a rate, readers take 30 frames a second.
  std::vector<std::string> lost = begin_statements(timeline);
  if (timeline.fps_num != 30 * uint64_t{timeline.fps_den}) {
    lost.push_back(clock_statements(timeline).back());
  }
  WriteNotes notes;
  note_lost_statements(format, lost, &notes);
  return notes;
}

}  // namespace

void write_l4d_ply(const std::string& path, const Scene& scene, const Check& check) {
  constexpr uint32_t kFileFlags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  if ((scene.flags & kFileFlags) == kFileFlags) return write_l4d_rows(path, scene, {}, check);
  std::vector<double> exact = positions_at_mean_time(scene);
  if (!float_is_coarse(scene, exact)) exact = {};
  Scene converted = scene;
  positions_to_mean_time(converted);
  opacity_to_logit(converted);
  write_l4d_rows(path, converted, exact, check);
}

uint64_t bytes_to_write_moving(const Scene& scene) {
  const uint64_t shapes = sizeof(Shape3) + sizeof(Vec3) + sizeof(double);
  const uint64_t copy = numbers_per_gaussian(scene.sh_degree) * sizeof(float) + sizeof(double);
  return scene.count() * (shapes + copy);
}

WriteNotes write_ftgs_ply(const std::string& path, const Scene& source, const Check& check) {
  const Scene scene = moving_scene(source, path, "ftgs_ply");
  const l4d_timeline& timeline = scene.timeline;
  const double unit = static_cast<double>(std::max(timeline.num_frames, 2U) - 1) *
                      timeline.fps_den / timeline.fps_num;  // seconds
  const MovingShapes found = moving_shapes(scene, unit);
  std::vector<std::string> comments = {
      "ftgs_version 1", "time_units normalized", "sh_degree " + std::to_string(scene.sh_degree),
      std::string("use_velocity ") + (found.moving ? "1" : "0"),
      // Rounded down: rounding in float32 must not raise one.
      "min_duration " + text_of_number(found.shortest * 0.999), "opacity_floor 0",
      "n_frames " + std::to_string(timeline.num_frames)};
  append_placement(scene, comments);
  PlyWriter writer(path, comments, scene.count(),
                   moving_names(scene.sh_coefficients(), "time", "log_duration", "velocity_"),
                   check);
  write_moving_rows(&writer, scene, found, timeline.time_begin, unit);
  return lost_clock("FreeTimeGS", timeline);
}

WriteNotes write_stg_ply(const std::string& path, const Scene& source, const Check& check) {
  const Scene scene = moving_scene(source, path, "stg_ply");
  const l4d_timeline& timeline = scene.timeline;
  // Readers take times for parts of the sequence where all of them can be, else for seconds.
  const double whole = duration(timeline);
  bool are_parts = true, look_like_parts = true;
  for (size_t i = 0; i < scene.count(); ++i) {
    const double seconds = scene.mean_time(i) - timeline.time_begin;
    are_parts = are_parts && seconds >= 0 && seconds <= whole;
    look_like_parts = look_like_parts && seconds >= 0 && seconds <= 1;
  }
  if (!are_parts && look_like_parts) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path +
                    ": mean times lie behind the end of a sequence of less than a second, which "
                    "a PLY with t and scale_t cannot say");
  }
  const double unit = are_parts ? whole : 1;
  std::vector<std::string> comments;
  append_placement(scene, comments);
  PlyWriter writer(path, comments, scene.count(),
                   moving_names(scene.sh_coefficients(), "t", "scale_t", "motion_"), check);
  write_moving_rows(&writer, scene, moving_shapes(scene, unit), timeline.time_begin, unit);
  WriteNotes notes = lost_clock("a PLY with t and scale_t", timeline);
  notes.emplace("a PLY with t and scale_t does not state how long the sequence lasts: " +
                    text_of_number(whole) + " s (--seconds)",
                0);
  return notes;
}

void write_3dgs_ply(const std::string& path, const Splats& splats, const Check& check) {
  const size_t coefficients = (splats.sh_degree + 1) * (splats.sh_degree + 1);
  std::vector<std::string> names = {"x", "y", "z", "nx", "ny", "nz"};
  append_indexed(names, "f_dc_", 3);
  append_indexed(names, "f_rest_", 3 * (coefficients - 1));
  names.push_back("opacity");
  append_indexed(names, "scale_", 3);
  append_indexed(names, "rot_", 4);

  PlyWriter writer(path, {}, splats.count(), names, check);
  for (size_t i = 0; i < splats.count(); ++i) {
    const float* covariance = &splats.covariance[6 * i];
    if (!std::all_of(covariance, covariance + 6, [](float x) { return std::isfinite(x); })) {
      throw Error(L4D_ERR_INVALID_SCENE,
                  path + ": the covariance of splat " + std::to_string(i) + " is not finite");
    }
    const Shape3 shape = shape_of_covariance(covariance);
    float* out = writer.next_row();
    out = std::copy_n(&splats.position[3 * i], 3, out);
    out = std::fill_n(out, 3, 0.0F);
    const float* sh = &splats.sh[3 * coefficients * i];
    out = put_sh_rest(sh, coefficients, std::copy_n(sh, 3, out));
    *out++ = static_cast<float>(logit(static_cast<double>(splats.opacity[i])));
    for (double s : shape.scale) *out++ = static_cast<float>(std::log(s));
    for (double q : shape.wxyz) *out++ = static_cast<float>(q);
  }
  writer.finish();
}

}  // namespace l4d::io
