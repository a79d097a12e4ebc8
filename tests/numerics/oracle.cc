// SPDX-License-Identifier: Apache-2.0
#include "tests/numerics/oracle.h"

#include <algorithm>
#include <cmath>

#include "io/scene/rotor_math.h"
#include "l4d/experimental/inspect.hpp"
#include "libl4dcodec/scene/attributes.h"

namespace l4d::numerics {

using namespace test;

Seen seen_of(const float* position, double mean, const float* log_scale, const float* rotor,
             float opacity, double begin, double end) {
  io::Rotor r;
  io::Vec4 s;
  for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(rotor[k]);
  for (size_t k = 0; k < 4; ++k) s[k] = std::exp(static_cast<double>(log_scale[k]));
  const io::Slice slice = io::slice(r, s);
  Seen out;
  for (int i = 0; i < 3; ++i) {
    out.position[i] = static_cast<double>(position[i]);
    out.velocity[i] = slice.velocity[static_cast<size_t>(i)];
    for (int j = 0; j < 3; ++j) {
      double sum = 0;
      for (size_t k = 0; k < 4; ++k) {
        sum += slice.rows[static_cast<size_t>(i)][k] * slice.rows[static_cast<size_t>(j)][k];
      }
      out.covariance(i, j) = sum;
    }
  }
  out.mean = mean;
  out.sigma = slice.sigma_t;
  out.reference = std::clamp(out.mean, begin, end);
  out.opacity = static_cast<double>(opacity);
  return out;
}

double min_size(const TestScene& s) {
  double extent = 0;
  for (size_t k = 0; k < 3; ++k) {
    std::vector<float> axis;
    for (size_t i = 0; i < s.count(); ++i) axis.push_back(s.position[3 * i + k]);
    std::sort(axis.begin(), axis.end());
    const size_t tail = axis.size() / 20;
    extent = std::max(
        extent, std::min(1.25 * static_cast<double>(axis[axis.size() - 1 - tail] - axis[tail]),
                         static_cast<double>(axis.back() - axis.front())));
  }
  return extent / 4000;
}

void add_colors(const TestScene& scene, size_t i, const GaussianArrays& a, size_t j, Worst* worst) {
  const size_t n = (scene.sh_degree + 1) * (scene.sh_degree + 1);
  const double pi = std::acos(-1.0);
  double largest = 1, base = 0, directional = 0;
  for (size_t c = 0; c < 3; ++c) {
    const auto was = [&](size_t k) {
      return static_cast<double>(scene.sh[3 * (n * i + k) + c]) / std::sqrt(4 * pi);
    };
    const auto is = [&](size_t k) {
      return static_cast<double>(a.sh[3 * (n * j + k) + c]) / std::sqrt(4 * pi);
    };
    double own = 0, off = 0;
    for (size_t l = 1; l <= scene.sh_degree; ++l) {
      double own2 = 0, off2 = 0;
      for (size_t k = l * l; k < (l + 1) * (l + 1); ++k) {
        own2 += was(k) * was(k);
        off2 += (is(k) - was(k)) * (is(k) - was(k));
      }
      own += std::sqrt(static_cast<double>(2 * l + 1) * own2);
      off += std::sqrt(static_cast<double>(2 * l + 1) * off2);
    }
    largest = std::max({largest, std::fabs(0.5 + was(0)), own});
    base = std::max(base, std::fabs(is(0) - was(0)));
    directional = std::max(directional, off);
  }
  worst->base_color = std::max(worst->base_color, base / largest);
  worst->directional_color = std::max(worst->directional_color, directional / largest);
}

Worst worst_errors(const TestScene& scene, const Encoded& e, double own_min_size) {
  const GaussianArrays a = decode(e.bytes, all_query());
  const double begin = scene.timeline.time_begin, end = begin + scene.duration();
  const double least = std::max(min_size(scene), own_min_size);
  Worst worst;
  for (size_t j = 0; j < a.count(); ++j) {
    const size_t i = e.order[j];
    const Seen was =
        seen_of(&scene.position[3 * i], mean_time(scene.view(), i), &scene.log_scale[4 * i],
                &scene.rotor[8 * i], scene.opacity[i], begin, end);
    const Seen is = seen_of(&a.position[3 * j], a.mean_t_double[j], &a.log_scale[4 * j],
                            &a.rotor[8 * j], a.opacity[j], begin, end);
    worst.mean_time = std::max(worst.mean_time, std::fabs(is.mean - was.mean) / was.sigma);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> sizes(was.covariance);
    const double size = std::max(std::sqrt(std::max(sizes.eigenvalues()[2], 0.0)), least);
    const double nearest = was.reference - was.mean;
    const double half = std::sqrt(nearest * nearest + 2 * std::log(2.0) * was.sigma * was.sigma);
    for (int k = -20; k <= 20; ++k) {
      const double t = std::clamp(was.mean + half * k / 20, begin, end);
      worst.position = std::max(worst.position, (was.at(t) - is.at(t)).norm() / size);
    }
    for (int k = 0; k <= 200; ++k) {
      const double t = std::clamp(was.mean + was.sigma * (k - 100) / 25, begin, end);
      worst.opacity = std::max(worst.opacity, std::fabs(was.opacity_at(t) - is.opacity_at(t)));
    }
    add_colors(scene, i, a, j, &worst);
    const double floor = std::max(least, 1e-6 * size);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> others(is.covariance);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> change(is.covariance - was.covariance);
    for (int k = 0; k < 3; ++k) {
      const double ratio = (std::max(others.eigenvalues()[k], 0.0) + floor * floor) /
                           (std::max(sizes.eigenvalues()[k], 0.0) + floor * floor);
      const double turned =
          std::fabs(change.eigenvalues()[k]) / (sizes.eigenvalues()[2] + floor * floor);
      worst.covariance = std::max({worst.covariance, ratio, 1 / ratio, 1 + turned});
    }
  }
  return worst;
}

l4d_coding_errors stated_errors(const Bytes& bytes) {
  DecoderHandle decoder;
  decoder.open_memory(bytes.data(), bytes.size());
  return coding_errors(decoder);
}

TestScene in_other_units(const TestScene& scene, double scale, double later) {
  TestScene out = scene;
  for (float& x : out.position) x = static_cast<float>(scale * static_cast<double>(x));
  out.timeline.time_begin += later;
  out.mean_t_double.resize(scene.count());
  for (size_t i = 0; i < scene.count(); ++i) {
    out.mean_t_double[i] = static_cast<double>(scene.mean_t[i]) + later;
    const float* rotor = scene.rotor.data() + 8 * i;
    const Seen seen = seen_of(&scene.position[3 * i], 0, &scene.log_scale[4 * i], rotor, 1, 0, 1);
    float* log_scale = out.log_scale.data() + 4 * i;
    if (seen.velocity.norm() == 0) {
      for (size_t k = 0; k < 3; ++k) log_scale[k] += static_cast<float>(std::log(scale));
      continue;
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(seen.covariance);
    Eigen::Matrix3d turn = axes.eigenvectors();
    if (turn.determinant() < 0) turn.col(0) = -turn.col(0);
    io::Matrix3 rotation;
    io::Vec3 sizes, velocity;
    for (int k = 0; k < 3; ++k) {
      for (int l = 0; l < 3; ++l) rotation[static_cast<size_t>(3 * k + l)] = turn(k, l);
      sizes[static_cast<size_t>(k)] = scale * std::sqrt(std::max(axes.eigenvalues()[k], 0.0));
      velocity[static_cast<size_t>(k)] = scale * seen.velocity[k];
    }
    const io::Shape4 shape = io::shape_of_moving(rotation, sizes, velocity, seen.sigma);
    for (size_t k = 0; k < 8; ++k) out.rotor[8 * i + k] = static_cast<float>(shape.rotor[k]);
    for (size_t k = 0; k < 4; ++k) {
      log_scale[k] = static_cast<float>(std::log(std::max(shape.scale[k], 1e-300)));
    }
  }
  return out;
}

}  // namespace l4d::numerics
