// SPDX-License-Identifier: Apache-2.0
// NULL, wrong moments, and what the error message says.
#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <string>
#include <thread>

#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "l4d/playback.h"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

constexpr l4d_status kInvalid = L4D_ERR_INVALID_ARGUMENT;
constexpr l4d_status kState = L4D_ERR_INVALID_STATE;

// What a call on a decoder may need.
struct Targets {
  l4d_query query = all_query();
  l4d_selection selection;
  l4d_gaussian_buffers gaussians;
  l4d_packed_buffers packed;
  l4d_codebook codebook;
  l4d_dequantization dequantization;
  l4d_splat_buffers splats;
  l4d_counters counters;
  l4d_stream_demand demand;
  uint64_t violations = 0;
  l4d_info info;
  l4d_coding_errors errors;
  l4d_layer_info layer;
  uint64_t sections[L4D_SECTION_COUNT];
  Targets() {
    selection = L4D_INIT(l4d_selection);
    gaussians = L4D_INIT(l4d_gaussian_buffers);
    packed = L4D_INIT(l4d_packed_buffers);
    codebook = L4D_INIT(l4d_codebook);
    dequantization = L4D_INIT(l4d_dequantization);
    splats = L4D_INIT(l4d_splat_buffers);
    counters = L4D_INIT(l4d_counters);
    demand = L4D_INIT(l4d_stream_demand);
    info = L4D_INIT(l4d_info);
    errors = L4D_INIT(l4d_coding_errors);
    layer = L4D_INIT(l4d_layer_info);
  }
};

// All calls that need an open stream, by name.
std::vector<std::pair<const char*, l4d_status>> stream_calls(l4d_decoder* d) {
  Targets t;
  return {
      {"info", l4d_decoder_get_info(d, &t.info)},
      {"coding_errors", l4d_decoder_get_coding_errors(d, &t.errors)},
      {"layer_info", l4d_decoder_get_layer_info(d, 0, &t.layer)},
      {"sections", l4d_decoder_get_sections(d, t.sections, L4D_SECTION_COUNT, nullptr, nullptr, 0)},
      {"select", l4d_decoder_select(d, &t.query, &t.selection)},
      {"decode", l4d_decoder_decode(d, &t.query, &t.gaussians)},
      {"decode_packed", l4d_decoder_decode_packed(d, &t.query, &t.packed)},
      {"codebook", l4d_decoder_get_codebook(d, 0, 0, 0, L4D_NO_BLOCK, &t.codebook)},
      {"dequantization", l4d_decoder_get_dequantization(d, 0, &t.dequantization)},
      {"slice", l4d_decoder_slice(d, 0, &t.splats)},
      {"demand", l4d_decoder_get_stream_demand(d, &t.demand)},
      {"check_conformance",
       l4d_decoder_check_conformance(d, 0, 1, nullptr, nullptr, &t.violations)},
      {"counters", l4d_decoder_get_counters(d, &t.counters)}};
}

TEST(Arguments, NullDecoder) {
  for (const auto& [name, status] : stream_calls(nullptr)) EXPECT_EQ(status, kInvalid) << name;
  EXPECT_EQ(l4d_decoder_create(nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_open_memory(nullptr, "x", 1), kInvalid);
  EXPECT_EQ(l4d_decoder_open_file(nullptr, "x"), kInvalid);
  const l4d_reader r = memory_reader(tiny_file());
  EXPECT_EQ(l4d_decoder_open(nullptr, &r), kInvalid);
  EXPECT_EQ(l4d_decoder_set_progress(nullptr, nullptr, nullptr), kInvalid);
  l4d_decoder_destroy(nullptr);
}

TEST(Arguments, NullEncoder) {
  const l4d_gaussians g{};
  const l4d_timeline t{};
  const l4d_writer w{};
  uint32_t order = 0;
  double value = 0;
  l4d_encode_report report = L4D_INIT(l4d_encode_report);
  EXPECT_EQ(l4d_encoder_create(nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_set_progress(nullptr, nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_set_preset(nullptr, "default"), kInvalid);
  EXPECT_EQ(l4d_encoder_set(nullptr, L4D_ENC_RCQ, 0), kInvalid);
  EXPECT_EQ(l4d_encoder_get(nullptr, L4D_ENC_RCQ, &value), kInvalid);
  EXPECT_EQ(l4d_encoder_set_list(nullptr, L4D_ENC_STAGES, &value, 1), kInvalid);
  EXPECT_EQ(l4d_encoder_set_scene(nullptr, &g, &t, nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_set_importance(nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_set_fitted_opacity(nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_add_metadata(nullptr, "a", "b"), kInvalid);
  EXPECT_EQ(l4d_encoder_encode(nullptr, &w), kInvalid);
  EXPECT_EQ(l4d_encoder_encode_file(nullptr, "x"), kInvalid);
  EXPECT_EQ(l4d_encoder_get_report(nullptr, &report), kInvalid);
  EXPECT_EQ(l4d_encoder_get_order(nullptr, &order, 1), kInvalid);
  l4d_encoder_destroy(nullptr);
}

TEST(Arguments, NullPointers) {
  Targets t;
  DecoderHandle handle;
  l4d_decoder* d = handle.get();
  handle.open_memory(tiny_file().data(), tiny_file().size());
  EXPECT_EQ(l4d_decoder_get_info(d, nullptr), kInvalid);
  const char* text = nullptr;
  EXPECT_EQ(l4d_decoder_get_metadata(d, 0, nullptr, &text), kInvalid);
  EXPECT_EQ(l4d_decoder_get_metadata(d, 0, &text, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_get_coding_errors(d, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_get_layer_info(d, 0, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_get_sections(d, nullptr, 1, nullptr, nullptr, 0), kInvalid);
  EXPECT_EQ(l4d_decoder_get_stream_demand(d, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_check_conformance(d, 0, 0, nullptr, nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_select(d, nullptr, &t.selection), kInvalid);
  EXPECT_EQ(l4d_decoder_select(d, &t.query, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_decode(d, nullptr, &t.gaussians), kInvalid);
  EXPECT_EQ(l4d_decoder_decode(d, &t.query, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_decode_packed(d, nullptr, &t.packed), kInvalid);
  EXPECT_EQ(l4d_decoder_decode_packed(d, &t.query, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_get_codebook(d, 0, 0, 0, L4D_NO_BLOCK, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_get_dequantization(d, 0, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_get_dequantization(d, 1000, &t.dequantization), kInvalid);
  EXPECT_EQ(l4d_decoder_slice(d, 0, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_get_counters(d, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_open(d, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_open_memory(d, nullptr, 1), kInvalid);
  EXPECT_EQ(l4d_decoder_open_file(d, nullptr), kInvalid);
  EXPECT_EQ(l4d_decoder_open_memory(d, nullptr, 0), L4D_ERR_NOT_L4D);

  const EncoderHandle e;
  EXPECT_EQ(l4d_encoder_set_preset(e.get(), nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_set_scene(e.get(), nullptr, nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_add_metadata(e.get(), nullptr, "b"), kInvalid);
  EXPECT_EQ(l4d_encoder_add_metadata(e.get(), "a", nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_get_report(e.get(), nullptr), kInvalid);
  EXPECT_EQ(l4d_encoder_get_order(e.get(), nullptr, 0), kInvalid);

  uint64_t violations = 0;
  const l4d_reader r = memory_reader(tiny_file());
  EXPECT_EQ(l4d_validate(nullptr, nullptr, nullptr, nullptr, &violations), kInvalid);
  EXPECT_EQ(l4d_validate(&r, nullptr, nullptr, nullptr, nullptr), kInvalid);
  EXPECT_EQ(l4d_validate(&r, nullptr, nullptr, nullptr, &violations), L4D_OK);
}

TEST(State, WithoutAStream) {
  DecoderHandle d;
  for (const auto& [name, status] : stream_calls(d.get())) EXPECT_EQ(status, kState) << name;
  // An opening that fails leaves none, also where one was open before.
  d.open_memory(tiny_file().data(), tiny_file().size());
  EXPECT_EQ(l4d_decoder_open_memory(d.get(), "garbage", 7), L4D_ERR_NOT_L4D);
  for (const auto& [name, status] : stream_calls(d.get())) EXPECT_EQ(status, kState) << name;
  d.open_memory(tiny_file().data(), tiny_file().size());
  EXPECT_EQ(l4d_decoder_open_file(d.get(), "/nonexistent/scene.l4d"), L4D_ERR_IO);
  for (const auto& [name, status] : stream_calls(d.get())) EXPECT_EQ(status, kState) << name;
  // And the handle can be used again.
  d.open_memory(tiny_file().data(), tiny_file().size());
  EXPECT_EQ(d.info().num_gaussians, 12u);
}

TEST(State, UnknownBackend) {
  l4d_decoder_options o = decoder_options(17, 1);
  l4d_decoder* d = nullptr;
  EXPECT_EQ(l4d_decoder_create(&o, &d), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_EQ(d, nullptr);
}

TEST(ErrorMessage, TellsOfTheLastFailure) {
  DecoderHandle d;
  EXPECT_EQ(l4d_decoder_open_memory(d.get(), "garbage", 7), L4D_ERR_NOT_L4D);
  EXPECT_EQ(std::string(l4d_last_error_message()).rfind("spec FILE-1 at byte 0: ", 0), 0u)
      << l4d_last_error_message();
  EXPECT_EQ(l4d_decoder_open_file(d.get(), "/nonexistent/scene.l4d"), L4D_ERR_IO);
  EXPECT_NE(std::string(l4d_last_error_message()).find("/nonexistent/scene.l4d"),
            std::string::npos);
  d.open_memory(tiny_file().data(), tiny_file().size());
  try {
    d.open_memory("x", 1);
    ADD_FAILURE();
  } catch (const Error& e) {
    EXPECT_EQ(e.status(), L4D_ERR_NOT_L4D);
    EXPECT_NE(std::string(e.what()).find("L4D_ERR_NOT_L4D"), std::string::npos);
    EXPECT_NE(std::string(e.what()).find("FILE-1"), std::string::npos);
  }
}

TEST(OpenFile, FoldersAndEmptyFilesAreNoStreams) {
  DecoderHandle d;
  EXPECT_EQ(l4d_decoder_open_file(d.get(), testing::TempDir().c_str()), L4D_ERR_IO);
  const std::string path = temporary_path(".l4d");
  std::ofstream(path).close();
  EXPECT_EQ(l4d_decoder_open_file(d.get(), path.c_str()), L4D_ERR_NOT_L4D);
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(tiny_file().data()),
             static_cast<std::streamsize>(tiny_file().size()));
  d.open_file(path);
  EXPECT_TRUE(same_bits(decode(tiny_file(), all_query()), d.decode(all_query())));
  EXPECT_EQ(std::remove(path.c_str()), 0);
}

TEST(Names, StatusesSectionsAndVersions) {
  std::set<std::string> names;
  for (const l4d_status s :
       {L4D_OK, L4D_ERR_INVALID_ARGUMENT, L4D_ERR_INVALID_STATE, L4D_ERR_OUT_OF_MEMORY, L4D_ERR_IO,
        L4D_ERR_CANCELLED, L4D_ERR_LIMIT_EXCEEDED, L4D_ERR_INVALID_SCENE, L4D_ERR_BUFFER_TOO_SMALL,
        L4D_ERR_NOT_L4D, L4D_ERR_VERSION_UNSUPPORTED, L4D_ERR_FEATURE_UNSUPPORTED,
        L4D_ERR_TRUNCATED, L4D_ERR_CORRUPT, L4D_ERR_CHECKSUM, L4D_ERR_INTERNAL}) {
    EXPECT_TRUE(names.insert(l4d_status_name(s)).second);
    EXPECT_EQ(std::string(l4d_status_name(s)).rfind("L4D_", 0), 0u);
    EXPECT_EQ(std::string(l4d_status_description(s)).back(), '.');
  }
  EXPECT_STREQ(l4d_status_name(-1234), "L4D_ERR_UNKNOWN");
  EXPECT_STREQ(l4d_playback_cause_name(L4D_CAUSE_NO_RANGES), "L4D_CAUSE_NO_RANGES");
  EXPECT_STREQ(l4d_playback_cause_name(L4D_CAUSE_NO_RANGES + 1), "L4D_CAUSE_UNKNOWN");
  EXPECT_NE(l4d_status_description(-1234), nullptr);
  std::set<std::string> sections;
  for (uint32_t i = 0; i < L4D_SECTION_COUNT; ++i) {
    EXPECT_TRUE(sections.insert(l4d_section_name(i)).second);
  }
  EXPECT_EQ(l4d_section_name(L4D_SECTION_COUNT), nullptr);
  EXPECT_EQ(l4d_version_number(), uint32_t{L4D_VERSION_MAJOR} << 24 |
                                      uint32_t{L4D_VERSION_MINOR} << 16 |
                                      uint32_t{L4D_VERSION_PATCH} << 8);
  EXPECT_EQ(std::string(l4d_version_string()), std::to_string(L4D_VERSION_MAJOR) + "." +
                                                   std::to_string(L4D_VERSION_MINOR) + "." +
                                                   std::to_string(L4D_VERSION_PATCH));
  EXPECT_NE(std::string(l4d_build_info()).find("simd"), std::string::npos);
}

// A handle belongs to one thread; different handles share nothing.
TEST(Threads, HandlesAreIndependent) {
  const GaussianArrays want = decode(dynamic_file(), all_query());
  const Bytes encoded = encode(make_scene({}), small_options()).bytes;
  std::vector<std::thread> threads;
  std::vector<int> wrong(4, 0);
  for (int k = 0; k < 4; ++k) {
    threads.emplace_back([&, k] {
      for (int round = 0; round < 3; ++round) {
        if (!same_bits(want, decode(dynamic_file(), all_query()))) ++wrong[static_cast<size_t>(k)];
      }
      if (encode(make_scene({}), small_options()).bytes != encoded) ++wrong[static_cast<size_t>(k)];
    });
  }
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(wrong, std::vector<int>(4, 0));
}

}  // namespace
}  // namespace l4d
