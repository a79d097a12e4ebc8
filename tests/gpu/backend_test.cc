// SPDX-License-Identifier: Apache-2.0
// The CUDA backend of the ordinary API: a decoder that works on the device and fills arrays of the
// host.
#include <gtest/gtest.h>

#include <cstring>
#include <string>

#include "l4d/cuda.h"
#include "libl4dcodec/cuda/device.h"
#include "tests/common/codec.h"
#include "tests/gpu/decode_support.h"

namespace l4d {
namespace {

using test::NamedFile;

class Backend : public test::OnDevice<testing::TestWithParam<NamedFile>> {};

void expect_same_bits(const std::vector<float>& a, const std::vector<float>& b, const char* what) {
  ASSERT_EQ(a.size(), b.size()) << what;
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(float)), 0) << what;
}

TEST_P(Backend, DecodesToTheHostsBits) {
  const Bytes& bytes = GetParam().bytes();
  const l4d_decoder_options host_options = test::decoder_options(L4D_BACKEND_REFERENCE, 1);
  const l4d_decoder_options device_options = test::decoder_options(L4D_BACKEND_CUDA, 1);
  DecoderHandle host(&host_options), device(&device_options);
  host.open_memory(bytes.data(), bytes.size());
  device.open_memory(bytes.data(), bytes.size());
  for (const l4d_query& query :
       {test::all_query(), test::time_query(0.3), test::range_query(0.1, 0.4)}) {
    const GaussianArrays a = host.decode(query), b = device.decode(query);
    ASSERT_EQ(a.count(), b.count());
    expect_same_bits(a.position, b.position, "position");
    expect_same_bits(a.mean_t, b.mean_t, "mean_t");
    expect_same_bits(a.log_scale, b.log_scale, "log_scale");
    expect_same_bits(a.rotor, b.rotor, "rotor");
    expect_same_bits(a.opacity, b.opacity, "opacity");
    expect_same_bits(a.sh, b.sh, "sh");
    ASSERT_EQ(a.spans.size(), b.spans.size());
    for (size_t r = 0; r < a.spans.size(); ++r) {
      EXPECT_EQ(a.spans[r].first, b.spans[r].first);
      EXPECT_EQ(a.spans[r].count, b.spans[r].count);
      EXPECT_EQ(a.spans[r].bucket, b.spans[r].bucket);
    }
  }
}

TEST_P(Backend, OpensOneStreamAfterTheOther) {
  const l4d_decoder_options options = test::decoder_options(L4D_BACKEND_CUDA, 1);
  DecoderHandle d(&options);
  for (const Bytes* bytes : {&GetParam().bytes(), &test::tiny_file(), &GetParam().bytes()}) {
    d.open_memory(bytes->data(), bytes->size());
    EXPECT_EQ(d.decode(test::all_query()).count(), d.info().num_gaussians);
  }
}

INSTANTIATE_TEST_SUITE_P(Files, Backend,
                         testing::Values(NamedFile{"Dynamic", test::dynamic_file},
                                         NamedFile{"Staged", test::staged_file},
                                         NamedFile{"Rcq", test::rcq_file},
                                         NamedFile{"Transform", test::transform_file},
                                         NamedFile{"Lossless", test::lossless_file},
                                         NamedFile{"Tiny", test::tiny_file}),
                         test::file_name);

class BackendOfWindows : public test::OnDevice<testing::Test> {};

TEST_F(BackendOfWindows, DecodesToTheHostsBits) {
  test::EncodeOptions encoding;
  encoding.preset = "default";
  encoding.rans = true;
  const test::TestScene scene = test::windowed_scene({}, 3);
  const Bytes bytes = test::encode(scene, encoding).bytes;
  const size_t n = scene.count();
  struct Times {
    std::vector<float> mean_t, mean_t_local;
    std::vector<uint32_t> window;
    uint64_t pages_of_the_host = 0;
  };
  const auto decode = [&](uint32_t backend) {
    const l4d_decoder_options options = test::decoder_options(backend, 1);
    const DecoderHandle decoder(&options);
    decoder.check(l4d_decoder_open_memory(decoder.get(), bytes.data(), bytes.size()));
    Times out{std::vector<float>(n), std::vector<float>(n), std::vector<uint32_t>(2 * n, 99)};
    l4d_gaussian_buffers buffers = L4D_INIT(l4d_gaussian_buffers);
    buffers.capacity = n;
    buffers.mean_t = out.mean_t.data();
    buffers.mean_t_local = out.mean_t_local.data();
    buffers.window = out.window.data();
    const l4d_query query = test::all_query();
    decoder.check(l4d_decoder_decode(decoder.get(), &query, &buffers));
    l4d_counters counters = L4D_INIT(l4d_counters);
    decoder.check(l4d_decoder_get_counters(decoder.get(), &counters));
    out.pages_of_the_host = counters.pages_decoded;
    return out;
  };
  const Times host = decode(L4D_BACKEND_REFERENCE), device = decode(L4D_BACKEND_CUDA);
  expect_same_bits(host.mean_t, device.mean_t, "mean_t");
  expect_same_bits(host.mean_t_local, device.mean_t_local, "mean_t_local");
  EXPECT_EQ(host.window, device.window);
  EXPECT_GT(host.pages_of_the_host, 0u);
  EXPECT_EQ(device.pages_of_the_host, 0u);
}

TEST(BackendWithoutDevice, IsRefused) {
  if (cuda::device_count() > 0) GTEST_SKIP() << "there is a device";
  const l4d_decoder_options options = test::decoder_options(L4D_BACKEND_CUDA, 1);
  l4d_decoder* decoder = nullptr;
  EXPECT_EQ(l4d_decoder_create(&options, &decoder), L4D_ERR_DEVICE);
  EXPECT_EQ(decoder, nullptr);
  l4d_encoder_options encoder_options = L4D_INIT(l4d_encoder_options);
  encoder_options.backend = L4D_BACKEND_CUDA;
  l4d_encoder* encoder = nullptr;
  EXPECT_EQ(l4d_encoder_create(&encoder_options, &encoder), L4D_ERR_DEVICE);
  EXPECT_EQ(encoder, nullptr);
  uint32_t count = 7;
  EXPECT_EQ(l4d_cuda_get_device_count(&count), L4D_OK);
  EXPECT_EQ(count, 0u);
}

}  // namespace
}  // namespace l4d
