// SPDX-License-Identifier: Apache-2.0
// What the device decodes against the reference on the host, bit for bit.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <tuple>

#include "io/ply/scene_ply.h"
#include "tests/common/codec.h"
#include "tests/common/files.h"
#include "tests/gpu/decode_support.h"

namespace l4d::test {
namespace {

struct Preset {
  const char* name;
  EncodeOptions options;
};
std::ostream& operator<<(std::ostream& out, const Preset& p) { return out << p.name; }

std::vector<Preset> presets() {
  std::vector<Preset> out;
  const auto add = [&](const char* name, const char* preset, bool rans,
                       std::vector<Setting> settings) {
    EncodeOptions o;
    o.preset = preset;
    o.rans = rans;
    o.settings = std::move(settings);
    o.settings.push_back({L4D_ENC_MERGE_COUNT, 40});
    out.push_back({name, o});
  };
  add("Default", "default", true, {});
  add("Tiny", "tiny", true, {});
  add("Archive", "archive", true, {});
  add("DefaultSmallPages", "default", true, {{L4D_ENC_PAGE_SIZE, 100}});
  add("Indexed", "indexed", true, {{L4D_ENC_CODEBOOK_SIZE, 128}, {L4D_ENC_KMEANS_ITERATIONS, 2}});
  add("IndexedSmall", "indexed-small", true,
      {{L4D_ENC_CODEBOOK_SIZE, 256}, {L4D_ENC_KMEANS_ITERATIONS, 2}, {L4D_ENC_PAGE_SIZE, 333}});
  add("PaperSmall", "paper-small", false,
      {{L4D_ENC_CODEBOOK_SIZE, 64},
       {L4D_ENC_KMEANS_ITERATIONS, 2},
       {L4D_ENC_PAGE_SIZE, 500},
       {L4D_ENC_PRUNE_WEIGHT, -1}});
  add("Lossless", "lossless", false, {{L4D_ENC_PAGE_SIZE, 500}});
  // Codebooks of SH beside transforms, and the other way round.
  add("VqSh", "default", true, {{L4D_ENC_CODING ".sh", 0}});
  add("VqScale", "default", true, {{L4D_ENC_CODING ".scale", 0}});
  add("HalfPositions", "default", true, {{L4D_ENC_FIXED_POSITIONS, 0}});
  return out;
}

using PresetAndDegree = std::tuple<Preset, uint32_t>;
class Presets : public OnDevice<testing::TestWithParam<PresetAndDegree>> {};

TEST_P(Presets, DecodeToTheBitsOfTheReference) {
  const auto& [preset, degree] = GetParam();
  SceneOptions s;
  s.count = 9000;
  s.sh_degree = degree;
  s.seed = degree + 7;
  expect_as_on_host_for_all_queries(encode(make_scene(s), preset.options).bytes);
}

INSTANTIATE_TEST_SUITE_P(
    All, Presets, testing::Combine(testing::ValuesIn(presets()), testing::Values(0u, 1u, 2u, 3u)),
    [](const auto& parameter) {
      return std::get<0>(parameter.param).name + std::to_string(std::get<1>(parameter.param));
    });

class Scenes : public OnDevice<testing::Test> {};

TEST_F(Scenes, WithoutMotionAndWithoutTime) {
  for (const double permanent : {0.0, 0.5, 1.0}) {
    SceneOptions s;
    s.count = 3000;
    s.sh_degree = 3;
    s.permanent = permanent;
    s.moving = false;
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}};
    expect_as_on_host_for_all_queries(encode(make_scene(s), o).bytes);
  }
}

TEST_F(Scenes, WithShChunksOfSh) {
  SceneOptions s;
  s.count = 40000;
  s.sh_degree = 3;
  s.permanent = 0.9;
  for (const char* preset : {"default", "indexed-small"}) {
    EncodeOptions o;
    o.preset = preset;
    o.rans = true;
    o.settings = {
        {L4D_ENC_MERGE_COUNT, 4000}, {L4D_ENC_CODEBOOK_SIZE, 256}, {L4D_ENC_KMEANS_ITERATIONS, 2}};
    expect_as_on_host_for_all_queries(encode(make_scene(s), o).bytes);
  }
}

TEST_F(Scenes, WithEscapesAndStages) {
  EncodeOptions o = small_options();
  o.rans = true;
  o.stages = {{L4D_ENC_STAGES, {1.0f, 0.5f, 0.25f}}};
  for (const uint32_t degree : {1u, 3u}) {
    SceneOptions s;
    s.count = 3000;
    s.sh_degree = degree;
    const TestScene scene = make_scene(s);
    std::vector<float> weights(scene.count());
    for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<float>(i % 40);
    EncodeOptions with = o;
    with.settings.push_back({L4D_ENC_ESCAPE_THRESHOLD, 37.5});
    for (uint32_t w = L4D_WEIGHT_SH; w <= L4D_WEIGHT_ROTOR_TEMPORAL; ++w) {
      with.weights.emplace_back(w, &weights);
    }
    expect_as_on_host_for_all_queries(encode(scene, with).bytes);
  }
}

TEST_F(Scenes, WithBlockCodebooks) {
  const Bytes bytes = block_codebooks_file(true);
  DecoderHandle decoder;
  decoder.open_memory(bytes.data(), bytes.size());
  ASSERT_NE(decoder.info().tools & L4D_TOOL_RCQ, 0u);
  expect_as_on_host_for_all_queries(bytes);
}

TEST_F(Scenes, OfOnePageOfManyAndOfFewGaussians) {
  for (const uint64_t count : {1u, 2u, 31u, 32u, 33u, 257u}) {
    SceneOptions s;
    s.count = count;
    s.sh_degree = 3;
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    expect_as_on_host(encode(make_scene(s), o).bytes, all_query());
  }
}

class Attributes : public OnDevice<testing::Test> {};

TEST_F(Attributes, EverySubsetIsTheSame) {
  SceneOptions s;
  s.count = 20000;
  s.sh_degree = 3;
  s.permanent = 0.95;
  EncodeOptions o;
  o.preset = "default";
  o.rans = true;
  const Bytes file = encode(make_scene(s), o).bytes;
  for (uint32_t attributes = 0; attributes <= L4D_CUDA_ALL_ATTRIBUTES; ++attributes) {
    expect_as_on_host(file, time_query(1.0), attributes);
  }
  for (uint32_t attributes = 0; attributes <= L4D_CUDA_ALL_ATTRIBUTES; ++attributes) {
    expect_as_on_host(lossless_file(), time_query(1.0), attributes);
  }
}

class Jobs : public OnDevice<testing::Test> {};

TEST_F(Jobs, FollowEachOtherOnOneHandle) {
  const Bytes& file = transform_file();
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  DeviceDecoding device(decoder);
  for (int round = 0; round < 2; ++round) {
    for (const double time : {0.1, 1.7, 0.9}) {
      const DeviceResult found = device.decode(time_query(time));
      ASSERT_EQ(found.status, L4D_OK) << found.detail;
      const GaussianArrays expected = decode(file, time_query(time), L4D_BACKEND_REFERENCE);
      EXPECT_TRUE(same_bits("rotor", found.arrays.rotor, expected.rotor));
      EXPECT_TRUE(same_bits("sh", found.arrays.sh, expected.sh));
    }
  }
}

TEST_F(Jobs, RefuseWhatDoesNotFit) {
  const Bytes& file = transform_file();
  DecoderHandle decoder;
  l4d_cuda_decoder* none = nullptr;
  EXPECT_EQ(l4d_cuda_decoder_create(decoder.get(), 0, &none), L4D_ERR_INVALID_STATE);
  decoder.open_memory(file.data(), file.size());
  EXPECT_EQ(l4d_cuda_decoder_create(decoder.get(), 1000, &none), L4D_ERR_DEVICE);
  EXPECT_EQ(none, nullptr);
  DeviceDecoding device(decoder);
  l4d_cuda_gaussian_buffers buffers = L4D_INIT(l4d_cuda_gaussian_buffers);
  EXPECT_EQ(l4d_cuda_decoder_decode(device.get(), &buffers, nullptr, 0, nullptr),
            L4D_ERR_INVALID_STATE);
  EXPECT_EQ(l4d_cuda_decoder_finish(device.get()), L4D_ERR_INVALID_STATE);
  l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
  request.attributes = L4D_CUDA_POSITION;
  const l4d_query query = all_query();
  ASSERT_EQ(l4d_cuda_decoder_prepare(device.get(), &query, &request), L4D_OK);
  const PoisonedMemory workspace(static_cast<size_t>(request.workspace_bytes));
  const PoisonedMemory array(static_cast<size_t>(request.num_gaussians) * 3 * sizeof(float));
  const auto decode_into = [&](float* position, float* opacity, uint64_t capacity, void* at,
                               uint64_t size) {
    buffers.position = position;
    buffers.opacity = opacity;
    buffers.capacity = capacity;
    return l4d_cuda_decoder_decode(device.get(), &buffers, at, size, nullptr);
  };
  const uint64_t n = request.num_gaussians, size = request.workspace_bytes;
  EXPECT_EQ(decode_into(array.floats(), nullptr, n - 1, workspace.data(), size),
            L4D_ERR_BUFFER_TOO_SMALL);
  EXPECT_EQ(decode_into(array.floats() + 1, nullptr, n, workspace.data(), size),
            L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(decode_into(nullptr, array.floats(), n, workspace.data(), size),
            L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(decode_into(array.floats(), nullptr, n, workspace.data(), size - 1),
            L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(decode_into(array.floats(), nullptr, n, nullptr, size), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(l4d_last_error_message()), "");
  ASSERT_EQ(decode_into(array.floats(), nullptr, n, workspace.data(), size), L4D_OK);
  EXPECT_EQ(l4d_cuda_decoder_finish(device.get()), L4D_OK);
  EXPECT_TRUE(
      same_bits("position", array.read(), decode(file, query, L4D_BACKEND_REFERENCE).position));
}

TEST_F(Jobs, UploadAheadOfDecoding) {
  const Bytes& file = transform_file();
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  DeviceDecoding device(decoder);
  l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
  const l4d_query query = all_query();
  ASSERT_EQ(l4d_cuda_decoder_prepare(device.get(), &query, &request), L4D_OK);
  EXPECT_GT(request.upload_bytes, 0u);
  const PoisonedMemory workspace(static_cast<size_t>(request.workspace_bytes));
  const PoisonedMemory array(static_cast<size_t>(request.num_gaussians) * 8 * sizeof(float));
  l4d_cuda_gaussian_buffers buffers = L4D_INIT(l4d_cuda_gaussian_buffers);
  buffers.capacity = request.num_gaussians;
  buffers.rotor = array.floats();
  for (int round = 0; round < 3; ++round) {
    if (round != 1) {
      ASSERT_EQ(
          l4d_cuda_decoder_upload(device.get(), workspace.data(), request.workspace_bytes, nullptr),
          L4D_OK);
    }
    ASSERT_EQ(l4d_cuda_decoder_decode(device.get(), &buffers, workspace.data(),
                                      request.workspace_bytes, nullptr),
              L4D_OK);
    ASSERT_EQ(l4d_cuda_decoder_finish(device.get()), L4D_OK);
    EXPECT_TRUE(same_bits("rotor", array.read(), decode(file, query, L4D_BACKEND_REFERENCE).rotor));
  }
}

TEST_F(Jobs, KeepToTheLimitsOfTheDecoder) {
  const Bytes& file = transform_file();
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.max_memory_bytes = file.size() / 2;
  DecoderHandle decoder(&options);
  try {
    decoder.open_memory(file.data(), file.size());
  } catch (const Error& e) {
    FAIL() << "the limit is below the header: " << e.what();
  }
  DeviceDecoding device(decoder);
  EXPECT_EQ(device.decode(all_query()).status, L4D_ERR_LIMIT_EXCEEDED);
}

Bytes read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream content;
  content << in.rdbuf();
  const std::string text = content.str();
  return Bytes(text.begin(), text.end());
}

// Streams of a trained scene, at one instant and as a whole. Where the scene is not at hand,
// streams made of it elsewhere can be named in L4D_GPU_TEST_FILES, with colons between.
TEST_F(Scenes, Basketball) {
  std::vector<Bytes> streams;
  const std::string file = test::data_file("basketball/basketball.ply");
  if (!file.empty()) {
    const io::Scene scene = io::read_scene_ply(file);
    const l4d_gaussians view = scene.view();
    for (const char* preset : {"default", "indexed-small"}) {
      EncoderHandle encoder;
      encoder.check(l4d_encoder_set_preset(encoder.get(), preset));
      encoder.check(l4d_encoder_set(encoder.get(), L4D_ENC_EFFORT, 1));
      encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
      streams.push_back(encoder.encode());
    }
  }
  if (const char* files = std::getenv("L4D_GPU_TEST_FILES")) {
    std::istringstream list(files);
    for (std::string path; std::getline(list, path, ':');) {
      streams.push_back(read_file(path));
      ASSERT_FALSE(streams.back().empty()) << path;
    }
  }
  if (streams.empty()) GTEST_SKIP() << "no basketball scene in $L4D_DATA_DIR or ../shared/data";
  for (const Bytes& stream : streams) {
    expect_as_on_host(stream, all_query());
    expect_as_on_host(stream, time_query(2.5));
  }
}

}  // namespace
}  // namespace l4d::test
