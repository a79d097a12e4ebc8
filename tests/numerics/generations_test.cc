// SPDX-License-Identifier: Apache-2.0
// How far a decoded number may be from the one that was given, from what the stream declares; and
// what a second generation adds.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cmath>

#include "l4d/experimental/packed.h"
#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/layers.h"
#include "tests/common/codec.h"
#include "tests/numerics/arbitrary_scene.h"

namespace l4d::numerics {
namespace {

using namespace test;

// Half a step of binary16 at x.
double half_step(double x) {
  const double magnitude = std::max(std::fabs(x), 0x1p-14);
  return std::ldexp(1.0, std::ilogb(magnitude) - 11);
}

double wide(float x) { return static_cast<double>(x); }

// All vectors escape, no closed loop: every error is a rounding that the stream declares.
TEST(Property, ErrorsAreWithinWhatIsDeclared) {
  EXPECT_TRUE(rc::check("declared", [] {
    ArbitraryScene drawn = draw_scene(true);
    drawn.flags = 0;
    drawn.encode.stages.clear();
    // The gauge would permute scales, and a rotor is one of two.
    drawn.encode.settings.push_back({L4D_ENC_GAUGE, 0});
    drawn.encode.settings.push_back({L4D_ENC_CLOSED_LOOP, 0});
    drawn.encode.settings.push_back({L4D_ENC_ESCAPE_THRESHOLD, 0.5});
    drawn.encode.settings.push_back({L4D_ENC_FIXED_POSITIONS, 0});  // binary16
    const TestScene scene = drawn.make();
    const std::vector<float> ones(scene.count(), 1.0f);
    for (uint32_t w = L4D_WEIGHT_SH; w <= L4D_WEIGHT_ROTOR_TEMPORAL; ++w) {
      drawn.encode.weights.emplace_back(w, &ones);
    }
    const Encoded e = encode(scene, drawn.encode);
    DecoderHandle d;
    d.open_memory(e.bytes.data(), e.bytes.size());
    const GaussianArrays a = d.decode(all_query());
    const size_t sh_dim = scene.sh_dim();
    for (const l4d_bucket_span& r : a.spans) {
      l4d_dequantization q = L4D_INIT(l4d_dequantization);
      d.check(l4d_decoder_get_dequantization(d.get(), r.layer, &q));
      const l4d_layer_info layer = d.layer_info(r.layer);
      for (size_t i = r.first; i < r.first + r.count; ++i) {
        const size_t from = e.order[i];
        for (size_t k = 0; k < 3; ++k) {
          const double given = wide(scene.position[3 * from + k]);
          const double coded = (given - wide(q.position_center[k])) / wide(q.position_scale);
          const double allowed = half_step(coded) * wide(q.position_scale);
          RC_ASSERT(std::fabs(wide(a.position[3 * i + k]) - given) <=
                    allowed * (1 + 1e-5) + std::fabs(given) * 0x1p-23);
        }
        const double opacity = std::fabs(wide(a.opacity[i]) - wide(scene.opacity[from]));
        RC_ASSERT(opacity <= wide(q.opacity_step) / 2 + 0x1p-22);
        for (size_t k = 0; k < sh_dim; ++k) {
          const double given = wide(scene.sh[sh_dim * from + k]);
          RC_ASSERT(std::fabs(wide(a.sh[sh_dim * i + k]) - given) <= half_step(given) * 1.000001);
        }
        for (size_t k = 0; k < (layer.permanent != 0 ? 3u : 4u); ++k) {
          const double given = wide(scene.log_scale[4 * from + k]);
          const double back = wide(a.log_scale[4 * i + k]);
          // The rest after the scale factor, whose code has no error left.
          RC_ASSERT(std::fabs(back - given) <= half_step(64) * 0.5 + 1e-5);
        }
        if (layer.permanent != 0) continue;
        float unit[8];
        normalize_rotor(scene.rotor.data() + 8 * from, unit);
        for (size_t k = 0; k < 8; ++k) {
          RC_ASSERT(std::fabs(wide(a.rotor[8 * i + k]) - wide(unit[k])) <= 0x1p-9);
        }
        const double mean = wide(scene.mean_t[from]);
        const double coded = (mean - r.center) / r.width;
        RC_ASSERT(std::fabs(r.center + wide(a.mean_t_local[i]) - mean) <=
                  r.width * (half_step(coded) * 1.000001 + std::fabs(coded) * 0x1p-23));
      }
    }
  }));
}

// What was decoded, as a scene.
TestScene scene_of(const GaussianArrays& a, const l4d_timeline& timeline) {
  TestScene s;
  s.timeline = timeline;
  s.sh_degree = a.sh_degree;
  s.flags = a.flags;
  s.position = a.position;
  s.mean_t = a.mean_t;
  s.log_scale = a.log_scale;
  s.rotor = a.rotor;
  s.opacity = a.opacity;
  s.sh = a.sh;
  return s;
}

// Root mean squares of the differences, where order[i] is the original of Gaussian i.
struct Difference {
  double position = 0, opacity = 0, sh = 0, log_scale = 0;
};
Difference difference(const TestScene& was, const GaussianArrays& is,
                      const std::vector<uint32_t>& order) {
  const auto rms = [&](const std::vector<float>& a, const std::vector<float>& b, size_t dim,
                       size_t first_of, size_t used) {
    double sum = 0;
    for (size_t i = 0; i < order.size(); ++i) {
      for (size_t k = first_of; k < used; ++k) {
        const double e = wide(a[dim * i + k]) - wide(b[dim * order[i] + k]);
        sum += e * e;
      }
    }
    return std::sqrt(sum / static_cast<double>(order.size() * (used - first_of)));
  };
  return {rms(is.position, was.position, 3, 0, 3), rms(is.opacity, was.opacity, 1, 0, 1),
          rms(is.sh, was.sh, was.sh_dim(), 0, was.sh_dim()),
          rms(is.log_scale, was.log_scale, 4, 0, 3)};
}

TEST(Property, ASecondGenerationIsStable) {
  EXPECT_TRUE(rc::check("generations", [] {
    ArbitraryScene drawn = draw_scene(true);
    drawn.scene.count += 400;
    drawn.flags = 0;
    drawn.encode.stages.clear();
    // In their gauge already, scales are not permuted again.
    drawn.encode.settings.push_back({L4D_ENC_GAUGE, 1});
    drawn.encode.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 256});
    drawn.encode.settings.push_back({L4D_ENC_KMEANS_ITERATIONS, 5});
    drawn.encode.settings.push_back({L4D_ENC_OPACITY_BITS, 8});
    drawn.encode.settings.push_back({L4D_ENC_SCALE_FACTOR_BITS, 8});
    // Bounds mend other Gaussians in each generation.
    drawn.encode.settings.push_back({L4D_ENC_MAX_POSITION_ERROR, 0});
    drawn.encode.settings.push_back({L4D_ENC_MAX_COVARIANCE_FACTOR, 0});
    drawn.encode.settings.push_back({L4D_ENC_MAX_OPACITY_ERROR, 0});
    drawn.encode.settings.push_back({L4D_ENC_MAX_BASE_COLOR_ERROR, 0});
    drawn.encode.settings.push_back({L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR, 0});
    drawn.encode.settings.push_back({L4D_ENC_FIXED_POSITIONS, 0});  // binary16
    const TestScene first = drawn.make();
    const Encoded a = encode(first, drawn.encode);
    const GaussianArrays decoded_a = decode(a.bytes, all_query());
    const TestScene second = scene_of(decoded_a, first.timeline);
    const Encoded b = encode(second, drawn.encode);
    RC_ASSERT(validate(b.bytes).empty());
    const double sizes[2] = {static_cast<double>(a.bytes.size()),
                             static_cast<double>(b.bytes.size())};
    RC_LOG() << sizes[0] << " and " << sizes[1] << " bytes\n";
    const GaussianArrays decoded_b = decode(b.bytes, all_query());
    const Difference once = difference(first, decoded_a, a.order);
    const Difference again = difference(second, decoded_b, b.order);
    RC_LOG() << "position " << once.position << " " << again.position << ", opacity "
             << once.opacity << " " << again.opacity << ", sh " << once.sh << " " << again.sh
             << ", log scale " << once.log_scale << " " << again.log_scale << "\n";
    // So few are mostly codebooks, which take longer for rotors that were normalised together.
    RC_ASSERT(sizes[1] <= 1.08 * sizes[0]);
    RC_ASSERT(again.position <= 1.05 * once.position + 1e-6);
    RC_ASSERT(again.opacity <= 1.05 * once.opacity + 1e-6);
    RC_ASSERT(again.sh <= 1.05 * once.sh + 1e-6);
    RC_ASSERT(again.log_scale <= 1.05 * once.log_scale + 1e-6);
  }));
}

// Files of the second and third generation, in parts of the one before.
void expect_sizes(bool fixed_positions, bool bounds, double least, double most) {
  for (const uint64_t count : {uint64_t{2000}, uint64_t{12000}}) {
#ifdef L4D_SANITIZED
    if (count > 2000) continue;  // sizes are measured without sanitizers, too
#endif
    SceneOptions options;
    options.count = count;
    options.num_frames = 300;
    TestScene scene = make_scene(options);
    EncodeOptions o;
    o.settings = {{L4D_ENC_CODEBOOK_SIZE, 512},
                  // Far from what the finest layer has: if it falls below, two layers become one.
                  {L4D_ENC_MERGE_COUNT, bounds ? 100.0 : 400.0},
                  {L4D_ENC_ZSTD_LEVEL, 3},
                  {L4D_ENC_CODEBOOKS_BY_COST, 0},
                  {L4D_ENC_FIXED_POSITIONS, fixed_positions ? 1.0 : 0.0},
                  {L4D_ENC_MAX_BASE_COLOR_ERROR, 0},
                  {L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR, 0}};
    if (!bounds) {
      o.settings.insert(o.settings.end(), {{L4D_ENC_MAX_POSITION_ERROR, 0},
                                           {L4D_ENC_MAX_COVARIANCE_FACTOR, 0},
                                           {L4D_ENC_MAX_OPACITY_ERROR, 0}});
    }
    double before = 0;
    for (int generation = 0; generation < 3; ++generation) {
      const Encoded e = encode(scene, o);
      const double bytes = static_cast<double>(e.bytes.size());
      if (generation > 0) {
        EXPECT_LE(bytes / before, most) << count << ", generation " << generation;
        EXPECT_GE(bytes / before, least) << count << ", generation " << generation;
      }
      before = bytes;
      scene = scene_of(decode(e.bytes, all_query()), scene.timeline);
    }
  }
}

TEST(Generations, KeepTheirSize) { expect_sizes(false, false, 0.99, 1.01); }
TEST(Generations, KeepTheirSizeWithFixedPositions) { expect_sizes(true, false, 0.99, 1.01); }
// What the first generation mended at some cost is within the bounds from there on.
TEST(Generations, ShrinkALittleWithinBounds) {
  expect_sizes(false, true, 0.97, 1.005);
  expect_sizes(true, true, 0.97, 1.005);
}

// The code of the largest opacity may not round to more than 1, which no scene may hold.
TEST(Generations, OpaqueGaussiansCanBeEncodedAgain) {
  // 0.198695734 is one of those for which low + ((1 - low) / 3) * 3 is above 1.
  for (const float low : {0.198695734f, 0.0f, 0.1f, 0.25f}) {
    for (const int bits : {2, 4, 8, 12}) {
      SceneOptions options;
      options.count = 200;
      TestScene scene = make_scene(options);
      for (size_t i = 0; i < scene.count(); ++i) scene.opacity[i] = i % 2 == 0 ? low : 1.0f;
      EncodeOptions o = small_options();
      o.settings.push_back({L4D_ENC_OPACITY_BITS, static_cast<double>(bits)});
      o.settings.push_back({L4D_ENC_CLOSED_LOOP, 0});
      const GaussianArrays a = decode(encode(scene, o).bytes, all_query());
      EXPECT_LE(*std::max_element(a.opacity.begin(), a.opacity.end()), 1.0f)
          << low << " to 1 with " << bits << " bits";
      EXPECT_NO_THROW(encode(scene_of(a, scene.timeline), o)) << low << ", " << bits << " bits";
    }
  }
}

}  // namespace
}  // namespace l4d::numerics
