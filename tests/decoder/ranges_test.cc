// SPDX-License-Identifier: Apache-2.0
// Streams whose codes stand for opacities outside [0, 1] and for log scales beyond any scene: what
// is decoded is clamped, and what a slice hands out is finite.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/scene/attributes.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"

namespace l4d {
namespace {

using namespace test;

// Opacities from -2 up and log scales from -60 up, the last ones far above 1 and 17.
Bytes wild(const Bytes& file) {
  StreamEditor editor(file);
  editor.header.opacity.offset = -2;
  editor.header.opacity.step *= 5;
  for (LayerHeader& layer : editor.header.layers) {
    layer.scale_factor.offset = layer.permanent ? 60.0f : -60.0f;
    layer.scale_factor.step *= 30;
    if (layer.permanent) layer.log_scale_t = 0x1p60f;
  }
  return editor.build();
}

bool all_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

TEST(Ranges, DecodedOpacitiesAndLogScalesAreClamped) {
  for (const Bytes* file : {&dynamic_file(), &staged_file(), &transform_file()}) {
    const Bytes bytes = wild(*file);
    const GaussianArrays all = decode(bytes, all_query(), L4D_BACKEND_REFERENCE);
    EXPECT_TRUE(same_bits(all, decode(bytes, all_query(), L4D_BACKEND_CPU)));
    const auto [least, most] = std::minmax_element(all.opacity.begin(), all.opacity.end());
    EXPECT_EQ(*least, 0.0f);
    EXPECT_EQ(*most, 1.0f);
    const auto [small, large] = std::minmax_element(all.log_scale.begin(), all.log_scale.end());
    EXPECT_EQ(*small, -kMaxLogScale);
    EXPECT_EQ(*large, kMaxLogScale);
    // What a stream decodes to is a scene.
    l4d_gaussians view{};
    view.count = all.opacity.size();
    view.sh_degree = 0;
    view.position = all.position.data();
    view.mean_t = all.mean_t.data();
    view.log_scale = all.log_scale.data();
    view.rotor = all.rotor.data();
    view.opacity = all.opacity.data();
    view.sh = all.sh.data();
    for (size_t i = 0; i < view.count; ++i) ASSERT_EQ(invalid_attribute(view, i), nullptr) << i;
  }
}

TEST(Ranges, SlicesOfWildStreamsAreFinite) {
  for (const Bytes* file : {&dynamic_file(), &staged_file(), &transform_file()}) {
    const Bytes bytes = wild(*file);
    DecoderHandle d;
    d.open_memory(bytes.data(), bytes.size());
    size_t shown = 0;
    for (const double time : {0.0, 0.4, 0.9, 1.7}) {
      const SplatArrays s = d.slice(time);
      EXPECT_TRUE(all_finite(s.position));
      EXPECT_TRUE(all_finite(s.covariance));
      EXPECT_TRUE(all_finite(s.opacity));
      for (const float o : s.opacity) EXPECT_TRUE(o >= 0 && o <= 1) << o;
      shown += s.opacity.size();
    }
    EXPECT_GT(shown, 0u);
  }
}

// A raw rotor may be so large that its halves overflow: its Gaussian is left out, no other is.
TEST(Ranges, GaussiansThatAreNotFiniteAreNotShown) {
  StreamEditor editor(lossless_file());
  const auto place = editor.find([](const LayerHeader& l) { return l.level == 0; });
  ASSERT_FALSE(editor.at(place).page.pages.empty());
  size_t broken = 0;
  for (const char* name : {"rotor_spatial.raw.0", "rotor_temporal.raw.3"}) {
    const PageStream s = editor.stream(place, 0, name);
    broken = s.n;
    editor.replace_stream(place, 0, name,
                          packed_stream(std::vector<uint32_t>(s.n, order_float(3e38f)), 32));
  }
  ASSERT_GT(broken, 0u);
  const Bytes bytes = editor.build();
  DecoderHandle d, sound;
  d.open_memory(bytes.data(), bytes.size());
  sound.open_memory(lossless_file().data(), lossless_file().size());
  bool fewer = false;
  for (const double time : {0.0, 0.5, 1.0, 1.5}) {
    const SplatArrays s = d.slice(time), whole = sound.slice(time);
    EXPECT_TRUE(all_finite(s.position));
    EXPECT_TRUE(all_finite(s.covariance));
    EXPECT_TRUE(all_finite(s.opacity));
    EXPECT_LE(whole.opacity.size() - s.opacity.size(), broken);
    fewer = fewer || s.opacity.size() < whole.opacity.size();
    // The others are what they were, in their order.
    size_t at = 0;
    for (size_t i = 0; i < s.opacity.size(); ++i, ++at) {
      const auto same = [&] {
        return std::equal(s.position.begin() + static_cast<std::ptrdiff_t>(3 * i),
                          s.position.begin() + static_cast<std::ptrdiff_t>(3 * i + 3),
                          whole.position.begin() + static_cast<std::ptrdiff_t>(3 * at)) &&
               std::equal(s.covariance.begin() + static_cast<std::ptrdiff_t>(6 * i),
                          s.covariance.begin() + static_cast<std::ptrdiff_t>(6 * i + 6),
                          whole.covariance.begin() + static_cast<std::ptrdiff_t>(6 * at));
      };
      while (at < whole.opacity.size() && !same()) ++at;
      ASSERT_LT(at, whole.opacity.size());
    }
  }
  EXPECT_TRUE(fewer);
}

}  // namespace
}  // namespace l4d
