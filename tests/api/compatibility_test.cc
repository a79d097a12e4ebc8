// SPDX-License-Identifier: Apache-2.0
// Programs compiled against an older or a newer header than the library: their structs are smaller
// or larger, and nothing beyond struct_size is read or written.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstring>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

constexpr unsigned char kCanary = 0xc7;

// T in room for more, all canary, initialised for `size` bytes.
template <typename T>
class Sized {
 public:
  template <typename Init>
  Sized(size_t size, const Init& init) : size_(size) {
    std::memset(bytes_, kCanary, sizeof bytes_);
    init(get(), size);
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

TEST(StructSize, InitFillsExactlyTheStruct) {
  const auto check = [](auto example, auto init) {
    using T = decltype(example);
    for (const size_t size : {sizeof(size_t), sizeof(T), sizeof(T) + 24}) {
      Sized<T> s(size, init);
      EXPECT_EQ(s->struct_size, size);
      EXPECT_TRUE(s.intact());
      EXPECT_TRUE(s.zero_between(std::min(size, sizeof(T)), size)) << "fields of a newer version";
    }
  };
  check(l4d_decoder_options(), l4d_decoder_options_init_);
  check(l4d_info(), l4d_info_init_);
  check(l4d_layer_info(), l4d_layer_info_init_);
  check(l4d_query(), l4d_query_init_);
  check(l4d_selection(), l4d_selection_init_);
  check(l4d_gaussian_buffers(), l4d_gaussian_buffers_init_);
  check(l4d_packed_buffers(), l4d_packed_buffers_init_);
  check(l4d_codebook(), l4d_codebook_init_);
  check(l4d_dequantization(), l4d_dequantization_init_);
  check(l4d_splat_buffers(), l4d_splat_buffers_init_);
  check(l4d_counters(), l4d_counters_init_);
  check(l4d_encoder_options(), l4d_encoder_options_init_);
  check(l4d_parameter_info(), l4d_parameter_info_init_);
  check(l4d_encode_report(), l4d_encode_report_init_);
}

TEST(StructSize, ResultsStayWithinIt) {
  const DecoderHandle d = opened();
  const l4d_info want = d.info();
  const size_t kSizes[] = {offsetof(l4d_info, sh_degree), offsetof(l4d_info, num_gaussians),
                           offsetof(l4d_info, placement), sizeof(l4d_info), sizeof(l4d_info) + 40};
  for (const size_t size : kSizes) {
    Sized<l4d_info> s(size, l4d_info_init_);
    ASSERT_EQ(l4d_decoder_get_info(d.get(), s.get()), L4D_OK);
    EXPECT_EQ(s->struct_size, size);
    EXPECT_TRUE(s.intact());
    EXPECT_TRUE(s.zero_between(std::min(size, sizeof(l4d_info)), size));
    const size_t known = std::min(size, sizeof(l4d_info));
    EXPECT_EQ(
        std::memcmp(reinterpret_cast<const char*>(s.get()) + sizeof(size_t),
                    reinterpret_cast<const char*>(&want) + sizeof(size_t), known - sizeof(size_t)),
        0);
  }
  Sized<l4d_selection> selection(offsetof(l4d_selection, bytes), l4d_selection_init_);
  const l4d_query q = all_query();
  ASSERT_EQ(l4d_decoder_select(d.get(), &q, selection.get()), L4D_OK);
  EXPECT_EQ(selection->num_gaussians, want.num_gaussians);
  EXPECT_TRUE(selection.intact());
  Sized<l4d_layer_info> layer(offsetof(l4d_layer_info, bucket_width), l4d_layer_info_init_);
  ASSERT_EQ(l4d_decoder_get_layer_info(d.get(), 1, layer.get()), L4D_OK);
  EXPECT_EQ(layer->index, 1u);
  EXPECT_TRUE(layer.intact());
  Sized<l4d_counters> counters(offsetof(l4d_counters, pages_decoded), l4d_counters_init_);
  ASSERT_EQ(l4d_decoder_get_counters(d.get(), counters.get()), L4D_OK);
  EXPECT_TRUE(counters.intact());
  Sized<l4d_codebook> book(offsetof(l4d_codebook, dim), l4d_codebook_init_);
  ASSERT_EQ(l4d_decoder_get_codebook(d.get(), 0, 0, 0, L4D_NO_BLOCK, book.get()), L4D_OK);
  EXPECT_NE(book->entries, nullptr);
  EXPECT_TRUE(book.intact());
  Sized<l4d_dequantization> q2(offsetof(l4d_dequantization, opacity_offset),
                               l4d_dequantization_init_);
  ASSERT_EQ(l4d_decoder_get_dequantization(d.get(), 0, q2.get()), L4D_OK);
  EXPECT_TRUE(q2.intact());
}

// An older query has no max_level: it means every level.
TEST(StructSize, MissingFieldsHaveTheirDefaults) {
  const DecoderHandle d = opened();
  Sized<l4d_query> q(offsetof(l4d_query, max_level), l4d_query_init_);
  l4d_selection s;
  l4d_selection_init(&s);
  ASSERT_EQ(l4d_decoder_select(d.get(), q.get(), &s), L4D_OK);
  EXPECT_EQ(s.num_gaussians, d.info().num_gaussians);
  Sized<l4d_query> without_detail(offsetof(l4d_query, detail), l4d_query_init_);
  std::memset(&without_detail->detail, 0xff, sizeof without_detail->detail);
  ASSERT_EQ(l4d_decoder_select(d.get(), without_detail.get(), &s), L4D_OK);
  Sized<l4d_decoder_options> o(offsetof(l4d_decoder_options, backend), l4d_decoder_options_init_);
  o->threads = 1;
  l4d_decoder* decoder = nullptr;
  ASSERT_EQ(l4d_decoder_create(o.get(), &decoder), L4D_OK);
  l4d_decoder_destroy(decoder);
  Sized<l4d_encoder_options> e(offsetof(l4d_encoder_options, seed), l4d_encoder_options_init_);
  l4d_encoder* encoder = nullptr;
  ASSERT_EQ(l4d_encoder_create(e.get(), &encoder), L4D_OK);
  l4d_encoder_destroy(encoder);
}

TEST(StructSize, ShorterAndLongerBuffers) {
  const DecoderHandle d = opened();
  const l4d_query q = time_query(1.0);
  const GaussianArrays want = d.decode(q);
  for (const size_t size :
       {offsetof(l4d_gaussian_buffers, log_scale), offsetof(l4d_gaussian_buffers, ranges),
        sizeof(l4d_gaussian_buffers), sizeof(l4d_gaussian_buffers) + 16}) {
    Sized<l4d_gaussian_buffers> b(size, l4d_gaussian_buffers_init_);
    std::vector<float> position(want.position.size());
    b->capacity = want.count();
    b->position = position.data();
    ASSERT_EQ(l4d_decoder_decode(d.get(), &q, b.get()), L4D_OK);
    EXPECT_EQ(b->count, want.count());
    EXPECT_EQ(b->struct_size, size);
    EXPECT_TRUE(b.intact());
    EXPECT_TRUE(same_bits("position", want.position, position));
  }
  Sized<l4d_splat_buffers> splats(offsetof(l4d_splat_buffers, position), l4d_splat_buffers_init_);
  ASSERT_EQ(l4d_decoder_slice(d.get(), 1.0, splats.get()), L4D_OK);
  EXPECT_GT(splats->count, 0u);
  EXPECT_TRUE(splats.intact());
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

TEST(StructSize, OlderScenesAndReports) {
  const TestScene scene = make_scene({});
  const EncoderHandle e;
  prepare_encoder(scene, small_options(), e);
  e.encode();
  Sized<l4d_encode_report> report(offsetof(l4d_encode_report, raw_bytes), l4d_encode_report_init_);
  ASSERT_EQ(l4d_encoder_get_report(e.get(), report.get()), L4D_OK);
  EXPECT_EQ(report->coded_gaussians, scene.count());
  EXPECT_TRUE(report.intact());
  Sized<l4d_parameter_info> info(offsetof(l4d_parameter_info, min), l4d_parameter_info_init_);
  ASSERT_EQ(l4d_encoder_parameter_info(L4D_ENC_RCQ, info.get()), L4D_OK);
  EXPECT_STREQ(info->name, "rcq");
  EXPECT_TRUE(info.intact());
  // A struct that ends before the arrays gives none.
  l4d_gaussians g = scene.view();
  g.struct_size = offsetof(l4d_gaussians, sh);
  EXPECT_EQ(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, nullptr), L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d
