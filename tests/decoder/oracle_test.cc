// SPDX-License-Identifier: Apache-2.0
// l4d_decoder_slice against brute force: of all Gaussians that a stream decodes to, those visible
// at the instant, where they are, what shape and opacity they have, in double from the definitions.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/math/reference.h"

namespace l4d {
namespace {

using namespace test;
using reference::Real;

// One Gaussian of the stream, as the definitions have it: Sigma = R diag(exp(2 log_scale)) R^T.
struct Model {
  double mean, reference;
  double lambda;
  double velocity[3];
  Real covariance[6];
  double opacity;
  bool permanent;
  double error;  // what binary32 may make of one row of R diag(exp(log_scale))
};

std::vector<Model> models(const DecoderHandle& d, const GaussianArrays& a) {
  const l4d_info info = d.info();
  const double begin = info.timeline.time_begin, end = begin + info.duration;
  std::vector<Model> out(a.count());
  for (const l4d_bucket_span& r : a.spans) {
    l4d_layer_info layer = L4D_INIT(l4d_layer_info);
    d.check(l4d_decoder_get_layer_info(d.get(), r.layer, &layer));
    for (size_t i = r.first; i < r.first + r.count; ++i) {
      Model& m = out[i];
      m.permanent = layer.permanent != 0;
      m.mean = r.center + static_cast<double>(a.mean_t_local[i]);
      EXPECT_NEAR(m.mean, static_cast<double>(a.mean_t[i]), 1e-6 * (1 + std::fabs(m.mean)));
      m.reference = (a.flags & L4D_POSITION_AT_MEAN_TIME) != 0 ? m.mean
                    : m.mean < begin                           ? begin
                    : m.mean > end                             ? end
                                                               : m.mean;
      Real sigma[4][4], rotation[4][4];
      reference::covariance4(a.rotor.data() + 8 * i, a.log_scale.data() + 4 * i, sigma);
      m.lambda = static_cast<double>(1 / std::max(sigma[3][3], Real(1e-12)));
      for (int k = 0; k < 3; ++k) {
        m.velocity[k] = static_cast<double>(sigma[k][3] * Real(m.lambda));
      }
      // Minors, not a Schur complement: long-lived Gaussians would lose all digits.
      reference::matrix(reference::normalize(reference::load(a.rotor.data() + 8 * i)), rotation);
      Real rows[16];
      double largest = 0;
      for (size_t k = 0; k < 16; ++k) {
        const Real scale = std::exp(Real(a.log_scale[4 * i + k % 4]));
        rows[k] = rotation[k / 4][k % 4] * scale;
        largest = std::max(largest, static_cast<double>(scale));
      }
      reference::minors(rows, m.covariance);
      m.error = 6e-7 * largest;
      const double o = static_cast<double>(a.opacity[i]);
      m.opacity = (a.flags & L4D_OPACITY_LOGIT) != 0 ? 1 / (1 + std::exp(-o)) : o;
    }
  }
  return out;
}

// What an oracle says that never says anything else is worth nothing: these must not be 0.
struct Seen {
  size_t still = 0, moved = 0, faded = 0, permanent = 0, hidden = 0, doubtful = 0;
};

void expect_gaussian(const GaussianArrays& a, size_t i, const Model& m, double center, double t,
                     const SplatArrays& s, size_t at, Seen* seen) {
  const double dt = t - m.mean;
  double moved = 0;
  for (size_t k = 0; k < 3; ++k) {
    const double way = m.velocity[k] * (t - m.reference);
    const double p = static_cast<double>(a.position[3 * i + k]);
    // A row of R diag(scale) is off by m.error, and the velocity is a quotient of rows.
    const double slack = 4 * m.error * std::sqrt(m.lambda) + 1e-6 * std::fabs(m.velocity[k]);
    EXPECT_NEAR(s.position[3 * at + k], p + way,
                1e-6 * (std::fabs(p) + 1) + slack * std::fabs(t - m.reference) +
                    1e-6 * std::fabs(m.velocity[k] * (t - center)))
        << "position " << k << " of Gaussian " << i;
    moved = std::max(moved, std::fabs(way));
  }
  const double size =
      static_cast<double>(std::sqrt(m.covariance[0] + m.covariance[3] + m.covariance[5]));
  const double slack = 4 * m.error * (size + m.error);
  for (size_t k = 0; k < 6; ++k) {
    EXPECT_NEAR(s.covariance[6 * at + k], static_cast<double>(m.covariance[k]), slack)
        << "covariance " << k << " of Gaussian " << i;
  }
  const double exponent = m.permanent ? 0 : -0.5 * m.lambda * dt * dt;
  const double want = m.opacity * std::exp(exponent);
  const double late = 1e-6 * (std::fabs(dt) + std::fabs(t - center));
  EXPECT_NEAR(s.opacity[at], want, 4e-6 + want * (m.lambda * std::fabs(dt) * late + 1e-5))
      << "opacity of Gaussian " << i;
  EXPECT_GE(s.opacity[at], 0.0f);
  EXPECT_LE(s.opacity[at], 1.0f);
  seen->permanent += m.permanent;
  seen->faded += exponent < -0.1;
  seen->moved += moved > 0.01;
  seen->still += moved == 0;
}

// Slices come in the order of the whole stream. A Gaussian whose visibility hangs on rounding may
// be there or not.
void expect_slice(const DecoderHandle& d, const GaussianArrays& a, const std::vector<Model>& m,
                  double time, Seen* seen) {
  const l4d_info info = d.info();
  const double begin = info.timeline.time_begin;
  const double t = std::min(std::max(time, begin), begin + info.duration);
  const SplatArrays s = d.slice(time);
  const size_t sh = 3 * (a.sh_degree + 1) * (a.sh_degree + 1);
  size_t at = 0;
  for (const l4d_bucket_span& r : a.spans) {
    for (size_t i = r.first; i < r.first + r.count; ++i) {
      const double dt = t - m[i].mean;
      const double exponent = m[i].permanent ? 0 : m[i].lambda * dt * dt;
      const bool same_colour =
          at < s.count() &&
          std::memcmp(a.sh.data() + sh * i, s.sh.data() + sh * at, sh * sizeof(float)) == 0;
      if (std::fabs(exponent - 16) < 16e-4) {
        ++seen->doubtful;
        if (!same_colour) continue;
      } else if (exponent > 16) {
        ++seen->hidden;
        continue;
      }
      ASSERT_LT(at, s.count()) << "Gaussian " << i << " is visible, exponent " << exponent;
      ASSERT_TRUE(same_colour) << "Gaussian " << i << " of layer " << r.layer << ", bucket "
                               << r.bucket << " is visible, exponent " << exponent;
      expect_gaussian(a, i, m[i], r.center, t, s, at, seen);
      ASSERT_FALSE(testing::Test::HasFailure()) << "time " << time;
      ++at;
    }
  }
  EXPECT_EQ(at, s.count()) << "time " << time << ": more than is visible";
}

class Oracle : public testing::TestWithParam<NamedFile> {};

TEST_P(Oracle, SlicesAreWhatTheDefinitionsSay) {
  const Bytes& bytes = GetParam().bytes();
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 2);
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  DecoderHandle whole(&o);
  whole.open_memory(bytes.data(), bytes.size());
  const GaussianArrays a = whole.decode(all_query());
  const std::vector<Model> m = models(whole, a);
  const l4d_info info = d.info();
  const double begin = info.timeline.time_begin;
  // The ends, beyond them, frames, and times between frames, there and back.
  std::vector<double> times = {begin, begin + info.duration, begin - 7, begin + info.duration + 7};
  Random random(3);
  for (uint32_t k = 0; k < info.timeline.num_frames; k += 4) {
    times.push_back(begin + static_cast<double>(k) * info.timeline.fps_den / info.timeline.fps_num);
  }
  for (int k = 0; k < 12; ++k) times.push_back(begin + info.duration * random.uniform());
  Seen seen;
  for (const double t : times) {
    expect_slice(d, a, m, t, &seen);
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_GT(seen.still + seen.moved, 1000u);
  EXPECT_GT(seen.hidden, 1000u);
  EXPECT_GT(seen.faded, 100u);
  EXPECT_LT(seen.doubtful, 100u);
  const std::string name = GetParam().name;
  if (name != "flicker" && name != "wandering") {
    EXPECT_GT(seen.moved, 100u);
  }
  if (name == "indexed" || name == "transform" || name == "staged") {
    EXPECT_GT(seen.permanent, 100u);
  }
}

Bytes encoded(const SceneOptions& scene, const char* preset, bool rans, uint32_t flags = 0) {
  TestScene s = make_scene(scene);
  s.flags = flags;
  if ((flags & L4D_OPACITY_LOGIT) != 0) {
    for (float& o : s.opacity) o = std::log(o / (1.0001f - o));
  }
  EncodeOptions o;
  o.preset = preset;
  o.rans = rans;
  o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 128}, {L4D_ENC_PRUNE_COST, 0}};
  return encode(s, o).bytes;
}

// A sequence that begins at 100 s, of frames that are no binary fractions.
SceneOptions late_scene() {
  SceneOptions s;
  s.count = 1500;
  s.time_begin = 100;
  s.num_frames = 90;
  s.fps_num = 30000;
  s.fps_den = 1001;
  s.seed = 7;
  return s;
}

const Bytes& logit_file() {  // float32 bits, opacities as logits, positions at mean times
  static const Bytes kBytes =
      encoded(late_scene(), "lossless", false, L4D_OPACITY_LOGIT | L4D_POSITION_AT_MEAN_TIME);
  return kBytes;
}
const Bytes& raw_file() {  // float32 bits, positions at reference times
  static const Bytes kBytes = encoded(late_scene(), "lossless", false);
  return kBytes;
}
const Bytes& archive_file() {
  static const Bytes kBytes = encoded(late_scene(), "archive", true);
  return kBytes;
}
const Bytes& flicker_file() {  // nothing lives longer than a few frames
  static const Bytes kBytes = [] {
    SceneOptions o;
    o.permanent = 0;
    o.outside = 0;
    o.moving = false;
    TestScene s = make_scene(o);
    Random random(11);
    for (size_t i = 0; i < s.count(); ++i) {
      s.log_scale[4 * i + 3] = static_cast<float>(std::log(random.uniform(0.005, 0.05)));
    }
    EncodeOptions e = small_options();
    return encode(s, e).bytes;
  }();
  return kBytes;
}

INSTANTIATE_TEST_SUITE_P(
    Streams, Oracle,
    testing::Values(NamedFile{"indexed", dynamic_file}, NamedFile{"staged", staged_file},
                    NamedFile{"transform", transform_file}, NamedFile{"archive", archive_file},
                    NamedFile{"raw", raw_file}, NamedFile{"logit", logit_file},
                    NamedFile{"flicker", flicker_file}, NamedFile{"wandering", wandering_file}),
    file_name);

// The oracle takes the reach of Gaussians from the stream; this is the reach that encoders give.
TEST(Reach, GaussiansAreSeenForFourStandardDeviations) {
  SceneOptions options;
  options.count = 1;
  options.sh_degree = 0;
  TestScene scene = make_scene(options);
  scene.mean_t[0] = 1;
  const float log_scale[4] = {-2, -2, -2, std::log(0.1f)};
  const float rotor[8] = {1, 0, 0, 0, 0, 0, 0, 0};
  std::copy_n(log_scale, 4, scene.log_scale.begin());
  std::copy_n(rotor, 8, scene.rotor.begin());
  for (const char* preset : {"lossless", "archive"}) {
    EncodeOptions e;
    e.preset = preset;
    const Bytes bytes = encode(scene, e).bytes;
    DecoderHandle decoder;
    decoder.open_memory(bytes.data(), bytes.size());
    for (const double side : {-1.0, 1.0}) {
      EXPECT_EQ(decoder.slice(1 + side * 0.39).count(), 1u) << preset;
      EXPECT_EQ(decoder.slice(1 + side * 0.41).count(), 0u) << preset;
    }
  }
}

}  // namespace
}  // namespace l4d
