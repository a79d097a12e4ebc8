// SPDX-License-Identifier: Apache-2.0
// Streams on a renderer that goes from instant to instant: what it keeps never shows.
#include <gtest/gtest.h>

#include <vector>

#include "tests/common/codec.h"
#include "tests/render/scenes.h"

namespace l4d::render {
namespace {

constexpr uint32_t kWidth = 64, kHeight = 48;

std::vector<float> image_of(const RendererHandle& r) {
  return r.render(ring_camera(kWidth, kHeight, 0.3, 4));
}

std::vector<float> fresh_image(const Bytes& bytes, double time, uint32_t detail) {
  DecoderHandle decoder;
  decoder.open_memory(bytes.data(), bytes.size());
  RendererHandle r;
  r.set_decoder(decoder, {0, 0, detail, 0});
  r.set_time(time);
  return image_of(r);
}

TEST(Stream, InstantsAreThoseOfAFreshRenderer) {
  const Bytes& bytes = test::dynamic_file();
  for (const uint64_t cache : {uint64_t{0}, uint64_t{1}}) {
    l4d_decoder_options options = test::decoder_options(L4D_BACKEND_AUTO, 1);
    options.cache_bytes = cache;
    DecoderHandle decoder(&options);
    decoder.open_memory(bytes.data(), bytes.size());
    RendererHandle r;
    r.set_decoder(decoder);
    const io::Scene other = synth(500);
    std::vector<float> before;
    uint32_t step = 0;
    for (const double time : {0.1, 0.11, 1.7, 0.4, 0.4, 1.9, 0.0}) {
      const uint32_t detail = step >= 5 ? L4D_DETAIL_BASE_COLOR : L4D_DETAIL_FULL;
      if (step == 5) r.set_decoder(decoder, {0, 0, detail, 0});
      if (step == 3) {  // somebody else uses the decoder, and the renderer shows another scene
        decoder.slice(1.0);
        r.set_gaussians(other.view(), other.timeline);
        r.set_time(0.5);
        r.set_decoder(decoder);
      }
      r.set_time(time);
      const std::vector<float> image = image_of(r);
      EXPECT_EQ(image, fresh_image(bytes, time, detail)) << time;
      if (step == 1) {
        EXPECT_NE(image, before) << "the scene moves";
      }
      before = image;
      ++step;
    }
  }
}

}  // namespace
}  // namespace l4d::render
