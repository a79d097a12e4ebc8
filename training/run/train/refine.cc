// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/refine.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "io/camera/write_cameras.h"

namespace l4d::train {
namespace {

// Of the bound, the most that a step changes a number by: at first, where the clock decides when a
// training ends; else so that all steps together come this many bounds far, within limits. Each
// rate is that much of the first one at the end.
constexpr double kTimedRate = 0.02, kLeastRate = 0.01, kMostRate = 0.05, kReach = 2, kFall = 0.01;
// Loss at the bound, as if the capture were one more image: what shows nothing stays there.
constexpr double kTrust = 1e-5;
constexpr double kDamping = 1e-4;  // of the mean variance

using Vector = std::array<double, 3>;

// To the axes of the world, and back.
Vector to_world(const l4d_camera& camera, const double* v) {
  const double* m = camera.world_to_camera;
  Vector out;
  for (size_t k = 0; k < 3; ++k) out[k] = m[k] * v[0] + m[4 + k] * v[1] + m[8 + k] * v[2];
  return out;
}
Vector to_camera(const l4d_camera& camera, const Vector& v) {
  const double* m = camera.world_to_camera;
  Vector out;
  for (size_t r = 0; r < 3; ++r) {
    out[r] = m[4 * r] * v[0] + m[4 * r + 1] * v[1] + m[4 * r + 2] * v[2];
  }
  return out;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 != 0) return *middle;
  return (*middle + *std::max_element(values.begin(), middle)) / 2;
}

// How far the numbers of a camera may be from 0; 0: it stays as it is.
CameraChange bounds_of(const Settings& settings, const Capture& capture, uint32_t camera,
                       double radius) {
  CameraChange bound{};
  bound[kTime] = settings.refine_times / capture.fps;
  const double angle = settings.refine_cameras * 3.14159265358979323846 / 180;
  for (size_t k = 0; k < 3; ++k) {
    bound[kTurn + k] = angle;
    bound[kMove + k] = angle * radius;
  }
  // Images of other lenses have been made those of a pinhole, by its focal length.
  const io::Distortion& lens = capture.cameras[camera].source.distortion;
  if (lens.model == io::Distortion::Model::kNone) bound[kFocal] = angle;
  return bound;
}

}  // namespace

void hold_medians(const Capture& capture, const std::vector<uint32_t>& cameras,
                  std::vector<RefinedCamera>* refined) {
  const size_t n = cameras.size();
  const auto change_of = [&](size_t k) -> CameraChange& { return (*refined)[cameras[k]].change; };
  const auto middle = [&](const auto& value) {
    std::vector<double> values;
    for (size_t k = 0; k < n; ++k) values.push_back(value(k));
    return median(std::move(values));
  };
  for (const size_t number : {kTime, kFocal}) {
    const double less = middle([&](size_t k) { return change_of(k)[number]; });
    for (size_t k = 0; k < n; ++k) change_of(k)[number] -= less;
  }
  std::vector<Vector> turn(n), move(n), from(n);  // in the world; from the middle of the cameras
  for (size_t k = 0; k < n; ++k) {
    const l4d_camera& given = capture.cameras[cameras[k]].source.camera;
    turn[k] = to_world(given, &change_of(k)[kTurn]);
    move[k] = to_world(changed(given, change_of(k)), &change_of(k)[kMove]);
    camera_center(given, from[k].data());
  }
  Vector all{};
  for (size_t c = 0; c < 3; ++c) {
    const double less = middle([&](size_t k) { return from[k][c]; });
    for (size_t k = 0; k < n; ++k) from[k][c] -= less;
  }
  for (size_t c = 0; c < 3; ++c) all[c] = middle([&](size_t k) { return turn[k][c]; });
  for (size_t k = 0; k < n; ++k) {
    // About the middle of the cameras.
    for (size_t c = 0; c < 3; ++c) {
      const size_t d = (c + 1) % 3, e = (c + 2) % 3;
      turn[k][c] -= all[c];
      move[k][c] -= all[d] * from[k][e] - all[e] * from[k][d];
    }
  }
  for (size_t c = 0; c < 3; ++c) {
    const double less = middle([&](size_t k) { return move[k][c]; });
    for (size_t k = 0; k < n; ++k) move[k][c] -= less;
  }
  // Nor does the world grow.
  const double growth = middle([&](size_t k) {
    double along = 0, square = 0;
    for (size_t c = 0; c < 3; ++c) {
      along += move[k][c] * from[k][c];
      square += from[k][c] * from[k][c];
    }
    return square > 0 ? along / square : 0;
  });
  for (size_t k = 0; k < n; ++k) {
    for (size_t c = 0; c < 3; ++c) move[k][c] -= growth * from[k][c];
    const l4d_camera& given = capture.cameras[cameras[k]].source.camera;
    const Vector turned = to_camera(given, turn[k]);
    std::copy_n(turned.data(), 3, &change_of(k)[kTurn]);
    const Vector moved = to_camera(changed(given, change_of(k)), move[k]);
    std::copy_n(moved.data(), 3, &change_of(k)[kMove]);
  }
}

Refinement::Refinement(const Settings& settings, Capture* capture, ImageLoader* loader,
                       Trainer* trainer)
    : capture_(*capture),
      loader_(*loader),
      trainer_(*trainer),
      settings_(settings),
      first_rate_(kTimedRate) {
  const double radius = frame_of(*capture).radius;
  for (uint32_t c = 0; c < capture->cameras.size(); ++c) {
    if (capture->cameras[c].split == "train") cameras_.push_back(c);
    bounds_.push_back(bounds_of(settings, *capture, c, radius));
  }
  trainer->state().refined.resize(capture->cameras.size());
  if (settings.steps == 0) return;
  const double updates = static_cast<double>(settings.steps) * settings.views /
                         static_cast<double>(std::max<size_t>(1, cameras_.size()));
  first_rate_ = std::clamp(-std::log(kFall) * kReach / updates, kLeastRate, kMostRate);
}

void Refinement::use_changes() {
  for (size_t c = 0; c < capture_.cameras.size(); ++c) {
    capture_.cameras[c].change = trainer_.state().refined[c].change;
  }
  loader_.renew_cameras();
}

void Refinement::advance(const StepReport& step) {
  if (step.view_gradients.empty()) return;
  const double rate = first_rate_ * std::pow(kFall, step.progress);
  const auto count = static_cast<double>(step.views.size());
  std::vector<RefinedCamera>& refined = trainer_.state().refined;
  for (size_t k = 0; k < step.views.size(); ++k) {
    const uint32_t camera = capture_.views[step.views[k]].camera;
    ViewGradient of_view = step.view_gradients[k];
    if (!std::all_of(of_view.begin(), of_view.end(), [](double v) { return std::isfinite(v); })) {
      continue;
    }
    for (double& number : of_view) number *= count;  // by the loss of the view alone
    update(of_view, rate, bounds_[camera], &refined[camera]);
  }
  hold_medians(capture_, cameras_, &refined);
  for (const uint32_t camera : cameras_) {
    for (size_t k = 0; k < bounds_[camera].size(); ++k) {
      const double bound = bounds_[camera][k];
      double& number = refined[camera].change[k];
      number = std::clamp(number, -bound, bound);
    }
  }
  use_changes();
}

void Refinement::update(const ViewGradient& by_view, double rate, const CameraChange& bound,
                        RefinedCamera* camera) const {
  CameraChange gradient;
  std::copy_n(by_view.begin(), gradient.size(), gradient.begin());
  gradient[kFocal] += by_view[kFocal + 1];
  std::vector<size_t> free;
  for (size_t k = 0; k < gradient.size(); ++k) {
    if (bound[k] > 0) free.push_back(k);
  }
  const auto n = static_cast<Eigen::Index>(free.size());
  Eigen::VectorXd mean(n);
  Eigen::MatrixXd square(n, n);
  ++camera->updates;
  const double whole_m = 1 - std::pow(0.9, camera->updates);
  const double whole_v = 1 - std::pow(0.99, camera->updates);
  const auto along = [&](size_t k) {
    return gradient[k] * bound[k] + 2 * kTrust * camera->change[k] / bound[k];
  };
  for (Eigen::Index a = 0; a < n; ++a) {
    const size_t k = free[static_cast<size_t>(a)];
    camera->m[k] += 0.1 * (along(k) - camera->m[k]);
    mean[a] = camera->m[k] / whole_m;
    for (Eigen::Index b = 0; b < n; ++b) {
      const size_t l = free[static_cast<size_t>(b)];
      double& of_both = camera->square[gradient.size() * k + l];
      of_both += 0.01 * (along(k) * along(l) - of_both);
      square(a, b) = of_both / whole_v;
    }
  }
  square.diagonal().array() += kDamping * square.trace() / static_cast<double>(n) + 1e-20;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(square);
  const Eigen::VectorXd change = solver.operatorInverseSqrt() * mean;
  for (Eigen::Index a = 0; a < n; ++a) {
    const size_t k = free[static_cast<size_t>(a)];
    camera->change[k] -= rate * bound[k] * change[a];
  }
}

std::vector<std::string> Refinement::notes() const {
  std::vector<std::string> notes;
  const auto say = [&](const char* unit, const char* option, const auto& size_of) {
    std::vector<double> sizes;
    for (const uint32_t c : cameras_) sizes.push_back(size_of(capture_.cameras[c].change));
    const auto most = std::max_element(sizes.begin(), sizes.end());
    const auto which = static_cast<size_t>(most - sizes.begin());
    const std::string name = capture_.cameras[cameras_[which]].name;
    char text[240];
    std::snprintf(text, sizeof(text),
                  "%s has found %s %.4f %s from where the capture has it, further than any other; "
                  "half of the cameras are within %.4f %s.",
                  option, name.c_str(), *most, unit, median(sizes), unit);
    notes.emplace_back(text);
  };
  if (settings_.refine_times > 0) {
    say("s", "--refine-times", [](const CameraChange& change) { return std::abs(change[kTime]); });
  }
  if (settings_.refine_cameras > 0) {
    say("degrees", "--refine-cameras", [](const CameraChange& change) {
      return std::hypot(change[kTurn], change[kTurn + 1], change[kTurn + 2]) * 180 /
             3.14159265358979323846;
    });
  }
  // Of any number: its time, a turn, a move, its focal length.
  for (const uint32_t camera : cameras_) {
    const CaptureCamera& of = capture_.cameras[camera];
    for (size_t k = 0; k < of.change.size(); ++k) {
      const double bound = bounds_[camera][k];
      if (bound == 0 || std::abs(of.change[k]) < 0.99 * bound) continue;
      notes.push_back(of.name + " is at the bound of " +
                      (k == kTime ? "--refine-times." : "--refine-cameras."));
      break;
    }
  }
  return notes;
}

void write_refined(const std::string& path, const Capture& capture, bool all_frames) {
  io::CameraSet set = camera_set(capture);
  if (!all_frames) set.frames = 0;
  io::write_cameras(path, set);
}

void follow_refined(const std::string& path, Capture* capture, ImageLoader* loader) {
  const io::CameraSet set = io::read_cameras(path);
  bool same = set.cameras.size() == capture->cameras.size();
  for (size_t c = 0; same && c < set.cameras.size(); ++c) {
    io::Camera& source = capture->cameras[c].source;
    const io::Camera& refined = set.cameras[c];
    same = refined.id == source.id && refined.camera.width == source.camera.width &&
           refined.camera.height == source.camera.height;
    source.camera = refined.camera;
    capture->cameras[c].change[kTime] = refined.time_offset - source.time_offset;
  }
  if (!same) throw io::Error(L4D_ERR_CORRUPT, path + ": it has other cameras than the capture");
  loader->renew_cameras();
}

}  // namespace l4d::train
