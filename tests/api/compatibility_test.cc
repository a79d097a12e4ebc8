// SPDX-License-Identifier: Apache-2.0
// Programs compiled against a newer header than the library: their structs are larger, and nothing
// beyond the library's own is read or written. Of older programs see tests/abi.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <functional>
#include <string>

#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

constexpr unsigned char kCanary = 0xc7;

// A T of `size` bytes as L4D_INIT makes it, then canary.
template <typename T>
class Sized {
 public:
  explicit Sized(size_t size) : size_(size) {
    std::memset(bytes_, kCanary, sizeof bytes_);
    std::memset(bytes_, 0, std::max(size, sizeof(size_t)));
    get()->struct_size = size;
  }
  T* get() { return reinterpret_cast<T*>(bytes_); }
  T* operator->() { return get(); }
  // Every byte from struct_size on is as it was.
  bool intact() const {
    for (size_t i = size_; i < sizeof bytes_; ++i) {
      if (bytes_[i] != kCanary) return false;
    }
    return true;
  }
  bool same_as(const Sized& other) const {
    return std::memcmp(bytes_, other.bytes_, sizeof bytes_) == 0;
  }
  bool zero_between(size_t begin, size_t end) const {
    for (size_t i = begin; i < end; ++i) {
      if (bytes_[i] != 0) return false;
    }
    return true;
  }

 private:
  size_t size_;
  alignas(16) unsigned char bytes_[sizeof(T) + 64];
};

DecoderHandle opened() {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  return d;
}

// Each function that fills a struct, with structs of several versions.
using Fill = std::function<l4d_status(void*)>;

// first_version: bytes of the struct's first version.
template <typename T>
void expect_results_within(const Fill& fill, size_t first_version = sizeof(T)) {
  for (const size_t size : {first_version, sizeof(T), sizeof(T) + 40}) {
    Sized<T> s(size);
    EXPECT_EQ(fill(s.get()), L4D_OK) << l4d_last_error_message();
    EXPECT_EQ(s->struct_size, size);
    EXPECT_TRUE(s.intact());
    EXPECT_TRUE(s.zero_between(std::min(size, sizeof(T)), size));
  }
  // Smaller than any version: nothing is written.
  for (const size_t size : {size_t{0}, sizeof(size_t), first_version - 8}) {
    Sized<T> s(size);
    const Sized<T> before = s;
    EXPECT_EQ(fill(s.get()), L4D_ERR_INVALID_ARGUMENT) << size;
    EXPECT_NE(std::string(l4d_last_error_message()).find("struct_size"), std::string::npos);
    EXPECT_TRUE(s.same_as(before));
  }
}

TEST(StructSize, ResultsStayWithinIt) {
  const DecoderHandle handle = opened();
  l4d_decoder* const d = handle.get();
  const l4d_query q = all_query();
  expect_results_within<l4d_info>(
      [&](void* to) { return l4d_decoder_get_info(d, static_cast<l4d_info*>(to)); },
      offsetof(l4d_info, streamable));
  expect_results_within<l4d_coding_errors>(
      [&](void* to) {
        return l4d_decoder_get_coding_errors(d, static_cast<l4d_coding_errors*>(to));
      },
      offsetof(l4d_coding_errors, colors_stated));
  expect_results_within<l4d_layer_info>(
      [&](void* to) { return l4d_decoder_get_layer_info(d, 0, static_cast<l4d_layer_info*>(to)); },
      offsetof(l4d_layer_info, tier));
  expect_results_within<l4d_selection>(
      [&](void* to) { return l4d_decoder_select(d, &q, static_cast<l4d_selection*>(to)); });
  expect_results_within<l4d_counters>(
      [&](void* to) { return l4d_decoder_get_counters(d, static_cast<l4d_counters*>(to)); });
  expect_results_within<l4d_codebook>([&](void* to) {
    return l4d_decoder_get_codebook(d, 0, 0, 0, L4D_NO_BLOCK, static_cast<l4d_codebook*>(to));
  });
  expect_results_within<l4d_dequantization>([&](void* to) {
    return l4d_decoder_get_dequantization(d, 0, static_cast<l4d_dequantization*>(to));
  });
  expect_results_within<l4d_splat_buffers>(
      [&](void* to) { return l4d_decoder_slice(d, 1.0, static_cast<l4d_splat_buffers*>(to)); });
  expect_results_within<l4d_splat_columns>(
      [&](void* to) { return slice_columns(d, 1.0, static_cast<l4d_splat_columns*>(to)); });
  expect_results_within<l4d_stream_demand>([&](void* to) {
    return l4d_decoder_get_stream_demand(d, static_cast<l4d_stream_demand*>(to));
  });
  expect_results_within<l4d_level_limits>([&](void* to) {
    return l4d_get_level_limits(1, L4D_PROFILE_MAIN, static_cast<l4d_level_limits*>(to));
  });
  expect_results_within<l4d_parameter_info>([&](void* to) {
    return l4d_encoder_parameter_info(0, static_cast<l4d_parameter_info*>(to));
  });
}

// A struct of zeros would be read as one that says nothing, and what was set by hand would be lost.
TEST(StructSize, ZeroIsRefused) {
  l4d_decoder_options options{};
  options.max_memory_bytes = 1000;
  l4d_decoder* decoder = nullptr;
  EXPECT_EQ(l4d_decoder_create(&options, &decoder), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(decoder, nullptr);
  EXPECT_NE(std::string(l4d_last_error_message()).find("struct_size"), std::string::npos);
  uint64_t violations = 0;
  const l4d_reader reader = memory_reader(tiny_file());
  EXPECT_EQ(l4d_validate(&reader, &options, nullptr, nullptr, &violations),
            L4D_ERR_INVALID_ARGUMENT);
  l4d_encoder_options encoder_options{};
  encoder_options.threads = 1;
  l4d_encoder* encoder = nullptr;
  EXPECT_EQ(l4d_encoder_create(&encoder_options, &encoder), L4D_ERR_INVALID_ARGUMENT);
  const DecoderHandle d = opened();
  l4d_query query{};
  query.kind = L4D_QUERY_TIME;
  l4d_selection selection = L4D_INIT(l4d_selection);
  EXPECT_EQ(l4d_decoder_select(d.get(), &query, &selection), L4D_ERR_INVALID_ARGUMENT);
  l4d_gaussian_buffers buffers{};
  const l4d_query all = all_query();
  EXPECT_EQ(l4d_decoder_decode(d.get(), &all, &buffers), L4D_ERR_INVALID_ARGUMENT);
  const EncoderHandle e;
  const TestScene scene = make_scene({});
  l4d_gaussians gaussians = scene.view();
  gaussians.struct_size = 0;
  EXPECT_EQ(l4d_encoder_set_scene(e.get(), &gaussians, &scene.timeline, nullptr),
            L4D_ERR_INVALID_ARGUMENT);
  l4d_writer writer{};
  EXPECT_EQ(l4d_encoder_encode(e.get(), &writer), L4D_ERR_INVALID_ARGUMENT);
}

TEST(StructSize, LongerBuffers) {
  const DecoderHandle d = opened();
  const l4d_query q = time_query(1.0);
  const GaussianArrays want = d.decode(q);
  for (const size_t size : {sizeof(l4d_gaussian_buffers), sizeof(l4d_gaussian_buffers) + 16}) {
    Sized<l4d_gaussian_buffers> b(size);
    std::vector<float> position(want.position.size());
    b->capacity = want.count();
    b->position = position.data();
    ASSERT_EQ(l4d_decoder_decode(d.get(), &q, b.get()), L4D_OK);
    EXPECT_EQ(b->count, want.count());
    EXPECT_EQ(b->struct_size, size);
    EXPECT_TRUE(b.intact());
    EXPECT_TRUE(same_bits("position", want.position, position));
  }
}

TEST(StructSize, CallbacksAreNeverMissing) {
  l4d_reader r = memory_reader(tiny_file());
  DecoderHandle d;
  r.struct_size = offsetof(l4d_reader, size);
  EXPECT_EQ(l4d_decoder_open(d.get(), &r), L4D_ERR_INVALID_ARGUMENT);
  r = memory_reader(tiny_file());
  r.struct_size += 100;  // newer: fine
  EXPECT_EQ(l4d_decoder_open(d.get(), &r), L4D_OK);
  r.read_at = nullptr;
  EXPECT_EQ(l4d_decoder_open(d.get(), &r), L4D_ERR_INVALID_ARGUMENT);
  r = memory_reader(tiny_file());
  r.size = nullptr;
  EXPECT_EQ(l4d_decoder_open(d.get(), &r), L4D_ERR_INVALID_ARGUMENT);
}

TEST(StructSize, ScenesAndReports) {
  const TestScene scene = make_scene({});
  const EncoderHandle e;
  prepare_encoder(scene, small_options(), e);
  e.encode();
  expect_results_within<l4d_encode_report>(
      [&](void* to) {
        return l4d_encoder_get_report(e.get(), static_cast<l4d_encode_report*>(to));
      },
      offsetof(l4d_encode_report, max_base_color_error));
  // A struct that ends before the arrays gives none.
  l4d_gaussians g = scene.view();
  g.struct_size = offsetof(l4d_gaussians, sh);
  EXPECT_EQ(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, nullptr), L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d
