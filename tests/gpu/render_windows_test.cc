// SPDX-License-Identifier: Apache-2.0
// Streams and scenes with flat windows: the host does what no kernel does, or the call fails.
#include <gtest/gtest.h>

#include <cstdint>

#include "l4d/cuda.h"
#include "l4d/render.h"
#include "tests/common/codec.h"
#include "tests/gpu/device.h"

namespace l4d::test {
namespace {

TestScene windowed_scene() {
  SceneOptions o;
  o.count = 600;
  TestScene scene = make_scene(o);
  for (uint32_t i = 0; i < scene.count(); ++i) {
    scene.window.push_back(i % 60);
    scene.window.push_back(i % 60 + 1);
  }
  return scene;
}

class Windows : public OnDevice<testing::Test> {};

TEST_F(Windows, TheHostDecodesStreams) {
  EncodeOptions options;
  options.preset = "default";
  options.rans = true;
  const Bytes bytes = encode(windowed_scene(), options).bytes;
  const GaussianArrays host = decode(bytes, all_query(), L4D_BACKEND_REFERENCE);
  const GaussianArrays device = decode(bytes, all_query(), L4D_BACKEND_CUDA);
  EXPECT_TRUE(same_bits(host, device));
  EXPECT_EQ(host.window, device.window);
}

TEST_F(Windows, DevicesRefuseThem) {
  const TestScene scene = windowed_scene();
  const Bytes bytes = encode(scene, EncodeOptions()).bytes;
  DecoderHandle decoder;
  decoder.open_memory(bytes.data(), bytes.size());
  l4d_cuda_decoder* on_device = nullptr;
  EXPECT_EQ(l4d_cuda_decoder_create(decoder.get(), 0, &on_device), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(on_device, nullptr);

  l4d_renderer_options options;
  l4d_renderer_options_init(&options);
  options.backend = L4D_BACKEND_CUDA;
  l4d_renderer* renderer = nullptr;
  ASSERT_EQ(l4d_renderer_create(&options, &renderer), L4D_OK);
  const l4d_gaussians gaussians = scene.view();
  EXPECT_EQ(l4d_renderer_set_gaussians(renderer, &gaussians, &scene.timeline),
            L4D_ERR_FEATURE_UNSUPPORTED);
  l4d_renderer_destroy(renderer);
}

}  // namespace
}  // namespace l4d::test
