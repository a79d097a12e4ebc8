// SPDX-License-Identifier: Apache-2.0
// Whether finer positions are worth their bytes where Gaussians are flat: bounds of positions in
// every direction, that across the thinnest axis among them, against the same bytes spent on
// quality. Of the basketball scene without weights, at preset `default`; cameras that trained it,
// and cameras that did not. Prints a Markdown table.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "bench/tables/common.h"
#include "io/camera/cameras.h"
#include "io/scene/rotor_math.h"
#include "l4d/render.hpp"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr int kInstants = 4;
constexpr size_t kEveryTrained = 5;  // of the cameras that trained the scene

using Images = std::vector<std::vector<float>>;

struct Place {
  Eigen::Vector3d position, velocity;
  Eigen::Vector3d sizes;  // standard deviations, the thinnest first
};

Place place_of(const float* position, const float* log_scale, const float* rotor) {
  io::Rotor r;
  io::Vec4 s;
  for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(rotor[k]);
  for (size_t k = 0; k < 4; ++k) s[k] = std::exp(static_cast<double>(log_scale[k]));
  const io::Slice slice = io::slice(r, s);
  Place out;
  Eigen::Matrix<double, 3, 4> rows;
  for (size_t i = 0; i < 3; ++i) {
    out.position[static_cast<int>(i)] = static_cast<double>(position[i]);
    out.velocity[static_cast<int>(i)] = slice.velocity[i];
    for (size_t k = 0; k < 4; ++k)
      rows(static_cast<int>(i), static_cast<int>(k)) = slice.rows[i][k];
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(rows * rows.transpose());
  out.sizes = axes.eigenvalues().cwiseMax(0).cwiseSqrt();
  return out;
}

class Bench {
 public:
  Bench() {
    scene_.weights = io::Weights();
    const io::CameraSet set = io::read_cameras(data_dir() + "/basketball/cameras.json");
    size_t trained = 0;
    for (const io::Camera& c : set.cameras) {
      const bool is_test = c.split == "test";
      if (is_test || trained++ % kEveryTrained == 0) cameras_[is_test].push_back(c.camera);
    }
    RendererHandle renderer;
    renderer.set_gaussians(scene_.scene.view(), scene_.scene.timeline);
    for (int k = 0; k < 2; ++k) original_[k] = render_all(renderer, cameras_[k]);
  }

  // bound: of positions in sizes, 0 = the preset's.
  void print(double quality, double bound) {
    EncoderHandle encoder = make_encoder(scene_, {}, "default");
    encoder.set(L4D_ENC_QUALITY, quality);
    if (bound > 0) encoder.set(L4D_ENC_MAX_POSITION_ERROR, bound);
    const std::vector<unsigned char> file = encoder.encode();
    const std::vector<uint32_t> order = encoder.order();
    DecoderHandle decoder;
    decoder.open_memory(file.data(), file.size());
    const auto [largest, thinnest] = displacements(decoder.decode(whole_query()), order);
    RendererHandle renderer;
    renderer.set_decoder(decoder);
    double db[2], gain[2];
    for (int k = 0; k < 2; ++k) {
      db[k] = psnr(original_[k], render_all(renderer, cameras_[k]));
      if (bound == 0) curve_[k].push_back({static_cast<double>(file.size()), db[k]});
      gain[k] = db[k] - on_curve(curve_[k], static_cast<double>(file.size()));
    }
    std::printf("| %g | %s | %zu | %.3g | %.3g | %.2f | %.2f | %+.2f | %+.2f |\n", quality,
                bound > 0 ? std::to_string(bound).substr(0, 5).c_str() : "0.5", file.size(),
                median(largest), median(thinnest), db[0], db[1], gain[0], gain[1]);
    std::fflush(stdout);
  }

 private:
  struct Point {
    double bytes, db;
  };

  Images render_all(RendererHandle& renderer, const std::vector<l4d_camera>& cameras) const {
    const l4d_timeline& timeline = scene_.scene.timeline;
    Images out;
    for (int k = 0; k < kInstants; ++k) {
      renderer.set_time(timeline.time_begin + io::duration(timeline) * (k + 0.5) / kInstants);
      for (const l4d_camera& camera : cameras) out.push_back(renderer.render(camera));
    }
    return out;
  }

  static double psnr(const Images& a, const Images& b) {
    double sum = 0, count = 0;
    const auto shown = [](float v) { return std::clamp(static_cast<double>(v), 0.0, 1.0); };
    for (size_t k = 0; k < a.size(); ++k) {
      for (size_t i = 0; i < a[k].size(); ++i) {
        const double d = shown(a[k][i]) - shown(b[k][i]);
        sum += d * d;
      }
      count += static_cast<double>(a[k].size());
    }
    return -10 * std::log10(std::max(sum / count, 1e-10));
  }

  // Of a curve by rising bytes, between or beyond its points.
  static double on_curve(const std::vector<Point>& curve, double bytes) {
    if (curve.size() < 2) return curve.empty() ? 0 : curve[0].db;
    size_t k = 1;
    while (k + 1 < curve.size() && curve[k].bytes < bytes) ++k;
    const Point &a = curve[k - 1], &b = curve[k];
    return a.db + (b.db - a.db) * (bytes - a.bytes) / (b.bytes - a.bytes);
  }

  // Of each Gaussian, where it is most visible, over its largest and its thinnest size.
  std::pair<std::vector<double>, std::vector<double>> displacements(
      const GaussianArrays& a, const std::vector<uint32_t>& order) const {
    const io::Scene& s = scene_.scene;
    const double begin = s.timeline.time_begin, end = begin + io::duration(s.timeline);
    std::vector<double> largest, thinnest;
    for (size_t j = 0; j < order.size(); ++j) {
      const size_t i = order[j];
      const Place was = place_of(&s.position[3 * i], &s.log_scale[4 * i], &s.rotor[8 * i]);
      const Place is = place_of(&a.position[3 * j], &a.log_scale[4 * j], &a.rotor[8 * j]);
      const double mean = static_cast<double>(s.mean_t[i]);
      const double t = std::clamp(mean, begin, end);
      const double from = (s.flags & L4D_POSITION_AT_MEAN_TIME) != 0 ? mean : t;
      const double to = std::clamp(a.mean_t_double[j], begin, end);
      const double off =
          (was.position + was.velocity * (t - from) - is.position - is.velocity * (t - to)).norm();
      largest.push_back(off / was.sizes[2]);
      thinnest.push_back(off / std::max(was.sizes[0], 1e-30));
    }
    return {largest, thinnest};
  }

  WeightedScene scene_ = load_basketball();
  std::vector<l4d_camera> cameras_[2];  // that trained the scene, and that did not
  Images original_[2];
  std::vector<Point> curve_[2];  // by bytes: what quality gives
};

}  // namespace

int main() {
  if (data_dir().empty()) {
    std::fputs("no basketball scene: see L4D_DATA_DIR\n", stderr);
    return 1;
  }
  std::puts(
      "| quality | bound, sizes | bytes | median displacement, largest axis | thinnest axis | "
      "fidelity dB, seen | unseen | against quality for the same bytes, dB: seen | unseen |");
  std::puts("|---|---|---|---|---|---|---|---|---|");
  Bench bench;
  for (const double quality : {44, 45, 46}) bench.print(quality, 0);
  bench.print(44, 0.25);
  return 0;
}
