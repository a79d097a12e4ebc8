// SPDX-License-Identifier: Apache-2.0
#include "io/sequence/track.h"

#include <algorithm>
#include <cmath>

#include "io/scene/rotor_math.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

// Between 1 and 2 of the largest value of a basis function of degree 1 to 3.
constexpr double kDirectionalBasis = 0.5;
// Standard deviations of a Gaussian whose opacity does not change, in sequences.
constexpr double kSteady = 16;
// A temporal standard deviation of a million frames is the longest.
constexpr double kLeastCurvature = 0.5e-12;

double position_error(const Sample& s, const SequenceTolerance& tolerance) {
  const float* l = s.log_scale;
  const float middle = std::max(std::min(l[0], l[1]), std::min(std::max(l[0], l[1]), l[2]));
  double far = 0;
  for (size_t k = 0; k < 3; ++k) far = std::max(far, std::abs(static_cast<double>(s.position[k])));
  // Files hold coordinates to 24 bits.
  return std::max(tolerance.position * std::exp(static_cast<double>(middle)), far * 0x1p-22);
}

double sh_error(size_t number, const SequenceTolerance& tolerance) {
  return tolerance.color / (number < 3 ? static_cast<double>(sh_constant::k0) : kDirectionalBasis);
}

}  // namespace

bool LineFit::add(uint32_t n, double x, double error, double first_error) {
  const double dx = x - first, t = n;
  if (n == 1) {
    region = Region::of_two_samples(first_error, dx, error);
  } else {
    region.keep_strip(1, t, dx - error, dx + error);
  }
  sum += dx;
  sum_t += t * dx;
  return !region.empty();
}

Region::Point LineFit::solve(uint32_t n, double still) const {
  if (n < 2) return {first, 0};
  const double count = n, t = count * (count - 1) / 2, tt = t * (2 * count - 1) / 3;
  const double det = count * tt - t * t;
  const Region::Point mean{sum / count, 0};
  Region::Point line;
  line.y = (count * sum_t - t * sum) / det;
  line.x = (sum - line.y * t) / count;
  if (!region.contains(line)) line = region.middle();
  if (std::abs(line.y) * (count - 1) <= still && region.contains(mean)) line = mean;
  return {first + line.x, line.y};
}

void Track::Fade::add(uint32_t n, float opacity, double error) {
  if (!possible) return;
  const double o = static_cast<double>(opacity), t = n, w = o * o;
  const double y = std::log(o) - first;
  const double low = std::log(std::max(o - error, 1e-6)) - first,
               high = std::log(o + error) - first;
  region.keep_strip(t, t * t, low, high);
  tt += w * t * t;
  ttt += w * t * t * t;
  tttt += w * t * t * t * t;
  ty += w * t * y;
  tty += w * t * t * y;
  Region::Point unused;
  possible = !region.empty() && solve(&unused);
}

// The parameters nearest to those of least squares that all samples allow, and with them an opacity
// of at most 1 at the mean time.
bool Track::Fade::solve(Region::Point* out) const {
  const double room = std::max(-first, 1e-9);  // up to opacity 1, as a logarithm
  const auto excess = [&](const Region::Point& p) { return p.y + p.x * p.x / (4 * room); };
  const auto allowed = [&](const Region::Point& p) {
    return p.y <= -kLeastCurvature && excess(p) <= 0 && region.contains(p);
  };
  const double det = tt * tttt - ttt * ttt;
  Region::Point best = region.middle();
  if (det > 0) best = {(ty * tttt - tty * ttt) / det, (tt * tty - ttt * ty) / det};
  if (allowed(best)) {
    *out = best;
    return true;
  }
  Region::Point inside = region.middle();
  if (!allowed(inside)) {  // the point of least excess, which is on an edge
    double least = HUGE_VAL;
    for (size_t k = 0; k < region.size(); ++k) {
      const Region::Point &a = region[k], &b = region[(k + 1) % region.size()];
      const double dx = b.x - a.x, dy = b.y - a.y;
      double s = dy > 0 ? 0 : 1;
      if (dx != 0) s = std::clamp((-2 * room * dy / dx - a.x) / dx, 0.0, 1.0);
      const Region::Point p{a.x + s * dx, a.y + s * dy};
      if (excess(p) < least) {
        least = excess(p);
        inside = p;
      }
    }
    // An edge's own points count as inside, whatever rounding says.
    if (!(least <= 0 && inside.y <= -kLeastCurvature)) return false;
  }
  double low = 0, high = 1;
  for (int step = 0; step < 30; ++step) {
    const double s = (low + high) / 2;
    const Region::Point p{inside.x + s * (best.x - inside.x), inside.y + s * (best.y - inside.y)};
    (allowed(p) ? low : high) = s;
  }
  *out = {inside.x + low * (best.x - inside.x), inside.y + low * (best.y - inside.y)};
  return true;
}

Track::Track(uint32_t frame, const Sample& s, size_t numbers, const SequenceTolerance& tolerance)
    : tolerance_(tolerance),
      begin_(frame),
      first_error_(position_error(s, tolerance)),
      least_(s.opacity),
      most_(s.opacity),
      sum_(static_cast<double>(s.opacity)),
      sh_(2 * numbers) {
  for (size_t k = 0; k < 3; ++k) {
    lines_[k].first = static_cast<double>(s.position[k]);
    last_[k] = s.position[k];
    scale_[0][k] = scale_[1][k] = s.log_scale[k];
  }
  std::copy_n(s.rotation, 4, rotation_);
  std::copy_n(s.sh, numbers, sh_.data());
  std::copy_n(s.sh, numbers, sh_.data() + numbers);
  fade_.first = std::log(static_cast<double>(s.opacity));
}

bool Track::keeps_shape(const Sample& s) const {
  float least = s.log_scale[0], most = least;
  for (size_t k = 0; k < 3; ++k) {
    const float l = std::min(scale_[0][k], s.log_scale[k]),
                m = std::max(scale_[1][k], s.log_scale[k]);
    if (!(static_cast<double>(m) - static_cast<double>(l) <= 2 * tolerance_.scale)) return false;
    least = std::min(least, s.log_scale[k]);
    most = std::max(most, s.log_scale[k]);
  }
  double dot = 0;
  for (size_t k = 0; k < 4; ++k) {
    dot += static_cast<double>(rotation_[k]) * static_cast<double>(s.rotation[k]);
  }
  constexpr double kDegrees = 57.29577951308232;
  const double angle = 2 * std::acos(std::min(1.0, std::abs(dot))) * kDegrees;
  const double flat = 1 - std::exp(static_cast<double>(least) - static_cast<double>(most));
  if (!(angle * flat <= std::max(tolerance_.rotation, 0.1))) return false;
  const size_t numbers = sh_.size() / 2;
  for (size_t k = 0; k < numbers; ++k) {
    const double l = static_cast<double>(std::min(sh_[k], s.sh[k]));
    const double m = static_cast<double>(std::max(sh_[numbers + k], s.sh[k]));
    if (!(m - l <= 2 * sh_error(k, tolerance_))) return false;
  }
  return true;
}

void Track::widen_shape(const Sample& s) {
  for (size_t k = 0; k < 3; ++k) {
    scale_[0][k] = std::min(scale_[0][k], s.log_scale[k]);
    scale_[1][k] = std::max(scale_[1][k], s.log_scale[k]);
    velocity_[k] = s.position[k] - last_[k];
    last_[k] = s.position[k];
  }
  const size_t numbers = sh_.size() / 2;
  for (size_t k = 0; k < numbers; ++k) {
    sh_[k] = std::min(sh_[k], s.sh[k]);
    sh_[numbers + k] = std::max(sh_[numbers + k], s.sh[k]);
  }
}

bool Track::add(const Sample& s) {
  if (!keeps_shape(s)) return false;
  const double error = position_error(s, tolerance_);
  LineFit lines[3];
  for (size_t k = 0; k < 3; ++k) {
    lines[k] = lines_[k];
    if (!lines[k].add(count_, static_cast<double>(s.position[k]), error, first_error_))
      return false;
  }
  add_to_parts(s, error, lines_);
  std::copy_n(lines, 3, lines_);
  fade_.add(count_, s.opacity, tolerance_.opacity);
  widen_shape(s);
  ++count_;
  return true;
}

// The part that is going on takes the sample, or ends before it.
void Track::add_to_parts(const Sample& s, double error, const LineFit* lines_before) {
  const uint32_t now = begin_ + count_;
  const float least = std::min(least_, s.opacity), most = std::max(most_, s.opacity);
  bool fits = static_cast<double>(most) - static_cast<double>(least) <= 2 * tolerance_.opacity;
  LineFit lines[3];
  for (size_t k = 0; k < 3 && open_ && fits; ++k) {
    lines[k] = open_->lines[k];
    fits = lines[k].add(now - open_->begin, static_cast<double>(s.position[k]), error,
                        open_->first_error);
  }
  if (fits) {
    if (open_) std::copy_n(lines, 3, open_->lines);
    least_ = least;
    most_ = most;
    sum_ += static_cast<double>(s.opacity);
    return;
  }
  parts_.push_back(close(open_ ? open_->begin : begin_, now, open_ ? open_->lines : lines_before));
  if (!open_) open_ = std::make_unique<Open>();
  *open_ = Open();
  open_->begin = now;
  open_->first_error = error;
  for (size_t k = 0; k < 3; ++k) open_->lines[k].first = static_cast<double>(s.position[k]);
  least_ = most_ = s.opacity;
  sum_ = static_cast<double>(s.opacity);
}

Track::Part Track::close(uint32_t begin, uint32_t end, const LineFit* lines) const {
  Part part;
  part.begin = begin;
  part.end = end;
  const uint32_t n = end - begin;
  for (size_t k = 0; k < 3; ++k) {
    const Region::Point line = lines[k].solve(n, first_error_ / 4);
    part.velocity[k] = line.y;
    // Frame k is shown from k to k + 1, and its place is that at k.
    part.position[k] = line.x + line.y * n / 2;
  }
  const double least = static_cast<double>(least_), most = static_cast<double>(most_);
  const double low = std::max(most - tolerance_.opacity, least);
  part.opacity = static_cast<float>(
      std::clamp(sum_ / n, low, std::max(low, std::min(least + tolerance_.opacity, most))));
  return part;
}

// Whether what the fade gives before and after the track is too faint to be seen, and fades away.
bool Track::fades_naturally(const SequenceClock& clock, Region::Point* fade) const {
  constexpr uint32_t kLeastSamples = 3;  // fewer say nothing of a curve
  if (count_ < kLeastSamples || !fade_.possible || !fade_.solve(fade)) return false;
  const auto opacity = [&](double t) {
    return std::exp(fade_.first + fade->x * t + fade->y * t * t);
  };
  const double unseen = static_cast<double>(kLeastOpacity) + tolerance_.opacity / 2;
  if (begin_ > 0 && !(opacity(-1) < unseen && fade->x - 2 * fade->y > 0)) return false;
  const double n = count_;
  return begin_ + count_ == clock.frames || (opacity(n) < unseen && fade->x + 2 * fade->y * n < 0);
}

void Track::write_shape(const double* velocity, double sigma_t, SequenceOutput* out) const {
  AttributeArrays& g = out->gaussians;
  Vec4 wxyz;
  for (size_t k = 0; k < 4; ++k) wxyz[k] = static_cast<double>(rotation_[k]);
  float logs[3];
  Vec3 scale;
  for (size_t k = 0; k < 3; ++k) {
    logs[k] = static_cast<float>(
        (static_cast<double>(scale_[0][k]) + static_cast<double>(scale_[1][k])) / 2);
    scale[k] = std::exp(static_cast<double>(logs[k]));
  }
  if (velocity[0] == 0 && velocity[1] == 0 && velocity[2] == 0) {
    for (const double x : quaternion_to_rotor(wxyz)) g.rotor.push_back(static_cast<float>(x));
    g.log_scale.insert(g.log_scale.end(), logs, logs + 3);
    g.log_scale.push_back(static_cast<float>(std::log(sigma_t)));
  } else {
    const Shape4 shape = shape_of_moving(quaternion_to_matrix(wxyz), scale,
                                         {velocity[0], velocity[1], velocity[2]}, sigma_t);
    for (const double x : shape.rotor) g.rotor.push_back(static_cast<float>(x));
    for (const double x : shape.scale) g.log_scale.push_back(static_cast<float>(std::log(x)));
  }
  const size_t numbers = sh_.size() / 2;
  for (size_t k = 0; k < numbers; ++k) {
    const double sum = static_cast<double>(sh_[k]) + static_cast<double>(sh_[numbers + k]);
    g.sh.push_back(static_cast<float>(sum / 2));
  }
}

void Track::write_fading(const SequenceClock& clock, double mean, double sigma, double opacity,
                         SequenceOutput* out) const {
  const double begin = begin_;
  const double at = std::clamp(mean, 0.0, static_cast<double>(clock.frames)) - begin;
  double velocity[3];
  for (size_t k = 0; k < 3; ++k) {
    const Region::Point line = lines_[k].solve(count_, first_error_ / 4);
    velocity[k] = line.y / clock.seconds;
    out->gaussians.position.push_back(static_cast<float>(line.x + line.y * at));
  }
  out->times.push_back(mean * clock.seconds);
  out->gaussians.opacity.push_back(static_cast<float>(opacity));
  write_shape(velocity, sigma * clock.seconds, out);
  out->gaussians.window.insert(out->gaussians.window.end(), {0, 0});
  ++out->fading;
}

void Track::write_part(const SequenceClock& clock, const Part& part, SequenceOutput* out) const {
  double velocity[3];
  for (size_t k = 0; k < 3; ++k) {
    velocity[k] = part.velocity[k] / clock.seconds;
    out->gaussians.position.push_back(static_cast<float>(part.position[k]));
  }
  out->times.push_back(0.5 * (part.begin + part.end) * clock.seconds);
  out->gaussians.opacity.push_back(part.opacity);
  write_shape(velocity, clock.seconds, out);
  out->gaussians.window.insert(out->gaussians.window.end(), {part.begin, part.end});
  ++out->windows;
}

void Track::finish(const SequenceClock& clock, SequenceOutput* out) const {
  const double frames = clock.frames;
  const double range = static_cast<double>(most_) - static_cast<double>(least_);
  if (is_whole(clock) && parts_.empty() && range <= tolerance_.opacity / 2) {
    return write_fading(clock, frames / 2, kSteady * frames, sum_ / count_, out);
  }
  Region::Point fade;
  if (fades_naturally(clock, &fade)) {
    const double peak = std::exp(fade_.first - fade.x * fade.x / (4 * fade.y));
    return write_fading(clock, begin_ - fade.x / (2 * fade.y), 1 / std::sqrt(-2 * fade.y),
                        std::min(1.0, peak), out);
  }
  for (const Part& part : parts_) write_part(clock, part, out);
  const uint32_t begin = open_ ? open_->begin : begin_;
  write_part(clock, close(begin, begin_ + count_, open_ ? open_->lines : lines_), out);
}

}  // namespace l4d::io
