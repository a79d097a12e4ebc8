// SPDX-License-Identifier: Apache-2.0
// Calls from within callbacks, and the message of calls that have no handle to keep it.
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <thread>
#include <vector>

#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

constexpr l4d_status kState = L4D_ERR_INVALID_STATE;

// Everything that can be called on a decoder, each of which a callback must not call.
std::vector<l4d_status> calls_on(l4d_decoder* d) {
  const l4d_reader reader = memory_reader(tiny_file());
  const l4d_query query = all_query();
  l4d_selection selection = L4D_INIT(l4d_selection);
  l4d_gaussian_buffers gaussians = L4D_INIT(l4d_gaussian_buffers);
  l4d_packed_buffers packed = L4D_INIT(l4d_packed_buffers);
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  l4d_codebook codebook = L4D_INIT(l4d_codebook);
  l4d_dequantization dequantization = L4D_INIT(l4d_dequantization);
  l4d_stream_demand demand = L4D_INIT(l4d_stream_demand);
  l4d_info info = L4D_INIT(l4d_info);
  l4d_coding_errors errors = L4D_INIT(l4d_coding_errors);
  l4d_layer_info layer = L4D_INIT(l4d_layer_info);
  l4d_counters counters = L4D_INIT(l4d_counters);
  uint64_t sections[L4D_SECTION_COUNT], count = 0;
  return {l4d_decoder_open(d, &reader),
          l4d_decoder_open_memory(d, tiny_file().data(), tiny_file().size()),
          l4d_decoder_open_file(d, "/nowhere"),
          l4d_decoder_get_info(d, &info),
          l4d_decoder_get_coding_errors(d, &errors),
          l4d_decoder_get_layer_info(d, 0, &layer),
          l4d_decoder_get_sections(d, sections, L4D_SECTION_COUNT, nullptr, nullptr, 0),
          l4d_decoder_select(d, &query, &selection),
          l4d_decoder_get_spans(d, &query, nullptr, 0, &count),
          l4d_decoder_decode(d, &query, &gaussians),
          l4d_decoder_decode_packed(d, &query, &packed),
          l4d_decoder_get_codebook(d, 0, 0, 0, L4D_NO_BLOCK, &codebook),
          l4d_decoder_get_dequantization(d, 0, &dequantization),
          l4d_decoder_get_stream_demand(d, &demand),
          l4d_decoder_check_conformance(d, 0, 1, nullptr, nullptr, &count),
          l4d_decoder_slice(d, 0, &splats),
          l4d_decoder_get_losses(d, nullptr, 0, &count),
          l4d_decoder_get_counters(d, &counters),
          l4d_decoder_set_progress(d, nullptr, nullptr)};
}

// Calls everything on the decoder whose call it serves, and destroys it.
struct Intruder {
  l4d_decoder* decoder = nullptr;
  const Bytes* file = nullptr;
  int times = 0;
  void intrude() {
    if (decoder == nullptr) return;
    ++times;
    for (const l4d_status status : calls_on(decoder)) EXPECT_EQ(status, kState);
    EXPECT_NE(std::string(l4d_last_error_message()).find("callback"), std::string::npos);
    l4d_decoder_destroy(decoder);
  }
  l4d_reader reader() {
    l4d_reader r = L4D_INIT(l4d_reader);
    r.user = this;
    r.read_at = [](void* user, void* to, size_t n, uint64_t offset) -> int64_t {
      Intruder& self = *static_cast<Intruder*>(user);
      self.intrude();
      std::copy_n(self.file->data() + offset, n, static_cast<unsigned char*>(to));
      return static_cast<int64_t>(n);
    };
    r.size = [](void* user) -> int64_t {
      Intruder& self = *static_cast<Intruder*>(user);
      self.intrude();
      return static_cast<int64_t>(self.file->size());
    };
    return r;
  }
};

TEST(Callbacks, AReaderCannotCallItsDecoder) {
  Intruder intruder;
  intruder.file = &dynamic_file();
  DecoderHandle d;
  intruder.decoder = d.get();
  d.open(intruder.reader());
  EXPECT_GT(intruder.times, 2);
  const GaussianArrays want = decode(dynamic_file(), all_query());
  const int before = intruder.times;
  EXPECT_TRUE(same_bits(want, d.decode(all_query())));
  EXPECT_GT(intruder.times, before);
  // Afterwards the handle takes calls again, and what was tried has changed nothing.
  EXPECT_EQ(d.info().num_gaussians, want.count());
  EXPECT_TRUE(same_bits(d.slice(1.0), [] {
    DecoderHandle sound;
    sound.open_memory(dynamic_file().data(), dynamic_file().size());
    return sound.slice(1.0);
  }()));
}

TEST(Callbacks, ProgressCannotCallItsDecoder) {
  Intruder intruder;
  DecoderHandle d;
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  intruder.decoder = d.get();
  const auto progress = [](void* user, uint64_t, uint64_t, const char*) {
    static_cast<Intruder*>(user)->intrude();
    return 0;
  };
  ASSERT_EQ(l4d_decoder_set_progress(d.get(), progress, &intruder), L4D_OK);
  EXPECT_TRUE(same_bits(decode(dynamic_file(), all_query()), d.decode(all_query())));
  EXPECT_GT(intruder.times, 0);
}

// Other handles may be used.
TEST(Callbacks, AReaderMayCallOtherDecoders) {
  struct Helper {
    DecoderHandle other;
    int times = 0;
  } helper;
  helper.other.open_memory(dynamic_file().data(), dynamic_file().size());
  DecoderHandle d;
  d.open_memory(tiny_file().data(), tiny_file().size());
  const auto progress = [](void* user, uint64_t, uint64_t, const char*) {
    Helper& h = *static_cast<Helper*>(user);
    h.times += h.other.slice(0.5).count() > 0;
    return 0;
  };
  ASSERT_EQ(l4d_decoder_set_progress(d.get(), progress, &helper), L4D_OK);
  d.decode(all_query());
  EXPECT_GT(helper.times, 0);
}

TEST(Callbacks, AnEncodersCallbacksCannotCallIt) {
  const TestScene scene = make_scene({});
  const EncoderHandle e;
  prepare_encoder(scene, small_options(), e);
  struct Visitor {
    l4d_encoder* encoder;
    int times = 0;
    void visit() {
      ++times;
      double value = 0;
      l4d_encode_report report = L4D_INIT(l4d_encode_report);
      EXPECT_EQ(l4d_encoder_encode_file(encoder, "/nowhere"), kState);
      EXPECT_EQ(l4d_encoder_set_preset(encoder, "default"), kState);
      EXPECT_EQ(l4d_encoder_set(encoder, L4D_ENC_RCQ, 0), kState);
      EXPECT_EQ(l4d_encoder_get(encoder, L4D_ENC_RCQ, &value), kState);
      EXPECT_EQ(l4d_encoder_set_importance(encoder, nullptr), kState);
      EXPECT_EQ(l4d_encoder_add_metadata(encoder, "a", "b"), kState);
      EXPECT_EQ(l4d_encoder_set_progress(encoder, nullptr, nullptr), kState);
      EXPECT_EQ(l4d_encoder_get_report(encoder, &report), kState);
      l4d_encoder_destroy(encoder);
    }
  } visitor{e.get()};
  const auto progress = [](void* user, uint64_t, uint64_t, const char*) {
    static_cast<Visitor*>(user)->visit();
    return 0;
  };
  ASSERT_EQ(l4d_encoder_set_progress(e.get(), progress, &visitor), L4D_OK);
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = &visitor;
  writer.write = [](void* user, const void*, size_t) {
    static_cast<Visitor*>(user)->visit();
    return 0;
  };
  EXPECT_EQ(l4d_encoder_encode(e.get(), &writer), L4D_OK);
  EXPECT_GT(visitor.times, 2);
  l4d_encode_report report = L4D_INIT(l4d_encode_report);
  EXPECT_EQ(l4d_encoder_get_report(e.get(), &report), L4D_OK);
}

TEST(LastError, FunctionsWithoutAHandleKeepTheirMessage) {
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.backend = 99;
  l4d_decoder* decoder = nullptr;
  EXPECT_EQ(l4d_decoder_create(&options, &decoder), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(std::string(l4d_last_error_message()).find("backend"), std::string::npos);
  l4d_encoder_options encoder_options = L4D_INIT(l4d_encoder_options);
  encoder_options.backend = 99;
  l4d_encoder* encoder = nullptr;
  EXPECT_EQ(l4d_encoder_create(&encoder_options, &encoder), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(std::string(l4d_last_error_message()).find("backend"), std::string::npos);
  // l4d_validate: what the reader failed at.
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.read_at = [](void*, void*, size_t, uint64_t) -> int64_t { return -1; };
  reader.size = [](void*) -> int64_t { return 100; };
  uint64_t violations = 0;
  EXPECT_EQ(l4d_validate(&reader, nullptr, nullptr, nullptr, &violations), L4D_ERR_IO);
  EXPECT_NE(std::string(l4d_last_error_message()).find("reader failed"), std::string::npos);
  EXPECT_EQ(l4d_get_level_limits(0, 0, nullptr), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_NE(std::string(l4d_last_error_message()).find("NULL"), std::string::npos);
  try {
    options.backend = 98;
    const DecoderHandle d(&options);
    FAIL();
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("backend"), std::string::npos);
  }
}

TEST(LastError, IsOfTheThread) {
  DecoderHandle d;
  EXPECT_EQ(l4d_decoder_open_file(d.get(), "/nowhere/at-all"), L4D_ERR_IO);
  const std::string here = l4d_last_error_message();
  EXPECT_NE(here.find("/nowhere/at-all"), std::string::npos);
  std::thread([] {
    EXPECT_STREQ(l4d_last_error_message(), "");
    EXPECT_EQ(l4d_decoder_open_file(nullptr, "x"), L4D_ERR_INVALID_ARGUMENT);
    EXPECT_NE(std::string(l4d_last_error_message()).find("handle"), std::string::npos);
  }).join();
  EXPECT_EQ(here, l4d_last_error_message());
  // A call that succeeds leaves it.
  d.open_memory(tiny_file().data(), tiny_file().size());
  EXPECT_EQ(here, l4d_last_error_message());
}

}  // namespace
}  // namespace l4d
