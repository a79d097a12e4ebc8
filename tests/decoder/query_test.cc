// SPDX-License-Identifier: Apache-2.0
// A query by time gives everything visible then, and reads little more.
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <set>

#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/decoder/rows.h"

namespace l4d {
namespace {

using namespace test;

// A long sequence with a frame rate that is no binary fraction and a late beginning.
const Bytes& late_file() {
  static const Bytes kBytes = [] {
    SceneOptions s;
    s.count = 3000;
    s.sh_degree = 0;
    s.num_frames = 1000;
    s.fps_num = 30000;
    s.fps_den = 1001;
    s.time_begin = 3600;
    s.permanent = 0.1;
    s.seed = 5;
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_MERGE_COUNT, 10});
    return encode(make_scene(s), o).bytes;
  }();
  return kBytes;
}

class Query : public testing::TestWithParam<NamedFile> {
 protected:
  void SetUp() override {
    const Bytes& bytes = GetParam().bytes();
    d_.open_memory(bytes.data(), bytes.size());
    info_ = d_.info();
    all_ = d_.decode(all_query());
    visibility_ = test::visibility(d_, all_);
    for (size_t i = 0; i < all_.count(); ++i) all_rows_.push_back(row(all_, i));
    begin_ = info_.timeline.time_begin;
    end_ = begin_ + info_.duration;
  }
  // Random times, frames, and the borders of all buckets with their neighbours.
  std::vector<double> times() const {
    std::vector<double> t = {begin_, end_};
    Random random(3);
    for (int i = 0; i < 25; ++i) t.push_back(random.uniform(begin_, end_));
    for (int i = 0; i < 10; ++i) {
      const double frame = random.below(info_.timeline.num_frames);
      t.push_back(begin_ + frame * info_.timeline.fps_den / info_.timeline.fps_num);
    }
    std::set<uint32_t> levels;
    for (const l4d_bucket_span& r : all_.spans) levels.insert(r.level);
    for (const uint32_t level : levels) {
      const uint32_t buckets = level == 0 ? 1 : 2u << level;
      for (int i = 0; i < 4; ++i) {
        const double border = begin_ + info_.duration * random.below(buckets + 1) / buckets;
        t.push_back(border);
        t.push_back(std::nextafter(border, begin_ - 1));
        t.push_back(std::nextafter(border, end_ + 1));
      }
    }
    for (double& x : t) x = std::min(std::max(x, begin_), end_);
    return t;
  }
  Rows visible_rows(double from, double to) const {
    Rows found;
    for (size_t i = 0; i < all_.count(); ++i) {
      const double t = std::min(std::max(visibility_.mean[i], from), to);  // nearest to the mean
      if (visibility_.visible(i, t)) found.push_back(all_rows_[i]);
    }
    std::sort(found.begin(), found.end());
    return found;
  }

  const l4d_decoder_options options_ = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d_{&options_};
  l4d_info info_{};
  GaussianArrays all_;
  Rows all_rows_;  // in decoded order
  Visibility visibility_;
  double begin_ = 0, end_ = 0;
};

// spec: DEC-2
TEST_P(Query, AllHoldsEveryGaussian) {
  EXPECT_EQ(all_.count(), info_.num_gaussians);
  uint64_t first = 0;
  for (const l4d_bucket_span& r : all_.spans) {
    EXPECT_EQ(r.first, first);
    first += r.count;
  }
  EXPECT_EQ(first, all_.count());
}

// spec: LAYR-2
TEST_P(Query, TimeHoldsAllThatIsVisible) {
  const Rows whole = rows(all_);
  for (const double t : times()) {
    const GaussianArrays got = d_.decode(time_query(t));
    const Rows got_rows = rows(got);
    EXPECT_TRUE(contains(whole, got_rows)) << t;
    EXPECT_TRUE(contains(got_rows, visible_rows(t, t))) << "time " << t - begin_;
    EXPECT_EQ(d_.select(time_query(t)).num_gaussians, got.count());
  }
}

// spec: LAYR-2
TEST_P(Query, RangeHoldsAllThatIsVisibleInIt) {
  Random random(8);
  std::vector<double> t = times();
  for (int i = 0; i < 20; ++i) {
    double a = t[random.below(static_cast<uint32_t>(t.size()))];
    double b = t[random.below(static_cast<uint32_t>(t.size()))];
    if (a > b) std::swap(a, b);
    const Rows got = rows(d_.decode(range_query(a, b)));
    EXPECT_TRUE(contains(got, visible_rows(a, b))) << a << " to " << b;
    EXPECT_TRUE(contains(got, rows(d_.decode(time_query(a)))));
    EXPECT_TRUE(contains(got, rows(d_.decode(time_query(b)))));
  }
  EXPECT_TRUE(contains(rows(d_.decode(range_query(begin_, end_))), visible_rows(begin_, end_)));
}

TEST_P(Query, RangeOfOneInstantIsTheTime) {
  for (const double t : {begin_, 0.5 * (begin_ + end_), end_}) {
    EXPECT_TRUE(same_bits(d_.decode(range_query(t, t)), d_.decode(time_query(t))));
  }
}

TEST_P(Query, TimesAreClampedToTheSequence) {
  const double inf = std::numeric_limits<double>::infinity();
  for (const double early : {begin_ - 1e-9, begin_ - 1000, -inf}) {
    EXPECT_TRUE(same_bits(d_.decode(time_query(early)), d_.decode(time_query(begin_))));
  }
  for (const double late : {end_ + 1e-9, end_ + 1000, inf}) {
    EXPECT_TRUE(same_bits(d_.decode(time_query(late)), d_.decode(time_query(end_))));
  }
  EXPECT_TRUE(same_bits(d_.decode(range_query(-inf, inf)), d_.decode(range_query(begin_, end_))));
}

TEST_P(Query, MaxLevelLeavesOutFinerLayers) {
  for (uint32_t level = 0; level < 12; ++level) {
    for (l4d_query q : {all_query(), time_query(0.3 * begin_ + 0.7 * end_)}) {
      const GaussianArrays whole = d_.decode(q);
      q.point.levels = level + 1;
      const GaussianArrays part = d_.decode(q);
      uint64_t want = 0;
      for (const l4d_bucket_span& r : whole.spans) want += r.level <= level ? r.count : 0;
      EXPECT_EQ(part.count(), want);
      for (const l4d_bucket_span& r : part.spans) EXPECT_LE(r.level, level);
      EXPECT_TRUE(contains(rows(whole), rows(part)));
    }
  }
}

TEST_P(Query, RangesDescribeTheirBuckets) {
  for (const l4d_query& q : {all_query(), time_query(0.5 * (begin_ + end_))}) {
    const GaussianArrays a = d_.decode(q);
    std::set<std::pair<uint32_t, uint32_t>> seen;
    for (const l4d_bucket_span& r : a.spans) {
      l4d_layer_info layer = L4D_INIT(l4d_layer_info);
      ASSERT_EQ(l4d_decoder_get_layer_info(d_.get(), r.layer, &layer), L4D_OK);
      EXPECT_EQ(layer.index, r.layer);
      EXPECT_EQ(layer.level, r.level);
      EXPECT_LT(r.bucket, layer.num_buckets);
      EXPECT_EQ(layer.num_buckets, r.level == 0 ? 1u : 2u << r.level);
      EXPECT_EQ(r.width, layer.bucket_width);
      EXPECT_EQ(r.width, info_.duration / static_cast<double>(layer.num_buckets));
      EXPECT_NEAR(r.center, begin_ + (r.bucket + 0.5) * r.width, 1e-9);
      EXPECT_TRUE(seen.emplace(r.layer, r.bucket).second) << "a bucket in two ranges";
    }
  }
}

// The point of layers: an instant costs a part of the file.
TEST_P(Query, AnInstantReadsLittleMoreThanItShows) {
  const l4d_selection whole = d_.select(all_query());
  const l4d_selection now = d_.select(time_query(0.37 * begin_ + 0.63 * end_));
  EXPECT_LT(now.num_gaussians, whole.num_gaussians);
  EXPECT_LT(now.bytes, whole.bytes);
  uint64_t in_reach = 0;
  for (size_t i = 0; i < all_.count(); ++i) {
    in_reach += visibility_.visible(i, 0.37 * begin_ + 0.63 * end_);
  }
  EXPECT_LT(now.num_gaussians, 3 * in_reach + 300);
}

std::vector<l4d_bucket_span> ranges_of(const DecoderHandle& d, const l4d_query& q) {
  uint64_t count = 0;
  EXPECT_EQ(l4d_decoder_get_spans(d.get(), &q, nullptr, 0, &count), L4D_OK);
  std::vector<l4d_bucket_span> spans(static_cast<size_t>(count));
  EXPECT_EQ(l4d_decoder_get_spans(d.get(), &q, spans.data(), count, &count), L4D_OK);
  EXPECT_EQ(count, spans.size());
  return spans;
}
std::vector<l4d_bucket> buckets_of(const std::vector<l4d_bucket_span>& spans) {
  std::vector<l4d_bucket> buckets;
  for (const l4d_bucket_span& r : spans) buckets.push_back({r.layer, r.bucket});
  return buckets;
}
l4d_query bucket_query(const std::vector<l4d_bucket>& buckets) {
  l4d_query q = all_query();
  q.kind = L4D_QUERY_BUCKETS;
  q.buckets = buckets.data();
  q.num_buckets = buckets.size();
  return q;
}

TEST_P(Query, RangesComeFromTheDirectoryAlone) {
  for (const l4d_query& q : {all_query(), time_query(0.5 * (begin_ + end_))}) {
    const std::vector<l4d_bucket_span> spans = ranges_of(d_, q);
    const GaussianArrays a = d_.decode(q);
    ASSERT_EQ(spans.size(), a.spans.size());
    for (size_t i = 0; i < spans.size(); ++i) {
      EXPECT_EQ(std::memcmp(&spans[i], &a.spans[i], sizeof(l4d_bucket_span)), 0) << i;
    }
  }
}

// What a cache of buckets does: it learns which it needs, and decodes those that it lacks.
TEST_P(Query, ListedBucketsAreThoseOfATime) {
  for (const double t : times()) {
    l4d_query q = time_query(t);
    const Rows pages = rows(d_.decode(q));
    q.whole_buckets = 1;
    const GaussianArrays whole = d_.decode(q);
    EXPECT_TRUE(contains(rows(whole), pages));
    const std::vector<l4d_bucket> buckets = buckets_of(ranges_of(d_, q));
    EXPECT_TRUE(same_bits(d_.decode(bucket_query(buckets)), whole));
    // Each by itself is its range of the whole.
    for (size_t i = 0; i < buckets.size(); i += 1 + buckets.size() / 3) {
      const GaussianArrays one = d_.decode(bucket_query({buckets[i]}));
      ASSERT_EQ(one.count(), whole.spans[i].count);
      for (size_t k = 0; k < one.count(); ++k) {
        ASSERT_EQ(row(one, k), row(whole, static_cast<size_t>(whole.spans[i].first) + k));
      }
    }
  }
}

TEST_P(Query, EveryBucketListedIsTheWhole) {
  const std::vector<l4d_bucket> buckets = buckets_of(all_.spans);
  l4d_query q = bucket_query(buckets);
  EXPECT_TRUE(same_bits(d_.decode(q), all_));
  EXPECT_EQ(d_.select(q).directory_bytes, d_.select(all_query()).directory_bytes);
  // Every second one leaves gaps in the directory pages.
  std::vector<l4d_bucket> some;
  uint64_t want = 0;
  for (size_t i = 0; i < buckets.size(); i += 2) {
    some.push_back(buckets[i]);
    want += all_.spans[i].count;
  }
  EXPECT_EQ(d_.decode(bucket_query(some)).count(), want);
  q = bucket_query({});
  EXPECT_EQ(d_.decode(q).count(), 0u);
}

INSTANTIATE_TEST_SUITE_P(Streams, Query,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file},
                                         NamedFile{"late", late_file}),
                         file_name);

TEST(QueryArguments, AreChecked) {
  DecoderHandle d;
  d.open_memory(tiny_file().data(), tiny_file().size());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  l4d_selection s = L4D_INIT(l4d_selection);
  l4d_query unknown = time_query(0), unit = time_query(0), no_list = all_query();
  unknown.kind = 4;
  unit.whole_buckets = 2;
  no_list.kind = L4D_QUERY_BUCKETS;
  no_list.num_buckets = 1;
  const std::vector<l4d_bucket> no_layer = {{99, 0}}, no_bucket = {{0, 1u << 30}},
                                twice = {{0, 0}, {0, 0}}, descending = {{1, 0}, {0, 0}};
  for (const l4d_query& q :
       {unknown, time_query(nan), range_query(nan, 1), range_query(0, nan), range_query(1, 0.5),
        unit, no_list, bucket_query(no_layer), bucket_query(no_bucket), bucket_query(twice),
        bucket_query(descending)}) {
    EXPECT_EQ(l4d_decoder_select(d.get(), &q, &s), L4D_ERR_INVALID_ARGUMENT);
    EXPECT_STRNE(l4d_last_error_message(), "");
  }
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  EXPECT_EQ(l4d_decoder_slice(d.get(), nan, &b), L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d
