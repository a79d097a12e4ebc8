// SPDX-License-Identifier: Apache-2.0
// Several streams as one: l4d_slice_streams and l4d_slice_streams_columns.
#include <gtest/gtest.h>

#include <algorithm>

#include "l4d/experimental/columns.h"
#include "l4d/l4d.hpp"
#include "l4d/members.h"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

constexpr size_t kCoefficients = 48;  // of degree 3

Bytes stream_of(uint32_t sh_degree, uint64_t seed) {
  SceneOptions options;
  options.count = 700;
  options.sh_degree = sh_degree;
  options.seed = seed;
  return encode(make_scene(options), small_options()).bytes;
}

struct ThreeStreams {
  Bytes bytes[3] = {stream_of(1, 1), stream_of(3, 2), stream_of(0, 3)};
  DecoderHandle decoders[3];
  std::vector<l4d_shown_stream> streams;
  std::vector<SplatArrays> parts;
  size_t count = 0;
  ThreeStreams() {
    for (size_t k = 0; k < 3; ++k) {
      decoders[k].open_memory(bytes[k].data(), bytes[k].size());
      streams.push_back({decoders[k].get(), 0.3 * static_cast<double>(k)});
      SliceOptions options;
      options.shape = options.color = options.id = true;
      parts.push_back(decoders[k].slice(streams[k].time, options));
      count += parts[k].count();
    }
  }
  // Of all streams, one after the other.
  template <typename T>
  std::vector<T> joined(std::vector<T> SplatArrays::*array) const {
    std::vector<T> all;
    for (const SplatArrays& part : parts) {
      all.insert(all.end(), (part.*array).begin(), (part.*array).end());
    }
    return all;
  }
  std::vector<float> joined_sh() const {
    std::vector<float> all;
    for (const SplatArrays& part : parts) {
      const size_t known = size_t{3} * (part.sh_degree + 1) * (part.sh_degree + 1);
      for (size_t i = 0; i < part.count(); ++i) {
        const float* row = part.sh.data() + i * known;
        all.insert(all.end(), row, row + known);
        all.resize(all.size() + kCoefficients - known, 0.0F);
      }
    }
    return all;
  }
};

TEST(ShownStreams, JoinSlicesBitByBit) {
  const ThreeStreams s;
  SliceOptions options;
  options.shape = options.color = options.id = true;
  std::vector<const float*> rows(s.count);
  std::vector<float> pointed;
  const SplatArrays all = splats_of(3, options, [&](l4d_splat_buffers* b) {
    if (b->capacity > 0) b->sh_rows = rows.data();
    ASSERT_EQ(l4d_slice_streams(s.streams.data(), 3, b), L4D_OK) << l4d_last_error_message();
    EXPECT_EQ(b->count, s.count);
    EXPECT_EQ(b->num_still + b->still_key, 0u);
  });
  EXPECT_EQ(all.position, s.joined(&SplatArrays::position));
  EXPECT_EQ(all.covariance, s.joined(&SplatArrays::covariance));
  EXPECT_EQ(all.opacity, s.joined(&SplatArrays::opacity));
  EXPECT_EQ(all.scale, s.joined(&SplatArrays::scale));
  EXPECT_EQ(all.rotation, s.joined(&SplatArrays::rotation));
  EXPECT_EQ(all.color, s.joined(&SplatArrays::color));
  EXPECT_EQ(all.id.size(), s.count);
  EXPECT_EQ(all.sh, s.joined_sh());
  for (const float* row : rows) pointed.insert(pointed.end(), row, row + kCoefficients);
  EXPECT_EQ(pointed, all.sh);
}

TEST(ShownStreams, JoinColumns) {
  const ThreeStreams s;
  const auto slice = [](const l4d_shown_stream* streams, uint64_t count,
                        std::vector<std::vector<float>>* out) {
    l4d_splat_columns c = L4D_INIT(l4d_splat_columns);
    c.min_opacity = 1.0F / 255;
    ASSERT_EQ(l4d_slice_streams_columns(streams, count, &c), L4D_OK);
    const size_t n = static_cast<size_t>(c.count);
    out->assign(10, std::vector<float>(n));
    std::vector<const float*> rows(n);
    for (size_t k = 0; k < 3; ++k) c.position[k] = (*out)[k].data();
    for (size_t k = 0; k < 6; ++k) c.covariance[k] = (*out)[3 + k].data();
    c.opacity = (*out)[9].data();
    c.sh_rows = rows.data();
    c.capacity = n;
    ASSERT_EQ(l4d_slice_streams_columns(streams, count, &c), L4D_OK);
    std::vector<float> sh;
    const size_t width = count > 1 ? kCoefficients : 3;
    for (const float* row : rows) sh.insert(sh.end(), row, row + width);
    out->push_back(sh);
  };
  std::vector<std::vector<float>> all, expected(10);
  slice(s.streams.data(), 3, &all);
  for (size_t k = 0; k < 3; ++k) {
    std::vector<std::vector<float>> part;
    slice(&s.streams[k], 1, &part);
    for (size_t a = 0; a < 10; ++a) {
      expected[a].insert(expected[a].end(), part[a].begin(), part[a].end());
    }
  }
  ASSERT_EQ(all.size(), 11u);
  for (size_t a = 0; a < 10; ++a) EXPECT_EQ(all[a], expected[a]);
  // Coefficients that the last stream lacks are 0.
  for (size_t k = kCoefficients - 45; k < kCoefficients; ++k) {
    EXPECT_EQ(all[10][all[10].size() - kCoefficients + k], 0.0F);
  }
}

TEST(ShownStreams, SayWhatFailed) {
  ThreeStreams s;
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  std::vector<float> opacity(s.count, 7.0F);
  b.opacity = opacity.data();
  for (const size_t capacity : {size_t{0}, s.parts[0].count(), s.count - 1}) {
    b.capacity = capacity;
    EXPECT_EQ(l4d_slice_streams(s.streams.data(), 3, &b), L4D_ERR_BUFFER_TOO_SMALL);
    EXPECT_EQ(b.count, s.count);
    for (size_t i = capacity; i < s.count; ++i) ASSERT_EQ(opacity[i], 7.0F);
  }
  b.capacity = s.count;
  EXPECT_EQ(l4d_slice_streams(s.streams.data(), 3, &b), L4D_OK);
  EXPECT_EQ(l4d_slice_streams(s.streams.data(), 0, &b), L4D_ERR_INVALID_ARGUMENT);
  s.streams[2] = s.streams[0];
  EXPECT_EQ(l4d_slice_streams(s.streams.data(), 3, &b), L4D_ERR_INVALID_ARGUMENT);
  const DecoderHandle closed;
  s.streams[2].decoder = closed.get();
  EXPECT_EQ(l4d_slice_streams(s.streams.data(), 3, &b), L4D_ERR_INVALID_STATE);
  EXPECT_STRNE(l4d_last_error_message(), "");
}

}  // namespace
}  // namespace l4d
