// SPDX-License-Identifier: Apache-2.0
// Gaussians that look the same at all times: written once, for as long as the caller keeps them.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

// Arrays that a caller keeps from instant to instant.
struct Kept {
  std::vector<float> position, covariance, opacity, sh;
  std::vector<const float*> rows;
  uint64_t key = 0;
  uint64_t count = 0, still = 0;

  Kept(size_t capacity, size_t sh_dim)
      : position(3 * capacity),
        covariance(6 * capacity),
        opacity(capacity),
        sh(sh_dim * capacity),
        rows(capacity) {}
  void slice(const DecoderHandle& d, double time, uint32_t detail = L4D_DETAIL_FULL) {
    l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
    b.point.detail = detail;
    b.capacity = opacity.size();
    b.position = position.data();
    b.covariance = covariance.data();
    b.opacity = opacity.data();
    b.sh = sh.data();
    b.sh_rows = rows.data();
    b.still_key = key;
    d.check(l4d_decoder_slice(d.get(), time, &b));
    key = b.still_key;
    count = b.count;
    still = b.num_still;
  }
};

// As the first numbers of a row of b.
testing::AssertionResult begins_with(const std::vector<float>& a, const std::vector<float>& b,
                                     size_t width, size_t first, size_t count) {
  for (size_t k = width * first; k < width * count; ++k) {
    if (a[k] != b[k]) return testing::AssertionFailure() << "number " << k;
  }
  return testing::AssertionSuccess();
}

void expect_rows(const Kept& kept, const SplatArrays& fresh, size_t sh_dim, size_t first) {
  ASSERT_EQ(kept.count, fresh.count());
  const size_t n = fresh.count();
  EXPECT_TRUE(begins_with(kept.position, fresh.position, 3, first, n));
  EXPECT_TRUE(begins_with(kept.covariance, fresh.covariance, 6, first, n));
  EXPECT_TRUE(begins_with(kept.opacity, fresh.opacity, 1, first, n));
  EXPECT_TRUE(begins_with(kept.sh, fresh.sh, sh_dim, first, n));
}

TEST(Still, RowsAreWrittenOnceAndStayRight) {
  const Bytes& bytes = dynamic_file();
  DecoderHandle d, other;
  d.open_memory(bytes.data(), bytes.size());
  other.open_memory(bytes.data(), bytes.size());
  const l4d_info info = d.info();
  const size_t sh_dim = size_t{3} * (info.sh_degree + 1) * (info.sh_degree + 1);
  Kept kept(static_cast<size_t>(info.num_gaussians), sh_dim);
  uint64_t still = 0;
  for (uint32_t l = 0; l < info.num_layers; ++l) {
    const l4d_layer_info layer = d.layer_info(l);
    if (layer.permanent != 0) still += layer.num_gaussians;
  }
  ASSERT_GT(still, 100u);
  for (const double time : {0.1, 0.9, 1.7, 0.4}) {
    kept.slice(d, time);
    const SplatArrays fresh = other.slice(time);
    EXPECT_EQ(kept.still, still);
    EXPECT_GT(kept.count, still);
    expect_rows(kept, fresh, sh_dim, 0);
  }
  // What the caller says that it has is not written again, and all that is not, is.
  const uint64_t key = kept.key;
  EXPECT_NE(key, 0u);
  const size_t first = static_cast<size_t>(still);
  constexpr float kMark = 12345;
  const auto mark = [&] {
    for (auto* column : {&kept.position, &kept.covariance, &kept.opacity, &kept.sh}) {
      std::fill(column->begin(), column->end(), kMark);
    }
  };
  mark();
  kept.slice(d, 1.2);
  EXPECT_EQ(kept.key, key);
  EXPECT_EQ(
      std::count(kept.opacity.begin(), kept.opacity.begin() + static_cast<long>(first), kMark),
      static_cast<long>(first));
  EXPECT_EQ(kept.position[3 * first - 1], kMark);
  EXPECT_EQ(kept.covariance[6 * first - 1], kMark);
  EXPECT_EQ(kept.sh[sh_dim * first - 1], kMark);
  expect_rows(kept, other.slice(1.2), sh_dim, first);
  // Counting alone says nothing of arrays.
  l4d_splat_buffers count = L4D_INIT(l4d_splat_buffers);
  count.still_key = key;
  d.check(l4d_decoder_slice(d.get(), 1.2, &count));
  EXPECT_EQ(count.count, kept.count);
  EXPECT_EQ(count.num_still, still);
  EXPECT_EQ(count.still_key, 0u);
  // Another detail is another set of rows; so is another stream.
  mark();
  kept.slice(d, 1.2, L4D_DETAIL_BASE_COLOR);
  EXPECT_NE(kept.key, key);
  EXPECT_EQ(std::count(kept.opacity.begin(), kept.opacity.end(), kMark),
            static_cast<long>(kept.opacity.size() - kept.count));
  const uint64_t before = kept.key;
  d.open_memory(bytes.data(), bytes.size());
  mark();
  kept.slice(d, 1.2);
  EXPECT_NE(kept.key, before);
  expect_rows(kept, other.slice(1.2), sh_dim, 0);
}

// Buckets that were evicted and decoded again lie elsewhere: rows of pointers have to be new.
TEST(Still, EvictedBucketsAreWrittenAgain) {
  const Bytes& bytes = dynamic_file();
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.cache_bytes = 1;
  DecoderHandle d(&options);
  d.open_memory(bytes.data(), bytes.size());
  const l4d_info info = d.info();
  const size_t sh_dim = size_t{3} * (info.sh_degree + 1) * (info.sh_degree + 1);
  Kept kept(static_cast<size_t>(info.num_gaussians), sh_dim);
  for (const double time : {0.1, 0.9, 1.7, 0.4}) {
    kept.slice(d, time);
    for (size_t i = 0; i < kept.count; ++i) {
      ASSERT_TRUE(std::equal(kept.rows[i], kept.rows[i] + sh_dim, kept.sh.data() + sh_dim * i));
    }
    Kept whole(kept.opacity.size(), sh_dim);
    whole.slice(d, time);
    SplatArrays same;
    same.position = whole.position;
    same.covariance = whole.covariance;
    same.opacity.assign(whole.opacity.begin(),
                        whole.opacity.begin() + static_cast<std::ptrdiff_t>(whole.count));
    same.sh = whole.sh;
    expect_rows(kept, same, sh_dim, 0);
    d.slice(time, {{0, 0, L4D_DETAIL_BASE_COLOR, 0}});
  }
}

}  // namespace
}  // namespace l4d
