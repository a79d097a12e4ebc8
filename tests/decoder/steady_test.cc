// SPDX-License-Identifier: Apache-2.0
// Steady playback allocates nothing: once the cache holds the buckets, slices write to the arrays
// of the caller and to nothing else.
#include <gtest/gtest.h>

#include <vector>

#include "tests/common/codec.h"
#include "tests/decoder/allocation_meter.h"

namespace l4d {
namespace {

using namespace test;

// A player's arrays, for both forms of slices.
struct Player {
  std::vector<float> numbers;
  std::vector<const float*> rows;
  std::vector<l4d_gaussian_id> id;
  l4d_splat_buffers buffers;
  l4d_splat_columns columns;

  Player(size_t n, bool with_all) : numbers(36 * n), rows(n), id(n) {
    float* next = numbers.data();
    const auto take = [&](size_t width) {
      float* const array = next;
      next += width * n;
      return array;
    };
    buffers = L4D_INIT(l4d_splat_buffers);
    buffers.capacity = n;
    buffers.position = take(3);
    buffers.covariance = take(6);
    buffers.opacity = take(1);
    buffers.sh_rows = rows.data();
    columns = L4D_INIT(l4d_splat_columns);
    columns.capacity = n;
    for (float*& axis : columns.position) axis = take(1);
    for (float*& entry : columns.covariance) entry = take(1);
    columns.opacity = take(1);
    columns.sh_rows = rows.data();
    columns.min_opacity = 1.0f / 255;
    if (!with_all) return;
    buffers.scale = take(3);
    buffers.rotation = take(4);
    buffers.color = take(3);
    buffers.id = id.data();
    for (size_t k = 0; k < 3; ++k) columns.scale[k] = buffers.scale + k * n;
    for (size_t k = 0; k < 4; ++k) columns.rotation[k] = buffers.rotation + k * n;
    for (size_t k = 0; k < 3; ++k) columns.color[k] = buffers.color + k * n;
    columns.id = id.data();
  }
  void show(const DecoderHandle& d, double time) {
    d.check(l4d_decoder_slice(d.get(), time, &buffers));
    d.check(slice_columns(d.get(), time, &columns));
  }
};

class Steady : public testing::TestWithParam<NamedFile> {};

TEST_P(Steady, PlaybackAllocatesNothing) {
  const Bytes& bytes = GetParam().bytes();
  for (const bool with_all : {false, true}) {
    const l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
    DecoderHandle d(&options);
    d.open_memory(bytes.data(), bytes.size());
    const l4d_info info = d.info();
    Player player(static_cast<size_t>(info.num_gaussians), with_all);
    const auto time_of = [&](uint32_t frame) {
      return info.timeline.time_begin +
             static_cast<double>(frame) * info.timeline.fps_den / info.timeline.fps_num;
    };
    const auto play = [&](uint32_t frames) {
      const AllocationMeter meter;
      for (uint32_t k = 0; k < frames; ++k) player.show(d, time_of(k));
      return meter.count();
    };
    // The first loop decodes: the meter counts that.
    const uint64_t first = play(info.timeline.num_frames);
    EXPECT_GT(first, 0u);
    EXPECT_EQ(play(info.timeline.num_frames), 0u) << with_all;
    // Nor do seeks.
    const AllocationMeter meter;
    for (const uint32_t frame : {17u, 3u, 40u, 4u}) player.show(d, time_of(frame));
    const uint64_t seeks = meter.count();
    EXPECT_EQ(seeks, 0u) << with_all;
  }
}

// Within the buckets at hand nothing is allocated from the second frame on.
TEST_P(Steady, FramesOfOneBucketAllocateNothing) {
  const Bytes& bytes = GetParam().bytes();
  const l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&options);
  d.open_memory(bytes.data(), bytes.size());
  const l4d_info info = d.info();
  Player player(static_cast<size_t>(info.num_gaussians), true);
  const double begin = info.timeline.time_begin + 0.5;
  player.show(d, begin);
  l4d_counters before, after;
  before = L4D_INIT(l4d_counters);
  after = L4D_INIT(l4d_counters);
  size_t steady = 0;
  for (int k = 1; k < 60; ++k) {
    d.check(l4d_decoder_get_counters(d.get(), &before));
    const AllocationMeter meter;
    player.show(d, begin + 0.01 * k);
    const uint64_t count = meter.count();
    d.check(l4d_decoder_get_counters(d.get(), &after));
    if (after.buckets_decoded != before.buckets_decoded || after.reads != before.reads) continue;
    EXPECT_EQ(count, 0u) << "step " << k;
    ++steady;
  }
  EXPECT_GT(steady, 20u);
}

INSTANTIATE_TEST_SUITE_P(Streams, Steady,
                         testing::Values(NamedFile{"indexed", dynamic_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file},
                                         NamedFile{"wandering", wandering_file}),
                         file_name);

}  // namespace
}  // namespace l4d
