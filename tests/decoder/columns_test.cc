// SPDX-License-Identifier: Apache-2.0
// Slices as columns: the Gaussians of l4d_decoder_slice, in another order and array.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

// A renderer's arrays, kept from instant to instant.
struct Columns {
  std::vector<float> position[3], covariance[6], opacity;
  std::vector<const float*> rows;
  l4d_splat_columns columns;

  explicit Columns(size_t capacity) {
    columns = L4D_INIT(l4d_splat_columns);
    resize(capacity);
  }
  void resize(size_t capacity) {
    columns.capacity = capacity;
    for (size_t k = 0; k < 3; ++k) {
      position[k].resize(capacity);
      columns.position[k] = position[k].data();
    }
    for (size_t k = 0; k < 6; ++k) {
      covariance[k].resize(capacity);
      columns.covariance[k] = covariance[k].data();
    }
    opacity.resize(capacity);
    rows.resize(capacity);
    columns.opacity = opacity.data();
    columns.sh_rows = rows.data();
  }
  l4d_status slice(const DecoderHandle& d, double time) {
    return slice_columns(d.get(), time, &columns);
  }
};

// What l4d_decoder_slice gives of each Gaussian, by where its SH lies, which both forms tell.
using Splat = std::vector<float>;  // position, covariance, opacity
std::map<const float*, Splat> splats_at(const DecoderHandle& d, double time) {
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  d.check(l4d_decoder_slice(d.get(), time, &b));
  const size_t n = static_cast<size_t>(b.count);
  std::vector<float> position(3 * n), covariance(6 * n), opacity(n);
  std::vector<const float*> rows(n);
  b.capacity = n;
  b.position = position.data();
  b.covariance = covariance.data();
  b.opacity = opacity.data();
  b.sh_rows = rows.data();
  d.check(l4d_decoder_slice(d.get(), time, &b));
  std::map<const float*, Splat> out;
  for (size_t i = 0; i < n; ++i) {
    Splat& s = out[rows[i]];
    s.assign(&position[3 * i], &position[3 * i] + 3);
    s.insert(s.end(), &covariance[6 * i], &covariance[6 * i] + 6);
    s.push_back(opacity[i]);
  }
  EXPECT_EQ(out.size(), n);
  return out;
}

std::map<const float*, Splat> splats_of(const Columns& c) {
  std::map<const float*, Splat> out;
  for (size_t i = 0; i < c.columns.count; ++i) {
    Splat& s = out[c.rows[i]];
    for (const auto& axis : c.position) s.push_back(axis[i]);
    for (const auto& entry : c.covariance) s.push_back(entry[i]);
    s.push_back(c.opacity[i]);
  }
  EXPECT_EQ(out.size(), c.columns.count) << "a Gaussian is there twice";
  return out;
}

DecoderHandle open(const Bytes& bytes, uint32_t threads = 1) {
  const l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, threads);
  DecoderHandle d(&options);
  d.open_memory(bytes.data(), bytes.size());
  return d;
}

TEST(Columns, HoldTheGaussiansOfTheSliceBitForBit) {
  for (const uint32_t threads : {1u, 3u}) {
    const Bytes& bytes = dynamic_file();
    const DecoderHandle d = open(bytes, threads);
    Columns c(static_cast<size_t>(d.info().num_gaussians));
    for (const double time : {-1.0, 0.0, 0.1, 0.11, 0.9, 1.7, 0.4, 99.0}) {
      d.check(c.slice(d, time));
      EXPECT_GT(c.columns.num_still, 0u);
      EXPECT_LT(c.columns.num_still, c.columns.count);
      EXPECT_EQ(splats_of(c), splats_at(d, time)) << time;
      // Each form has still rows of its own, so that the one above is written anew here.
      d.check(c.slice(d, time));
      EXPECT_EQ(splats_of(c), splats_at(d, time)) << time;
    }
  }
}

TEST(Columns, StillRowsAreWrittenOnce) {
  const DecoderHandle d = open(dynamic_file());
  Columns c(static_cast<size_t>(d.info().num_gaussians));
  d.check(c.slice(d, 0.1));
  const std::map<const float*, Splat> before = splats_of(c);
  const uint64_t key = c.columns.still_key;
  const size_t still = static_cast<size_t>(c.columns.num_still);
  ASSERT_GT(still, 0u);
  c.opacity[still - 1] = 7;  // the caller's now
  d.check(c.slice(d, 0.1));
  EXPECT_EQ(c.columns.still_key, key);
  EXPECT_EQ(c.opacity[still - 1], 7);
  // The rows are others where other Gaussians are left out.
  c.columns.min_opacity = 0.5f;
  d.check(c.slice(d, 0.1));
  EXPECT_NE(c.columns.still_key, key);
  c.columns.min_opacity = 0;
  c.columns.still_key = 0;
  d.check(c.slice(d, 0.1));
  EXPECT_EQ(splats_of(c), before);
}

TEST(Columns, LeaveOutWhatIsTooFaintAndNothingElse) {
  const DecoderHandle d = open(dynamic_file());
  Columns c(static_cast<size_t>(d.info().num_gaussians));
  for (const float least : {1.0f / 255.0f, 0.3f, 1.0f, 2.0f}) {
    c.columns.min_opacity = least;
    for (const double time : {0.1, 0.9, 1.7}) {
      const std::map<const float*, Splat> all = splats_at(d, time);
      d.check(c.slice(d, time));
      const std::map<const float*, Splat> shown = splats_of(c);
      size_t bright = 0;
      for (const auto& [row, splat] : all) {
        const bool is_there = shown.count(row) != 0;
        if (splat.back() >= least) {
          ++bright;
          EXPECT_TRUE(is_there) << splat.back();
        } else if (splat.back() < least * 0.999f) {
          EXPECT_FALSE(is_there) << splat.back();
        }
        if (is_there) {
          EXPECT_EQ(shown.at(row), splat);
        }
      }
      EXPECT_GE(shown.size(), bright);
      EXPECT_LT(shown.size(), all.size()) << "something is faint";
    }
  }
}

TEST(Columns, SayHowMuchRoomIsNeeded) {
  const DecoderHandle d = open(dynamic_file());
  Columns c(0);
  EXPECT_EQ(c.slice(d, 0.9), L4D_OK);
  const uint64_t count = c.columns.count;
  ASSERT_GT(count, 10u);
  EXPECT_EQ(c.columns.still_key, 0u);
  c.resize(static_cast<size_t>(count) - 1);
  std::fill(c.opacity.begin(), c.opacity.end(), 7.0f);
  EXPECT_EQ(c.slice(d, 0.9), L4D_ERR_BUFFER_TOO_SMALL);
  EXPECT_EQ(c.columns.count, count);
  EXPECT_EQ(c.columns.still_key, 0u);
  EXPECT_EQ(static_cast<size_t>(std::count(c.opacity.begin(), c.opacity.end(), 7.0f)),
            c.opacity.size())
      << "arrays that are too small are left alone";
  c.resize(static_cast<size_t>(count));
  d.check(c.slice(d, 0.9));
  EXPECT_NE(c.columns.still_key, 0u);
  EXPECT_EQ(splats_of(c), splats_at(d, 0.9));
}

TEST(Columns, RefuseWhatMakesNoSense) {
  const DecoderHandle d = open(dynamic_file());
  Columns c(static_cast<size_t>(d.info().num_gaussians));
  c.columns.covariance[4] = nullptr;
  EXPECT_EQ(c.slice(d, 0.9), L4D_ERR_INVALID_ARGUMENT);
  c.resize(c.opacity.size());
  EXPECT_EQ(c.slice(d, std::nan("")), L4D_ERR_INVALID_ARGUMENT);
  for (const float least : {-1.0f, std::nanf("")}) {
    c.columns.min_opacity = least;
    EXPECT_EQ(c.slice(d, 0.9), L4D_ERR_INVALID_ARGUMENT);
  }
  c.columns.min_opacity = 0;
  EXPECT_EQ(c.slice(d, 0.9), L4D_OK);
  EXPECT_EQ(slice_columns(d.get(), 0.9, nullptr), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(slice_columns(nullptr, 0.9, &c.columns), L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d
