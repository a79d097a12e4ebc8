// SPDX-License-Identifier: Apache-2.0
// Flat windows from the encoder's input to what decoders give and slices show.
#include "libl4dcodec/scene/window.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "l4d/experimental/packed.h"
#include "libl4dcodec/scene/slice.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using namespace test;

double player_time(const l4d_timeline& t, double frame) {
  return t.time_begin + frame * t.fps_den / t.fps_num;
}

// Still Gaussians, each of them in one frame.
TestScene frames_scene(uint32_t frames, uint64_t count, double time_begin = 0) {
  SceneOptions o;
  o.count = count;
  o.num_frames = frames;
  o.moving = false;
  o.permanent = 1;
  o.time_begin = time_begin;
  TestScene scene = make_scene(o);
  for (uint64_t i = 0; i < count; ++i) {
    const auto frame = static_cast<uint32_t>(i * frames / count);
    scene.window.push_back(frame);
    scene.window.push_back(frame + 1);
  }
  return scene;
}

std::array<uint32_t, 2> window_of(const std::vector<uint32_t>& windows, size_t i) {
  return {windows[2 * i], windows[2 * i + 1]};
}

void expect_valid(const Bytes& bytes) {
  for (const Violation& v : validate(bytes)) ADD_FAILURE() << v.clause << ": " << v.message;
}

// Every Gaussian decodes with its own window, and slices show at each frame those whose windows
// hold it, and no other.
void expect_windows(const TestScene& scene, const Encoded& encoded, bool still) {
  expect_valid(encoded.bytes);
  const GaussianArrays all = decode(encoded.bytes, all_query());
  ASSERT_EQ(all.count(), encoded.order.size());
  for (size_t j = 0; j < all.count(); ++j) {
    ASSERT_EQ(window_of(all.window, j), window_of(scene.window, encoded.order[j])) << j;
    const auto [begin, end] = window_of(all.window, j);
    ASSERT_EQ(all.mean_t_double[j], window_middle(scene.timeline, {begin, end}));
  }
  for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU}) {
    const l4d_decoder_options options = decoder_options(backend, 2);
    DecoderHandle decoder(&options);
    decoder.open_memory(encoded.bytes.data(), encoded.bytes.size());
    const uint32_t frames = scene.timeline.num_frames;
    for (uint32_t k = 0; k < frames; k += std::max(1u, frames / 37)) {
      std::map<std::array<float, 3>, int> left;
      size_t count = 0;
      for (size_t j = 0; j < all.count(); ++j) {
        if (!FrameWindow{all.window[2 * j], all.window[2 * j + 1]}.holds(k)) continue;
        ++count;
        const float* p = &all.position[3 * j];
        ++left[{p[0], p[1], p[2]}];
      }
      for (const double part : {0.0, 0.37, 0.999}) {
        const SplatArrays shown = decoder.slice(player_time(scene.timeline, k + part));
        ASSERT_EQ(shown.count(), count) << "frame " << k << " and " << part;
        auto rest = left;
        for (size_t m = 0; still && m < shown.count(); ++m) {
          const float* p = &shown.position[3 * m];
          ASSERT_GT(rest[(std::array<float, 3>{p[0], p[1], p[2]})]--, 0);
        }
      }
    }
  }
}

TEST(Windows, EachFrameShowsItsOwn) {
  for (const uint32_t frames : {1u, 2u, 30u, 32u, 61u}) {
    const TestScene scene = frames_scene(frames, 20 * frames);
    for (const char* preset : {"default", "indexed", "lossless", "tiny"}) {
      SCOPED_TRACE(std::string(preset) + ", " + std::to_string(frames) + " frames");
      EncodeOptions o;
      o.preset = preset;
      o.rans = std::string(preset) == "default";
      o.settings = {{L4D_ENC_MERGE_COUNT, frames == 61 ? 1e6 : 0}, {L4D_ENC_MERGE_FRACTION, 0}};
      expect_windows(scene, encode(scene, o), true);
    }
  }
}

TEST(Windows, SinceTheEpochToo) {
  expect_windows(frames_scene(48, 480, 1.7e9),
                 encode(frames_scene(48, 480, 1.7e9), EncodeOptions()), true);
}

TEST(Windows, OfAnyLengthAndInMotion) {
  SceneOptions o;
  o.count = 900;
  o.num_frames = 77;
  o.fps_num = 30000;
  o.fps_den = 1001;
  o.permanent = o.outside = 0;
  TestScene scene = make_scene(o);
  Random random(5);
  for (size_t i = 0; i < scene.count(); ++i) {
    const auto begin = static_cast<uint32_t>(random.uniform(0, 76.9));
    const auto length = static_cast<uint32_t>(random.uniform(0, 77.0 - begin)) + 1;
    scene.window.insert(scene.window.end(), {begin, std::min(77u, begin + length)});
  }
  for (const char* preset : {"default", "lossless"}) {
    EncodeOptions options;
    options.preset = preset;
    options.settings = {{L4D_ENC_MERGE_COUNT, 0}, {L4D_ENC_MERGE_FRACTION, 0}};
    const Encoded encoded = encode(scene, options);
    expect_windows(scene, encoded, false);
    // In the middle of its window a Gaussian is where the input has it then.
    const GaussianArrays all = decode(encoded.bytes, all_query());
    for (size_t j = 0; j < all.count(); ++j) {
      const size_t i = encoded.order[j];
      const auto slice = slice_attributes<double>(&scene.rotor[8 * i], &scene.log_scale[4 * i]);
      const double reference =
          std::clamp(static_cast<double>(scene.mean_t[i]), 0.0, scene.duration());
      for (size_t k = 0; k < 3; ++k) {
        const double want = static_cast<double>(scene.position[3 * i + k]) +
                            slice.velocity[k] * (all.mean_t_double[j] - reference);
        ASSERT_NEAR(static_cast<double>(all.position[3 * j + k]), want,
                    0.02 + 1e-3 * std::fabs(want));
      }
    }
  }
}

TEST(Windows, TheLongestSequence) {
  constexpr uint32_t kLast = L4D_MAX_FRAMES;
  TestScene scene = frames_scene(kLast, 6);
  scene.timeline.fps_den = 0xfffffffb;
  scene.window = {0, kLast, 1000001, 12000003, kLast - 1, kLast, 0, 1, 65535, 65537, 5, 8388609};
  EncodeOptions o;
  o.preset = "lossless";
  for (const double merge : {0.0, 1e6}) {
    o.settings = {{L4D_ENC_MERGE_COUNT, merge}, {L4D_ENC_MERGE_FRACTION, 0}};
    const Encoded encoded = encode(scene, o);
    expect_valid(encoded.bytes);
    DecoderHandle decoder;
    decoder.open_memory(encoded.bytes.data(), encoded.bytes.size());
    const GaussianArrays all = decoder.decode(all_query());
    for (size_t j = 0; j < all.count(); ++j) {
      EXPECT_EQ(window_of(all.window, j), window_of(scene.window, encoded.order[j]));
    }
    for (const uint32_t k : {0u, 1u, 4u, 5u, 65534u, 65535u, 65536u, 65537u, 1000000u, 1000001u,
                             8388608u, 8388609u, 12000002u, 12000003u, kLast - 2, kLast - 1}) {
      size_t want = 0;
      for (size_t i = 0; i < scene.count(); ++i) {
        want += FrameWindow{scene.window[2 * i], scene.window[2 * i + 1]}.holds(k);
      }
      EXPECT_EQ(decoder.slice(player_time(scene.timeline, k)).count(), want) << k;
    }
  }
}

// Windows, falloffs and permanent Gaussians in one scene: the others are as they are alone.
TEST(Windows, BesideOtherGaussians) {
  SceneOptions o;
  o.count = 2100;
  TestScene scene = make_scene(o);
  for (uint32_t i = 0; i < scene.count(); ++i) {
    const bool flat = i >= 1500;
    scene.window.push_back(flat ? i % 60 : 0);
    scene.window.push_back(flat ? i % 60 + 1 : 0);
  }
  for (const char* preset : {"default", "indexed", "lossless"}) {
    EncodeOptions options = small_options();
    options.preset = preset;
    const Encoded encoded = encode(scene, options);
    expect_valid(encoded.bytes);
    DecoderHandle decoder;
    decoder.open_memory(encoded.bytes.data(), encoded.bytes.size());
    EXPECT_NE(decoder.info().tools & L4D_TOOL_FLAT_WINDOWS, 0u);
    const GaussianArrays all = decoder.decode(all_query());
    for (size_t j = 0; j < all.count(); ++j) {
      ASSERT_EQ(window_of(all.window, j), window_of(scene.window, encoded.order[j]));
    }
    // The columns that renderers take hold as many.
    for (const double t : {0.0, 0.51, 1.0, 1.999}) {
      l4d_splat_columns columns = L4D_INIT(l4d_splat_columns);
      decoder.check(slice_columns(decoder.get(), t, &columns));
      const uint64_t in_columns = columns.count;
      EXPECT_EQ(decoder.slice(t).count(), in_columns) << t;
    }
  }
}

TEST(Windows, ThePackedForm) {
  const TestScene scene = frames_scene(30, 300);
  EncodeOptions options;
  options.settings = {{L4D_ENC_PROFILE, L4D_PROFILE_INDEXED}};
  const Encoded encoded = encode(scene, options);
  DecoderHandle decoder;
  decoder.open_memory(encoded.bytes.data(), encoded.bytes.size());
  EXPECT_EQ(decoder.info().profile, uint32_t{L4D_PROFILE_INDEXED});
  const GaussianArrays all = decoder.decode(all_query());
  std::vector<uint32_t> windows(2 * all.count(), 99);
  l4d_packed_buffers packed = L4D_INIT(l4d_packed_buffers);
  packed.capacity = all.count();
  packed.window = windows.data();
  const l4d_query query = all_query();
  decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &packed));
  EXPECT_EQ(windows, all.window);
}

// What has no windows is not touched by the arrays for them.
TEST(Windows, OfNobodyAreZeros) {
  const GaussianArrays all = decode(dynamic_file(), all_query());
  EXPECT_TRUE(all.window.empty());
  std::vector<uint32_t> windows(2 * all.count(), 99);
  DecoderHandle decoder;
  decoder.open_memory(dynamic_file().data(), dynamic_file().size());
  l4d_gaussian_buffers buffers = L4D_INIT(l4d_gaussian_buffers);
  buffers.capacity = all.count();
  buffers.window = windows.data();
  const l4d_query query = all_query();
  decoder.check(l4d_decoder_decode(decoder.get(), &query, &buffers));
  EXPECT_EQ(windows, std::vector<uint32_t>(2 * all.count(), 0));
  // A list of zeros is no list.
  SceneOptions o;
  o.count = 400;
  TestScene scene = make_scene(o);
  const Bytes without = encode(scene, EncodeOptions()).bytes;
  scene.window.assign(2 * scene.count(), 0);
  EXPECT_TRUE(encode(scene, EncodeOptions()).bytes == without);
}

TEST(Windows, InvalidOnesAreNamedOrDropped) {
  const std::array<uint32_t, 2> invalid[] = {{5, 5}, {6, 5}, {0, 31}, {31, 32}, {3, 0xffffffff}};
  for (const auto& [begin, end] : invalid) {
    TestScene scene = frames_scene(30, 60);
    scene.window[14] = begin;
    scene.window[15] = end;
    try {
      encode(scene, EncodeOptions());
      ADD_FAILURE() << begin << " to " << end;
    } catch (const Error& e) {
      EXPECT_EQ(e.status(), L4D_ERR_INVALID_SCENE);
      EXPECT_NE(std::string(e.what()).find("Gaussian 7 has an invalid window"), std::string::npos);
    }
    EncodeOptions o;
    o.settings = {{L4D_ENC_DROP_INVALID, 1}};
    EXPECT_EQ(encode(scene, o).report.invalid_dropped, 1u);
  }
  TestScene far = frames_scene(30, 60);
  far.timeline.time_begin = 0x1p37;
  EXPECT_THROW(encode(far, EncodeOptions()), Error);
}

}  // namespace
}  // namespace l4d
