// SPDX-License-Identifier: Apache-2.0
// Whole scenes through encoder and decoder: where Gaussians are while they can be seen.
#include <algorithm>
#include <cmath>

#include "libl4dcodec/base/half.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/slice.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/math/reference.h"
#include "tests/numerics/formula.h"

namespace l4d::numerics {
namespace {

using reference::Real;
using namespace test;

Slice4D<double> slice_of(const float* rotor, const float* log_scale) {
  double r[8], s[4];
  for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(rotor[k]);
  for (size_t k = 0; k < 4; ++k) s[k] = std::exp(static_cast<double>(log_scale[k]));
  return slice_gaussian(normalized_halves(r), s);
}

// 10 s; most mean times lie up to 200 s outside.
TestScene outside_scene(uint64_t count) {
  SceneOptions s;
  s.count = count;
  s.sh_degree = 0;
  s.num_frames = 300;
  s.permanent = 0;
  s.outside = 0.8;
  s.seed = 141;
  return make_scene(s);
}

// ---- drift -------------------------------------------------------------------------------------

// The largest distance of every decoded Gaussian from the original while it is visible, in units of
// the extent of the scene.
std::vector<double> drifts(bool closed_loop) {
  const TestScene scene = outside_scene(4000);
  EncodeOptions o;
  o.settings = {{L4D_ENC_CLOSED_LOOP, closed_loop ? 1.0 : 0.0},
                {L4D_ENC_MERGE_COUNT, 100},
                {L4D_ENC_ZSTD_LEVEL, 3}};
  const Encoded e = encode(scene, o);
  const GaussianArrays a = decode(e.bytes, all_query());
  const double begin = scene.timeline.time_begin, end = begin + scene.duration();
  float extent = 0;
  for (const float x : scene.position) extent = std::max(extent, std::fabs(x));
  std::vector<double> out;
  for (size_t i = 0; i < a.count(); ++i) {
    const size_t from = e.order[i];
    const auto was = slice_of(scene.rotor.data() + 8 * from, scene.log_scale.data() + 4 * from);
    const auto is = slice_of(a.rotor.data() + 8 * i, a.log_scale.data() + 4 * i);
    const double mean = static_cast<double>(a.mean_t[i]);
    const double reach = 4 / std::sqrt(is.lambda);
    const double reference = reference_time(scene.timeline, mean);
    const double original = reference_time(scene.timeline, static_cast<double>(scene.mean_t[from]));
    if (mean + reach < begin || mean - reach > end) continue;
    double most = 0;
    // Both move along lines: the ends decide.
    for (const double t : {std::max(begin, mean - reach), std::min(end, mean + reach)}) {
      double d[3];
      for (size_t k = 0; k < 3; ++k) {
        d[k] = static_cast<double>(a.position[3 * i + k]) + is.velocity[k] * (t - reference) -
               static_cast<double>(scene.position[3 * from + k]) - was.velocity[k] * (t - original);
      }
      most = std::max(most, std::hypot(d[0], d[1], d[2]));
    }
    out.push_back(most / static_cast<double>(extent));
  }
  return out;
}

const std::vector<double>& closed_drifts() {
  static const std::vector<double> kAll = drifts(true);
  return kAll;
}
const std::vector<double>& open_drifts() {
  static const std::vector<double> kAll = drifts(false);
  return kAll;
}

Observed drift_at(double quantile) {
  Observed o;
  o.worst = reference::quantile(closed_drifts(), quantile);
  o.cases = closed_drifts().size();
  return o;
}
// The farthest are those whose speed is worst off: the loop helps all others.
Observed drift_median() {
  Observed o = drift_at(0.5);
  o.naive = reference::quantile(open_drifts(), 0.5);
  return o;
}
Observed drift_max() { return drift_at(1.0); }
Observed drift_p999() { return drift_at(0.999); }

// ---- slices of streams -------------------------------------------------------------------------

// Positions that the decoder's slice hands out, in roundings of what they are made of. `at_mean`:
// stored where the Gaussian is at its mean time.
double slice_error(bool at_mean, Observed* o) {
  TestScene scene = outside_scene(3000);
  // A lossless stream keeps every bit, so the first SH number can say which Gaussian it is.
  for (size_t i = 0; i < scene.count(); ++i) scene.sh[3 * i] = static_cast<float>(i);
  const double begin = scene.timeline.time_begin, end = begin + scene.duration();
  std::vector<Slice4D<double>> slices;
  for (size_t i = 0; i < scene.count(); ++i) {
    slices.push_back(slice_of(scene.rotor.data() + 8 * i, scene.log_scale.data() + 4 * i));
    if (!at_mean) continue;
    const double mean = static_cast<double>(scene.mean_t[i]);
    for (size_t k = 0; k < 3; ++k) {
      float& x = scene.position[3 * i + k];
      x = static_cast<float>(static_cast<double>(x) +
                             slices[i].velocity[k] * (mean - reference_time(scene.timeline, mean)));
    }
  }
  if (at_mean) scene.flags = L4D_POSITION_AT_MEAN_TIME;
  EncodeOptions options;
  options.preset = "lossless";
  options.settings = {{L4D_ENC_ZSTD_LEVEL, 3}};
  const Encoded e = encode(scene, options);
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  double worst = 0;
  for (const double t : {begin, begin + 0.3, 0.5 * (begin + end), begin + 9.9, end}) {
    const SplatArrays s = d.slice(t);
    for (size_t j = 0; j < s.count(); ++j) {
      const size_t i = static_cast<size_t>(s.sh[3 * j]);
      const double mean = static_cast<double>(scene.mean_t[i]);
      const double reference = at_mean ? mean : reference_time(scene.timeline, mean);
      for (size_t k = 0; k < 3; ++k) {
        const double v = slices[i].velocity[k];
        const double expected =
            static_cast<double>(scene.position[3 * i + k]) + v * (t - reference);
        const double unit = std::fabs(expected) + scene.duration() * (1 + std::fabs(v));
        const double error = std::fabs(static_cast<double>(s.position[3 * j + k]) - expected);
        worst = std::max(worst, error / (kU32 * unit));
        ++o->cases;
      }
    }
  }
  return worst;
}

Observed slice_position() {
  Observed o, unused;
  o.worst = slice_error(false, &o);
  o.naive = slice_error(true, &unused);
  return o;
}

// ---- extent ------------------------------------------------------------------------------------

// A still cloud of the given radius. Decoded positions against `exact` [n, 3], relative to the
// radius; `offset` is what the encoder is given less than the exact coordinates.
double cloud_error(const std::vector<double>& exact, const double* offset, double radius) {
  SceneOptions options;
  options.count = exact.size() / 3;
  options.sh_degree = 0;
  options.permanent = 1;
  options.moving = false;
  TestScene scene = make_scene(options);
  for (size_t i = 0; i < exact.size(); ++i) {
    scene.position[i] = static_cast<float>(exact[i] - offset[i % 3]);
  }
  const Encoded e = encode(scene, small_options());
  const GaussianArrays a = decode(e.bytes, all_query());
  double worst = 0;
  for (size_t i = 0; i < a.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const double back = static_cast<double>(a.position[3 * i + k]) + offset[k];
      worst = std::max(worst, std::fabs(back - exact[3 * e.order[i] + k]));
    }
  }
  return worst / radius;
}

std::vector<double> cloud(const double* center, double radius, uint64_t seed) {
  Random random(seed);
  std::vector<double> out;
  for (int i = 0; i < 3 * 2000; ++i) {
    out.push_back(center[i % 3] + radius * (i < 6 ? (i % 2 == 0 ? 1 : -1) : random.uniform(-1, 1)));
  }
  return out;
}

Observed georeferenced() {
  static constexpr double kUtm[3] = {5.0e6, 4.0e5, 312.5};
  static constexpr double kNone[3] = {0, 0, 0};
  Observed o;
  for (const double radius : {10.0, 45.0, 99.0, 300.0}) {
    const std::vector<double> exact = cloud(kUtm, radius, 151);
    o.add(cloud_error(exact, kUtm, radius));
    o.add_naive(cloud_error(exact, kNone, radius));
  }
  return o;
}

Observed microscopic() {
  static constexpr double kNone[3] = {0, 0, 0};
  Observed o;
  for (const double radius : {1.1e-6, 1.7e-6, 3e-6}) {
    const std::vector<double> exact = cloud(kNone, radius, 152);
    o.add(cloud_error(exact, kNone, radius));
    for (const double x : exact) {
      const float half = half_to_float(float_to_half(static_cast<float>(x)));
      o.add_naive(std::fabs(static_cast<double>(half) - x) / radius);
    }
  }
  return o;
}

std::vector<Formula> list() {
  static constexpr char kOutside[] =
      "4000 moving Gaussians of a 10 s sequence, 80 % with mean times up to 200 s outside";
  static constexpr char kOpen[] = "closed loop off";
  static constexpr char kVq[] =
      "measured: what the quantisation of speeds (one stage, 8 Gaussians to a codeword) leaves";
  return {
      {"drift_max", "encoder, closed loop on", "original attributes, binary64", kOutside,
       "largest distance while visible : extent of the scene", kVq, "", 0.1, drift_max},
      {"drift_median", "encoder, closed loop on", "original attributes, binary64", kOutside,
       "distance while visible : extent of the scene, median", kVq, kOpen, 0.002, drift_median},
      {"drift_p999", "encoder, closed loop on", "original attributes, binary64", kOutside,
       "distance while visible : extent of the scene, 99.9th percentile", kVq, "", 0.05,
       drift_p999},
      {"slice_position", "l4d_decoder_slice", "binary64", kOutside,
       "error : u (|centre| + 10 s (1 + |v|))",
       "velocity of the rotor (5), of the slice (8), the product, the sum",
       "positions stored at the mean time", 8, slice_position},
      {"extent_georeferenced", "position and placement", "coordinates in binary64",
       "UTM coordinates (5e6, 4e5), radius 10 to 300 m", "error : radius",
       "half a step of binary16: 2^-12 of its power of two, which half the range exceeds",
       "absolute coordinates in binary32", 0x1p-11, georeferenced},
      {"extent_microscopic", "position", "coordinates in binary64",
       "radius 1 to 3 um; Gaussians have at least 41 nm", "error : radius",
       "half a step of binary16: 2^-12 of its power of two, which half the range exceeds",
       "binary16 of the coordinate", 0x1p-11, microscopic},
  };
}
const Register kRegister(list);

}  // namespace
}  // namespace l4d::numerics
