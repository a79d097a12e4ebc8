// SPDX-License-Identifier: Apache-2.0
// The forms in which slices hand Gaussians out besides covariances and SH: axes, colours, ids.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <vector>

#include "libl4dcodec/base/ordered.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"
#include "tests/decoder/damage.h"

namespace l4d {
namespace {

using namespace test;

using Id = std::tuple<uint32_t, uint32_t, uint64_t>;
Id key_of(const l4d_gaussian_id& id) { return {id.layer, id.bucket, id.index}; }

SplatArrays forms(const DecoderHandle& d, double time) {
  SliceOptions options;
  options.shape = options.id = options.color = true;
  options.camera_position[0] = 3;
  options.camera_position[2] = -7;
  return d.slice(time, options);
}

// The same of columns, in the order of l4d_decoder_slice.
SplatArrays column_forms(const DecoderHandle& d, double time) {
  l4d_splat_columns c = L4D_INIT(l4d_splat_columns);
  d.check(slice_columns(d.get(), time, &c));
  const size_t n = static_cast<size_t>(c.count);
  std::vector<std::vector<float>> columns(20, std::vector<float>(n));
  std::vector<const float*> rows(n);
  std::vector<l4d_gaussian_id> id(n);
  float** const arrays[] = {c.position, c.covariance, c.scale, c.rotation, c.color};
  const size_t widths[] = {3, 6, 3, 4, 3};
  size_t next = 0;
  for (size_t a = 0; a < 5; ++a) {
    for (size_t k = 0; k < widths[a]; ++k) arrays[a][k] = columns[next++].data();
  }
  c.opacity = columns[next].data();
  c.sh_rows = rows.data();
  c.id = id.data();
  c.capacity = n;
  c.camera_position[0] = 3;
  c.camera_position[2] = -7;
  d.check(slice_columns(d.get(), time, &c));
  std::map<Id, size_t> order;
  for (size_t i = 0; i < n; ++i) order[key_of(id[i])] = i;
  EXPECT_EQ(order.size(), n);
  SplatArrays s;
  std::vector<float>* const to[] = {&s.position, &s.covariance, &s.scale, &s.rotation, &s.color};
  for (const auto& [key, i] : order) {
    next = 0;
    for (size_t a = 0; a < 5; ++a) {
      for (size_t k = 0; k < widths[a]; ++k) to[a]->push_back(columns[next++][i]);
    }
    s.opacity.push_back(c.opacity[i]);
    s.id.push_back(id[i]);
    s.sh.insert(s.sh.end(), rows[i], rows[i] + 3);  // degree 0 alone
  }
  return s;
}

DecoderHandle open(const Bytes& bytes, uint32_t threads = 1, uint32_t backend = L4D_BACKEND_AUTO) {
  const l4d_decoder_options options = decoder_options(backend, threads);
  DecoderHandle d(&options);
  d.open_memory(bytes.data(), bytes.size());
  return d;
}

// The covariance that axes stand for, in the textbook's formula for w x y z.
void covariance_of(const float* scale, const float* q, double* out /* [6] */) {
  const double w = double{q[0]}, x = double{q[1]}, y = double{q[2]}, z = double{q[3]};
  const double m[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                          {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                          {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  size_t next = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      out[next] = 0;
      for (int k = 0; k < 3; ++k) {
        out[next] += m[i][k] * double{scale[k]} * double{scale[k]} * m[j][k];
      }
      ++next;
    }
  }
}

void expect_axes(const SplatArrays& s) {
  ASSERT_EQ(s.scale.size(), 3 * s.count());
  ASSERT_EQ(s.rotation.size(), 4 * s.count());
  for (size_t i = 0; i < s.count(); ++i) {
    const float* scale = &s.scale[3 * i];
    const float* q = &s.rotation[4 * i];
    ASSERT_TRUE(scale[0] >= scale[1] && scale[1] >= scale[2] && scale[2] >= 0) << i;
    double norm2 = 0;
    for (size_t k = 0; k < 4; ++k) norm2 += double{q[k]} * double{q[k]};
    ASSERT_NEAR(norm2, 1, 1e-6) << i;
    for (size_t k = 1; k < 4; ++k) ASSERT_GE(q[0], std::fabs(q[k])) << i;
    double want[6];
    covariance_of(scale, q, want);
    const float* c = &s.covariance[6 * i];
    const double trace = double{c[0]} + double{c[3]} + double{c[5]};
    for (size_t k = 0; k < 6; ++k) ASSERT_NEAR(want[k], double{c[k]}, 1e-6 * trace) << i;
  }
}

// Flat, thin, round and tiny Gaussians, with motion and without.
const Bytes& shapes_file() {
  static const Bytes kBytes = [] {
    SceneOptions options;
    options.count = 3000;
    TestScene scene = make_scene(options);
    Random random(21);
    const float kinds[][3] = {{-1, -1, -1}, {-1, -1, -14}, {2, -12, -12}, {-14, -14, -14},
                              {3, -3, -9},  {0, 0, -2},    {-9, -9, 4},   {-5, -5.00001f, -5}};
    for (size_t i = 0; i < scene.count(); ++i) {
      const float* kind = kinds[random.below(8)];
      for (size_t k = 0; k < 3; ++k) scene.log_scale[4 * i + k] = kind[(k + i) % 3];
      if (i % 2 == 0) {  // no rotation, or one that is easily lost
        const float turn[8] = {1, i % 4 == 0 ? 0 : 1e-6f, 0, 0, 0, 0, 0, 0};
        std::copy_n(turn, 8, &scene.rotor[8 * i]);
      }
    }
    EncodeOptions o;
    o.preset = "lossless";
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 128}};
    return encode(scene, o).bytes;
  }();
  return kBytes;
}

class SplatForms : public testing::TestWithParam<NamedFile> {};

TEST_P(SplatForms, AxesAreThoseOfTheCovariance) {
  const DecoderHandle d = open(GetParam().bytes());
  for (const double time : {0.0, 0.4, 0.9, 1.7}) {
    const SplatArrays s = forms(d, time);
    ASSERT_GT(s.count(), 10u);
    expect_axes(s);
    ASSERT_FALSE(HasFailure()) << time;
  }
}

// What was there before is the same with the new arrays and without, as rows and as columns, for
// any number of threads and on all backends.
TEST_P(SplatForms, AllFormsAgree) {
  const DecoderHandle plain = open(GetParam().bytes());
  const DecoderHandle one = open(GetParam().bytes());
  const DecoderHandle three = open(GetParam().bytes(), 3);
  const DecoderHandle reference = open(GetParam().bytes(), 2, L4D_BACKEND_REFERENCE);
  for (const double time : {0.0, 0.4, 0.9, 1.7}) {
    const SplatArrays s = forms(one, time);
    ASSERT_TRUE(same_bits(plain.slice(time), s)) << time;
    for (const DecoderHandle* other : {&three, &reference}) {
      const SplatArrays o = forms(*other, time);
      EXPECT_TRUE(same_bits("scale", s.scale, o.scale));
      EXPECT_TRUE(same_bits("rotation", s.rotation, o.rotation));
      EXPECT_TRUE(same_bits("color", s.color, o.color));
    }
    const SplatArrays c = column_forms(three, time);
    ASSERT_EQ(c.count(), s.count());
    // Rows are in the order of layers and buckets, and so are ids.
    for (size_t i = 0; i < s.count(); ++i) ASSERT_EQ(key_of(c.id[i]), key_of(s.id[i])) << i;
    EXPECT_TRUE(same_bits("position", s.position, c.position));
    EXPECT_TRUE(same_bits("covariance", s.covariance, c.covariance));
    EXPECT_TRUE(same_bits("opacity", s.opacity, c.opacity));
    EXPECT_TRUE(same_bits("scale", s.scale, c.scale));
    EXPECT_TRUE(same_bits("rotation", s.rotation, c.rotation));
    EXPECT_TRUE(same_bits("color", s.color, c.color));
  }
}

// Rotors and SH of each Gaussian by its id, as one query decodes them.
struct Decoded {
  GaussianArrays arrays;
  std::vector<l4d_gaussian_id> id;
};
Decoded decode_ids(const DecoderHandle& d, const l4d_query& query) {
  const l4d_selection selection = d.select(query);
  Decoded out;
  out.arrays.sh_degree = d.info().sh_degree;
  out.arrays.resize(static_cast<size_t>(selection.num_gaussians));
  out.id.resize(out.arrays.count());
  l4d_gaussian_buffers b = out.arrays.buffers();
  b.id = out.id.data();
  d.check(l4d_decoder_decode(d.get(), &query, &b));
  out.arrays.resize(static_cast<size_t>(b.count));
  out.id.resize(static_cast<size_t>(b.count));
  return out;
}

bool same_gaussian(const GaussianArrays& a, size_t i, const GaussianArrays& b, size_t k) {
  bool same = a.mean_t[i] == b.mean_t[k];
  for (size_t j = 0; j < 3; ++j) same = same && a.position[3 * i + j] == b.position[3 * k + j];
  for (size_t j = 0; j < 8; ++j) same = same && a.rotor[8 * i + j] == b.rotor[8 * k + j];
  const size_t sh = info_of(Attribute::kSh).numbers(a.sh_degree);
  return same && std::equal(&a.sh[sh * i], &a.sh[sh * i] + sh, &b.sh[sh * k]);
}

TEST_P(SplatForms, AGaussianHasOneIdInAllQueriesAndSlices) {
  const DecoderHandle d = open(GetParam().bytes());
  const Decoded all = decode_ids(d, all_query());
  ASSERT_EQ(all.id.size(), d.info().num_gaussians);
  std::map<Id, size_t> where;
  for (size_t i = 0; i < all.id.size(); ++i) where[key_of(all.id[i])] = i;
  EXPECT_EQ(where.size(), all.id.size()) << "two Gaussians have one id";
  // As the comment of l4d_gaussian_id says where they are in complete buckets.
  const GaussianArrays ranged = d.decode(all_query());
  for (const l4d_bucket_span& r : ranged.spans) {
    for (uint64_t k = 0; k < r.count; ++k) {
      ASSERT_EQ(key_of(all.id[static_cast<size_t>(r.first + k)]), (Id{r.layer, r.bucket, k}));
    }
  }
  std::vector<l4d_query> queries = {time_query(0.9), range_query(0.2, 0.5), time_query(1.7)};
  queries.push_back(queries[0]);
  queries.back().whole_buckets = 1;
  queries.push_back(all_query());
  queries.back().point.detail = L4D_DETAIL_BASE_COLOR;
  const GaussianArrays base = d.decode(queries.back());
  size_t partial = 0;
  for (const l4d_query& query : queries) {
    const Decoded part = decode_ids(d, query);
    const GaussianArrays& want = query.point.detail == L4D_DETAIL_FULL ? all.arrays : base;
    for (size_t i = 0; i < part.id.size(); ++i) {
      ASSERT_EQ(where.count(key_of(part.id[i])), 1u);
      ASSERT_TRUE(same_gaussian(part.arrays, i, want, where[key_of(part.id[i])])) << i;
    }
    partial += part.id.size() < all.id.size();
  }
  EXPECT_GE(partial, 3u);
  // At every instant. SH and covariance name the Gaussian, whatever it looks like now.
  const size_t sh = info_of(Attribute::kSh).numbers(all.arrays.sh_degree);
  std::map<Id, std::vector<float>> covariance;
  size_t again = 0;
  for (const double time : {0.0, 0.05, 0.4, 0.9, 1.7, 0.4}) {
    const SplatArrays s = forms(d, time);
    std::set<Id> seen;
    for (size_t i = 0; i < s.count(); ++i) {
      const Id key = key_of(s.id[i]);
      ASSERT_TRUE(seen.insert(key).second) << "twice";
      ASSERT_EQ(where.count(key), 1u);
      ASSERT_TRUE(std::equal(&s.sh[sh * i], &s.sh[sh * i] + sh, &all.arrays.sh[sh * where[key]]));
      const std::vector<float> c(&s.covariance[6 * i], &s.covariance[6 * i] + 6);
      const auto [it, is_new] = covariance.emplace(key, c);
      ASSERT_EQ(it->second, c);
      again += !is_new;
    }
  }
  EXPECT_GT(again, 100u);
}

INSTANTIATE_TEST_SUITE_P(Streams, SplatForms,
                         testing::Values(NamedFile{"indexed", dynamic_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file},
                                         NamedFile{"wandering", wandering_file},
                                         NamedFile{"shapes", shapes_file}),
                         file_name);

// A tolerant decoder that lost a page names the others as before.
TEST(SplatIds, StayWhereAPageIsLost) {
  for (const Bytes* file : {&dynamic_file(), &wandering_file()}) {
    const Anatomy anatomy(*file);
    const DecoderHandle whole = open(*file);
    const Decoded all = decode_ids(whole, all_query());
    std::map<Id, size_t> where;
    for (size_t i = 0; i < all.id.size(); ++i) where[key_of(all.id[i])] = i;
    size_t behind = 0;  // the lost page, in its bucket
    for (size_t p = 0; p < anatomy.pages.size(); p += 1 + anatomy.pages.size() / 6) {
      const Bytes damaged = damage(*file, anatomy.page_chunk(p));
      const DecoderHandle d = tolerant_decoder(damaged);
      const Decoded rest = decode_ids(d, all_query());
      ASSERT_EQ(rest.id.size(), all.id.size() - anatomy.pages[p].count);
      for (size_t i = 0; i < rest.id.size(); ++i) {
        const size_t k = where.at(key_of(rest.id[i]));
        ASSERT_TRUE(same_gaussian(rest.arrays, i, all.arrays, k));
      }
      for (const double time : {0.1, 0.9}) {
        const SplatArrays s = forms(d, time), want = forms(whole, time);
        std::map<Id, size_t> at;
        for (size_t i = 0; i < want.count(); ++i) at[key_of(want.id[i])] = i;
        const Anatomy::Page& page = anatomy.pages[p];
        for (size_t i = 0; i < s.count(); ++i) {
          ASSERT_EQ(at.count(key_of(s.id[i])), 1u);
          const size_t k = at[key_of(s.id[i])];
          for (size_t c = 0; c < 3; ++c) {
            ASSERT_EQ(s.position[3 * i + c], want.position[3 * k + c]);
            ASSERT_EQ(s.color[3 * i + c], want.color[3 * k + c]);
          }
          behind += s.id[i].layer == page.layer && s.id[i].bucket == page.bucket &&
                    s.id[i].index >= page.count;
        }
      }
    }
    EXPECT_GT(behind, 0u);
  }
}

// Neither do Gaussians that are left out because they are not finite.
TEST(SplatIds, StayWhereAGaussianIsNotFinite) {
  StreamEditor editor(lossless_file());
  const auto place = editor.find([](const LayerHeader& l) { return l.level == 0; });
  const PageStream stream = editor.stream(place, 0, "rotor_spatial.raw.0");
  std::vector<uint32_t> rotors(stream.n, order_float(0.5f));
  for (size_t i = 0; i < rotors.size(); i += 2) rotors[i] = order_float(3e38f);
  editor.replace_stream(place, 0, "rotor_spatial.raw.0", packed_stream(rotors, 32));
  editor.replace_stream(place, 0, "rotor_temporal.raw.3",
                        packed_stream(std::vector<uint32_t>(rotors), 32));
  const Bytes bytes = editor.build();
  const DecoderHandle d = open(bytes), sound = open(lossless_file());
  const size_t sh = info_of(Attribute::kSh).numbers(d.info().sh_degree);
  size_t odd = 0;
  for (const double time : {0.0, 0.5, 1.0, 1.5}) {
    const SplatArrays s = forms(d, time), want = forms(sound, time);
    std::map<Id, size_t> at;
    for (size_t i = 0; i < want.count(); ++i) at[key_of(want.id[i])] = i;
    for (size_t i = 0; i < s.count(); ++i) {
      if (s.id[i].layer != place.layer || at.count(key_of(s.id[i])) == 0) continue;
      EXPECT_TRUE(
          std::equal(&s.sh[sh * i], &s.sh[sh * i] + sh, &want.sh[sh * at[key_of(s.id[i])]]));
      odd += s.id[i].index % 2;
    }
    expect_axes(s);
  }
  EXPECT_GT(odd, 0u);
}

// Still Gaussians are not written again, but their colours are: the camera moves.
TEST(SplatColors, FollowTheCameraWhileRowsAreKept) {
  const DecoderHandle d = open(dynamic_file()), other = open(dynamic_file());
  const SplatArrays fresh = other.slice(0.9);
  const size_t n = fresh.count();
  std::vector<float> position(3 * n), color(3 * n);
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  b.capacity = n;
  b.position = position.data();
  b.color = color.data();
  for (const double x : {-5.0, 2.0, 40.0}) {
    b.camera_position[0] = x;
    const uint64_t key = b.still_key;
    if (key != 0) std::fill(position.begin(), position.end(), 7.0f);
    d.check(l4d_decoder_slice(d.get(), 0.9, &b));
    ASSERT_GT(b.num_still, 100u);
    const size_t first = 3 * static_cast<size_t>(b.num_still);
    if (key != 0) {
      EXPECT_EQ(b.still_key, key);
      EXPECT_EQ(static_cast<size_t>(std::count(position.begin(), position.end(), 7.0f)), first);
    }
    EXPECT_TRUE(std::equal(position.begin() + static_cast<std::ptrdiff_t>(first), position.end(),
                           fresh.position.begin() + static_cast<std::ptrdiff_t>(first)));
    SliceOptions options;
    options.color = true;
    options.camera_position[0] = x;
    EXPECT_TRUE(same_bits("color", other.slice(0.9, options).color, color));
    EXPECT_NE(color[0], color[1]);
  }
}

TEST(SplatForms, BucketsGetAxesOnce) {
  const DecoderHandle d = open(dynamic_file());
  d.slice(0.9);
  const uint64_t plain = counters_of(d).buckets_decoded;
  ASSERT_GT(plain, 0u);
  forms(d, 0.9);
  const uint64_t with_axes = counters_of(d).buckets_decoded;
  EXPECT_EQ(with_axes, 2 * plain);
  forms(d, 0.9);
  d.slice(0.9);
  EXPECT_EQ(counters_of(d).buckets_decoded, with_axes);
}

TEST(SplatForms, RefuseWhatMakesNoSense) {
  const DecoderHandle d = open(dynamic_file());
  std::vector<float> numbers(3 * static_cast<size_t>(d.info().num_gaussians));
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  b.capacity = d.info().num_gaussians;
  b.color = numbers.data();
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    b.camera_position[1] = bad;
    EXPECT_EQ(l4d_decoder_slice(d.get(), 0.9, &b), L4D_ERR_INVALID_ARGUMENT);
  }
  b.color = nullptr;  // then it does not matter
  EXPECT_EQ(l4d_decoder_slice(d.get(), 0.9, &b), L4D_OK);
  b.id = nullptr;
  b.scale = numbers.data();
  b.capacity = 3;
  EXPECT_EQ(l4d_decoder_slice(d.get(), 0.9, &b), L4D_ERR_BUFFER_TOO_SMALL);
  l4d_splat_columns c = L4D_INIT(l4d_splat_columns);
  c.scale[0] = numbers.data();
  EXPECT_EQ(slice_columns(d.get(), 0.9, &c), L4D_ERR_INVALID_ARGUMENT);
  c.scale[0] = nullptr;
  c.color[2] = numbers.data();
  EXPECT_EQ(slice_columns(d.get(), 0.9, &c), L4D_ERR_INVALID_ARGUMENT);
  c.color[0] = c.color[1] = c.color[2];
  c.camera_position[0] = std::nan("");
  EXPECT_EQ(slice_columns(d.get(), 0.9, &c), L4D_ERR_INVALID_ARGUMENT);
  c.camera_position[0] = 0;
  EXPECT_EQ(slice_columns(d.get(), 0.9, &c), L4D_OK);
}

}  // namespace
}  // namespace l4d
