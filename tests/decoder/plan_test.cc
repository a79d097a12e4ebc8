// SPDX-License-Identifier: Apache-2.0
// Which pages a query selects, against brute force over all page records of the stream, at the very
// ends of the times at which they say they are visible.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <vector>

#include "libl4dcodec/scene/layers.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"

namespace l4d {
namespace {

using namespace test;

// A page and the instants at which it may be visible, by the definitions.
struct Page {
  uint32_t layer, level, bucket, num_gaussians;
  double begin, end;  // seconds; unbounded in a permanent layer
};

std::vector<Page> pages_of(const Bytes& bytes) {
  const StreamEditor file(bytes);
  const l4d_timeline& t = file.header.timeline;
  const double duration = static_cast<double>(t.num_frames) * t.fps_den / t.fps_num;
  std::vector<Page> out;
  for (uint32_t l = 0; l < file.layers.size(); ++l) {
    const LayerHeader& layer = file.header.layers[l];
    const double buckets = layer.level == 0 ? 1 : std::exp2(layer.level + 1.0);
    const double width = duration / buckets;
    for (const EditedDirectoryPage& directory : file.layers[l].directory) {
      if (!directory.present) continue;
      for (const PageRecord& p : directory.page.pages) {
        const double center = t.time_begin + (p.bucket + 0.5) * width;
        Page page{l, layer.level, p.bucket, p.num_gaussians, -HUGE_VAL, HUGE_VAL};
        if (!layer.permanent) {
          page.begin = center + (p.visible_begin - 128) * (width / 64);
          page.end = center + (p.visible_end - 128) * (width / 64);
        }
        out.push_back(page);
      }
    }
  }
  return out;
}

struct Wanted {
  uint64_t pages = 0, gaussians = 0;
  uint64_t whole_pages = 0, whole_gaussians = 0;  // of buckets of which anything is wanted
};

// Nothing is visible beyond the neighbours of its bucket, whatever a page says.
Wanted brute_force(const l4d_timeline& timeline, const std::vector<Page>& pages, double begin,
                   double end) {
  Wanted out;
  std::set<std::pair<uint32_t, uint32_t>> buckets;
  for (const Page& p : pages) {
    if (end < p.begin || begin > p.end) continue;
    if (p.bucket + 1 < bucket_of_time(timeline, begin, p.level)) continue;
    if (p.bucket > bucket_of_time(timeline, end, p.level) + 1) continue;
    ++out.pages;
    out.gaussians += p.num_gaussians;
    buckets.emplace(p.layer, p.bucket);
  }
  for (const Page& p : pages) {
    if (buckets.count({p.layer, p.bucket}) == 0) continue;
    ++out.whole_pages;
    out.whole_gaussians += p.num_gaussians;
  }
  return out;
}

class Plan : public testing::TestWithParam<NamedFile> {};

TEST_P(Plan, PagesAreSelectedForAsLongAsTheySay) {
  const Bytes& bytes = GetParam().bytes();
  const std::vector<Page> pages = pages_of(bytes);
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  const l4d_info info = d.info();
  const double first = info.timeline.time_begin, last = first + info.duration;
  std::set<double> times = {first, last};
  for (const Page& p : pages) {
    for (const double edge : {p.begin, p.end}) {
      for (const double t : {edge, std::nextafter(edge, -HUGE_VAL), std::nextafter(edge, HUGE_VAL),
                             edge + 1e-7, edge - 1e-7}) {
        if (t >= first && t <= last) times.insert(t);
      }
    }
  }
  ASSERT_GT(times.size(), 50u);
  const auto expect = [&](l4d_query q, const Wanted& want) {
    const l4d_selection some = d.select(q);
    EXPECT_EQ(some.num_pages, want.pages) << q.time_begin;
    EXPECT_EQ(some.num_gaussians, want.gaussians) << q.time_begin;
    q.whole_buckets = 1;
    const l4d_selection whole = d.select(q);
    EXPECT_EQ(whole.num_pages, want.whole_pages) << q.time_begin;
    EXPECT_EQ(whole.num_gaussians, want.whole_gaussians) << q.time_begin;
  };
  double before = first;
  size_t step = 0;
  for (const double t : times) {
    expect(time_query(t), brute_force(info.timeline, pages, t, t));
    if (++step % 16 == 0) {
      expect(range_query(before, t), brute_force(info.timeline, pages, before, t));
      before = t;
    }
    ASSERT_FALSE(HasFailure());
  }
  uint64_t all = 0;
  for (const Page& p : pages) all += p.num_gaussians;
  EXPECT_EQ(d.select(all_query()).num_gaussians, all);
  EXPECT_EQ(d.select(all_query()).num_pages, pages.size());
  EXPECT_EQ(all, info.num_gaussians);
}

INSTANTIATE_TEST_SUITE_P(Streams, Plan,
                         testing::Values(NamedFile{"indexed", dynamic_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"lossless", lossless_file}),
                         file_name);

}  // namespace
}  // namespace l4d
