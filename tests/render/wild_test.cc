// SPDX-License-Identifier: Apache-2.0
// Streams whose codes stand for absurd values: both paths show the same, and numbers only.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"
#include "tests/render/differences.h"
#include "tests/render/scenes.h"

namespace l4d::render {
namespace {

Bytes edited(float opacity_offset, float opacity_step, float factor) {
  test::StreamEditor editor(test::dynamic_file());
  editor.header.opacity.offset = opacity_offset;
  editor.header.opacity.step *= opacity_step;
  for (LayerHeader& layer : editor.header.layers) {
    layer.scale_factor.offset += factor;
    if (layer.permanent) layer.log_scale_t = 0x1p60f;
  }
  return editor.build();
}

bool all_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

// near: whether both images also have to agree. Where Gaussians are needles of a length of 10^7,
// neither path has the digits.
void expect_alike(const Bytes& file, bool near) {
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  RendererHandle fast = make_renderer(L4D_BACKEND_CPU);
  RendererHandle reference = make_renderer(L4D_BACKEND_REFERENCE);
  fast.set_decoder(decoder);
  reference.set_decoder(decoder);
  const double eye[3] = {-7, -2, -5}, target[3] = {0, 0, 0};
  const l4d_camera camera = call_on(90, 61, 70, eye, target);
  for (const double time : {0.0, 0.7, 1.9}) {
    fast.set_time(time);
    reference.set_time(time);
    const TestImage a = render_both(fast, camera), b = render_both(reference, camera);
    EXPECT_TRUE(all_finite(a.rgb));
    EXPECT_TRUE(all_finite(a.alpha));
    EXPECT_TRUE(all_finite(b.rgb));
    EXPECT_TRUE(all_finite(b.alpha));
    if (near) {
      EXPECT_LE(largest_difference(a.rgb, b.rgb), 1.0 / 255) << time;
      EXPECT_LE(largest_difference(a.alpha, b.alpha), 1.0 / 255) << time;
      EXPECT_GT(*std::max_element(b.alpha.begin(), b.alpha.end()), 0.5f);
    }
  }
}

TEST(Wild, OpacitiesOutOfRangeRenderAlike) { expect_alike(edited(-2, 5, 0), true); }

// Every log scale is at its limit: the squares of projected covariances are beyond binary32.
TEST(Wild, GaussiansLargerThanAnySceneRenderAlike) { expect_alike(edited(0.01f, 0.2f, 100), true); }

TEST(Wild, GaussiansOfAnySizeRenderFinitePixels) {
  for (const float factor : {-100.0f, 5.0f, 15.0f, 22.0f})
    expect_alike(edited(-2, 5, factor), false);
}

}  // namespace
}  // namespace l4d::render
