// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Dense>
#include <algorithm>
#include <charconv>
#include <cmath>

#include "io/ply/ply.h"
#include "io/ply/read_ply.h"
#include "io/ply/scene_ply.h"
#include "io/scene/rendering_text.h"
#include "io/scene/rotor_math.h"

namespace l4d::io {
namespace {

// The shortest decimal that reads back as the same number, whatever the locale.
std::string number(double value) {
  char text[40];
  return {text, std::to_chars(text, text + sizeof(text), value).ptr};
}

// A decimal, which every reader knows, unless only the fraction gives the same rate back.
std::string frame_rate(const l4d_timeline& timeline) {
  const double fps = static_cast<double>(timeline.fps_num) / timeline.fps_den;
  if (fps >= 1e-6 && fps <= 1e6) {
    l4d_timeline back{};
    set_fps(back, fps);
    if (back.fps_num == timeline.fps_num && back.fps_den == timeline.fps_den) return number(fps);
  }
  return std::to_string(timeline.fps_num) + "/" + std::to_string(timeline.fps_den);
}

void append_indexed(std::vector<std::string>& names, const char* name, size_t count) {
  for (size_t k = 0; k < count; ++k) names.push_back(std::string(name) + std::to_string(k));
}

void append_placement(const Scene& scene, std::vector<std::string>& comments) {
  const l4d_placement& placement = scene.placement;
  const double* o = placement.origin;
  if (o[0] != 0 || o[1] != 0 || o[2] != 0) {
    comments.push_back("l4d_origin " + number(o[0]) + " " + number(o[1]) + " " + number(o[2]));
  }
  if (placement.scale != 1) comments.push_back("l4d_scale " + number(placement.scale));
  if (placement.coordinate_system == L4D_COORDINATES_RIGHT_UP_BACK) {
    comments.push_back("l4d_coordinates right_up_back");
  } else if (placement.coordinate_system == L4D_COORDINATES_RIGHT_DOWN_FORWARD) {
    comments.push_back("l4d_coordinates right_down_forward");
  }
  if (placement.color_space == L4D_COLOR_LINEAR_SRGB) {
    comments.push_back("l4d_color_space linear_srgb");
  }
  const std::string rendering = rendering_text(scene.rendering);
  if (!rendering.empty()) comments.push_back("l4d_rendering " + rendering);
  const std::string presentation = presentation_text(scene.presentation);
  if (!presentation.empty()) comments.push_back("l4d_presentation " + presentation);
}

// sh: [K, 3] coefficient-major, its f_rest part goes out channel-major.
float* put_sh_rest(const float* sh, size_t coefficients, float* out) {
  for (size_t c = 0; c < 3; ++c) {
    for (size_t k = 1; k < coefficients; ++k) *out++ = sh[3 * k + c];
  }
  return out;
}

// Rotation and standard deviations of the covariance rows rows^T.
struct Shape3 {
  Vec4 wxyz;
  Vec3 scale;
};

Shape3 shape_of(const Eigen::Matrix3d& axes, const Eigen::Vector3d& scale) {
  Eigen::Matrix3d rotation = axes;
  if (rotation.determinant() < 0) rotation.col(2) = -rotation.col(2);
  Matrix3 matrix;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) matrix[static_cast<size_t>(3 * r + c)] = rotation(r, c);
  }
  return {matrix_to_quaternion(matrix), {scale[0], scale[1], scale[2]}};
}

Shape3 shape_of_rows(const std::array<Vec4, 3>& rows) {
  Eigen::Matrix<double, 3, 4> m;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) m(r, c) = rows[static_cast<size_t>(r)][static_cast<size_t>(c)];
  }
  const Eigen::JacobiSVD<Eigen::Matrix<double, 3, 4>> svd(
      m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return shape_of(svd.matrixU(), svd.singularValues());
}

Shape3 shape_of_covariance(const float* c /* [6] */) {
  Eigen::Matrix3d m;
  m << static_cast<double>(c[0]), static_cast<double>(c[1]), static_cast<double>(c[2]),
      static_cast<double>(c[1]), static_cast<double>(c[3]), static_cast<double>(c[4]),
      static_cast<double>(c[2]), static_cast<double>(c[4]), static_cast<double>(c[5]);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
  // Below its rounding in float32 the covariance says nothing about its thin axes; the eigenvalues
  // there are noise of either sign. The second bound keeps a point from having log scale -inf.
  const double largest = std::max(solver.eigenvalues()[2], 0.0);
  const double least = std::max(std::ldexp(largest, -24), 1e-20);
  return shape_of(solver.eigenvectors(), solver.eigenvalues().cwiseMax(least).cwiseSqrt());
}

}  // namespace

void write_l4d_ply(const std::string& path, const Scene& scene) {
  constexpr uint32_t kFileFlags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  if ((scene.flags & kFileFlags) != kFileFlags) {
    Scene converted = scene;
    positions_to_mean_time(converted);
    opacity_to_logit(converted);
    return write_l4d_ply(path, converted);
  }
  const l4d_timeline& timeline = scene.timeline;
  std::vector<std::string> comments = {
      "l4d_ply 1", "time_unit seconds", "time_begin " + number(timeline.time_begin),
      "time_end " + number(timeline.time_begin + duration(timeline)),
      "fps " + frame_rate(timeline)};
  append_placement(scene, comments);
  const size_t coefficients = scene.sh_coefficients();
  const bool double_times = !scene.mean_t_double.empty();
  std::vector<std::string> names = {"x", "y", "z", double_times ? "t:double" : "t"};
  append_indexed(names, "scale_", 4);
  append_indexed(names, "rotor_", 8);
  names.push_back("opacity");
  append_indexed(names, "f_dc_", 3);
  append_indexed(names, "f_rest_", 3 * (coefficients - 1));
  const bool windows = !scene.window.empty();
  if (windows) names.insert(names.end(), {"window_begin", "window_end"});

  PlyWriter writer(path, comments, scene.count(), names);
  for (size_t i = 0; i < scene.count(); ++i) {
    float* out = writer.next_row();
    out = std::copy_n(&scene.position[3 * i], 3, out);
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

void write_ftgs_ply(const std::string& path, const Scene& source) {
  if (!source.window.empty()) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path + ": ftgs_ply has no flat windows; write l4d_ply");
  }
  Scene scene = source;
  positions_to_mean_time(scene);
  opacity_to_logit(scene);
  const l4d_timeline& timeline = scene.timeline;
  const double unit = static_cast<double>(std::max(timeline.num_frames, 2U) - 1) *
                      timeline.fps_den / timeline.fps_num;  // seconds
  const size_t count = scene.count();
  const size_t coefficients = scene.sh_coefficients();

  std::vector<Shape3> shapes(count);
  std::vector<Vec3> velocities(count, Vec3{0, 0, 0});
  std::vector<double> durations(count);
  bool moving = false;
  double shortest = 0.02;  // what the trainer enforces; players raise shorter ones to it
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
      shapes[i] = {{unit_rotor[0], -unit_rotor[3], unit_rotor[2], -unit_rotor[1]},
                   {scale[0], scale[1], scale[2]}};
      durations[i] = scale[3] / unit;
    } else {
      const Slice at = slice(rotor, scale);
      shapes[i] = shape_of_rows(at.rows);
      durations[i] = at.sigma_t / unit;
      for (size_t k = 0; k < 3; ++k) {
        velocities[i][k] = at.velocity[k] * unit;
        moving |= at.velocity[k] != 0;
      }
    }
    if (durations[i] > 0) shortest = std::min(shortest, durations[i]);
  }

  std::vector<std::string> comments = {
      "ftgs_version 1", "time_units normalized", "sh_degree " + std::to_string(scene.sh_degree),
      std::string("use_velocity ") + (moving ? "1" : "0"),
      // Rounded down: rounding in float32 must not raise one.
      "min_duration " + number(shortest * 0.999), "opacity_floor 0",
      "n_frames " + std::to_string(timeline.num_frames)};
  append_placement(scene, comments);
  std::vector<std::string> names = {"x", "y", "z", "nx", "ny", "nz"};
  append_indexed(names, "f_dc_", 3);
  append_indexed(names, "f_rest_", 3 * (coefficients - 1));
  names.push_back("opacity");
  append_indexed(names, "scale_", 3);
  append_indexed(names, "rot_", 4);
  names.push_back("time");
  names.push_back("log_duration");
  append_indexed(names, "velocity_", 3);

  PlyWriter writer(path, comments, count, names);
  for (size_t i = 0; i < count; ++i) {
    float* out = writer.next_row();
    out = std::copy_n(&scene.position[3 * i], 3, out);
    out = std::fill_n(out, 3, 0.0F);
    const float* sh = &scene.sh[3 * coefficients * i];
    out = put_sh_rest(sh, coefficients, std::copy_n(sh, 3, out));
    *out++ = scene.opacity[i];
    for (double s : shapes[i].scale) *out++ = static_cast<float>(std::log(s));
    for (double q : shapes[i].wxyz) *out++ = static_cast<float>(q);
    *out++ = static_cast<float>((scene.mean_time(i) - timeline.time_begin) / unit);
    *out++ = static_cast<float>(std::log(durations[i]));
    for (double v : velocities[i]) *out++ = static_cast<float>(v);
  }
  writer.finish();
}

void write_3dgs_ply(const std::string& path, const Splats& splats) {
  const size_t coefficients = (splats.sh_degree + 1) * (splats.sh_degree + 1);
  std::vector<std::string> names = {"x", "y", "z", "nx", "ny", "nz"};
  append_indexed(names, "f_dc_", 3);
  append_indexed(names, "f_rest_", 3 * (coefficients - 1));
  names.push_back("opacity");
  append_indexed(names, "scale_", 3);
  append_indexed(names, "rot_", 4);

  PlyWriter writer(path, {}, splats.count(), names);
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
