// SPDX-License-Identifier: Apache-2.0
// Flat windows that the device decodes against those of the reference on the host.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "tests/common/codec.h"
#include "tests/common/files.h"
#include "tests/gpu/decode_support.h"

namespace l4d::test {
namespace {

class Windows : public OnDevice<testing::Test> {};

TEST_F(Windows, OfAllPresets) {
  for (const char* preset : {"default", "tiny", "indexed", "lossless"}) {
    for (const uint32_t longest : {1u, 3u, 60u}) {
      SCOPED_TRACE(testing::Message() << preset << ", up to " << longest << " frames");
      SceneOptions s;
      s.count = 3000;
      s.fps_num = 30000;
      s.fps_den = 1001;
      s.time_begin = 0.25;
      EncodeOptions o;
      o.preset = preset;
      o.rans = std::string(preset) != "lossless";
      o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 200}};
      const Bytes file = encode(windowed_scene(s, longest), o).bytes;
      expect_as_on_host_for_all_queries(file);
      for (uint32_t attributes = 0; attributes <= L4D_CUDA_ALL_ATTRIBUTES; attributes += 3) {
        expect_as_on_host(file, time_query(1.0), attributes);
      }
    }
  }
}

// Begins and lengths of 24 bits, in one layer and in many.
TEST_F(Windows, OfTheLongestSequence) {
  SceneOptions s;
  s.count = 600;
  s.num_frames = L4D_MAX_FRAMES;
  for (const double merge : {1e6, 0.0}) {
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    o.settings = {{L4D_ENC_MERGE_COUNT, merge}, {L4D_ENC_MERGE_FRACTION, 0}};
    expect_as_on_host_for_all_queries(encode(windowed_scene(s, L4D_MAX_FRAMES), o).bytes);
  }
}

TEST_F(Windows, OfTheConformanceSuite) {
  const auto vectors = std::filesystem::path(source_file("conformance/vectors"));
  int streams = 0;
  for (const char* folder : {"core", "uncommon"}) {
    for (const auto& entry : std::filesystem::directory_iterator(vectors / folder)) {
      if (entry.path().extension() != ".l4d") continue;
      std::ifstream in(entry.path(), std::ios::binary);
      const Bytes file{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
      DecoderHandle decoder;
      if (l4d_decoder_open_memory(decoder.get(), file.data(), file.size()) != L4D_OK) continue;
      if ((decoder.info().tools & L4D_TOOL_FLAT_WINDOWS) == 0) continue;
      SCOPED_TRACE(entry.path().filename().string());
      ++streams;
      expect_as_on_host_for_all_queries(file);
    }
  }
  EXPECT_GE(streams, 6);
}

}  // namespace
}  // namespace l4d::test
