// SPDX-License-Identifier: Apache-2.0
// l4d_decoder_get_reads: a reader that answers its ranges and no other byte lets the query succeed.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/common/codec.h"
#include "tests/common/sh_detail.h"
#include "tests/common/stream_editor.h"
#include "tests/decoder/damage.h"
#include "tests/decoder/packed.h"
#include "tests/decoder/recording_reader.h"

namespace l4d {
namespace {

using namespace test;

using Ranges = std::vector<l4d_byte_range>;

// A client that holds some bytes of a file: its reader fails on all others.
class Client {
 public:
  explicit Client(const Bytes& file) : recorder_(file), held_(file.size(), false) {}

  void fetch(const Ranges& ranges) {
    for (const l4d_byte_range& r : ranges) {
      ASSERT_LE(r.offset + r.size, held_.size());
      std::fill_n(held_.begin() + static_cast<std::ptrdiff_t>(r.offset), r.size, true);
    }
  }
  void fetch_headers() {
    l4d_byte_range header{};
    ASSERT_EQ(l4d_get_header_range(recorder_.bytes.data(), L4D_FILE_HEADER_BYTES, &header), L4D_OK);
    fetch({{0, L4D_FILE_HEADER_BYTES}, header});
  }
  l4d_reader reader() {
    l4d_reader r = recorder_.reader();
    r.user = this;
    r.size = [](void* user) {
      return static_cast<int64_t>(static_cast<Client*>(user)->held_.size());
    };
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      auto& self = *static_cast<Client*>(user);
      const auto begin = self.held_.begin() + static_cast<std::ptrdiff_t>(offset);
      if (!std::all_of(begin, begin + static_cast<std::ptrdiff_t>(n), [](bool b) { return b; })) {
        return -1;
      }
      self.recorder_.reads.push_back({offset, n});
      std::copy_n(self.recorder_.bytes.begin() + static_cast<std::ptrdiff_t>(offset), n,
                  static_cast<unsigned char*>(dst));
      return static_cast<int64_t>(n);
    };
    return r;
  }
  // Bytes that were read, as ranges.
  Ranges read() const {
    std::vector<bool> bytes(held_.size());
    for (const RecordingReader::Read& r : recorder_.reads) {
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(r.offset), r.n, true);
    }
    Ranges ranges;
    for (size_t i = 0; i < bytes.size(); ++i) {
      if (!bytes[i]) continue;
      if (ranges.empty() || ranges.back().offset + ranges.back().size != i)
        ranges.push_back({i, 0});
      ++ranges.back().size;
    }
    return ranges;
  }
  size_t num_reads() const { return recorder_.reads.size(); }
  void forget_reads() { recorder_.reads.clear(); }

 private:
  RecordingReader recorder_;
  std::vector<bool> held_;
};

// Fetches what one step after the other asks for, reading nothing else; returns the last ranges.
Ranges fetch_query(Client& client, const DecoderHandle& d, const l4d_query& query) {
  client.forget_reads();
  Ranges ranges = d.reads(query, L4D_READS_PAGE_TABLES);
  EXPECT_EQ(client.num_reads(), 0u);
  uint64_t before = 0;
  for (const uint32_t step : {L4D_READS_DIRECTORY, L4D_READS_ALL}) {
    client.fetch(ranges);
    ranges = d.reads(query, step);
    uint64_t bytes = 0;
    for (const l4d_byte_range& r : ranges) bytes += r.size;
    EXPECT_GE(bytes, before);
    before = bytes;
  }
  client.fetch(ranges);
  return ranges;
}

void expect_in_order(const Ranges& ranges, uint64_t file_bytes) {
  uint64_t end = 0;
  for (size_t i = 0; i < ranges.size(); ++i) {
    EXPECT_GT(ranges[i].size, 0u);
    EXPECT_TRUE(i == 0 || ranges[i].offset > end);
    end = ranges[i].offset + ranges[i].size;
  }
  EXPECT_LE(end, file_bytes);
}

bool same(const Ranges& a, const Ranges& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const l4d_byte_range& x, const l4d_byte_range& y) {
                      return x.offset == y.offset && x.size == y.size;
                    });
}

// Pages that keep SH detail apart: of transforms, and of codebooks with blocks.
const Bytes& detailed_file() {
  static const Bytes kFile = with_sh_detail(transform_file(), 0);
  return kFile;
}
const Bytes& detailed_codebook_file() {
  static const Bytes kFile = [] {
    SceneOptions scene;
    scene.sh_degree = 2;
    EncodeOptions options = small_options();
    options.rans = true;
    return with_sh_detail(encode(make_scene(scene), options).bytes, 0);
  }();
  return kFile;
}

std::vector<l4d_bucket> some_buckets(const Bytes& file) {
  const SceneHeader header = StreamEditor(file).header;
  std::vector<l4d_bucket> buckets;
  for (uint32_t l = 0; l < header.layers.size(); ++l) {
    for (uint32_t b = 0; b < num_buckets(header.layers[l].level); b += 3) buckets.push_back({l, b});
  }
  return buckets;
}

struct NamedQuery {
  std::string name;
  l4d_query query;
};

std::vector<NamedQuery> all_kinds(const std::vector<l4d_bucket>& buckets) {
  std::vector<NamedQuery> kinds = {{"whole", all_query()},
                                   {"time", time_query(0.7)},
                                   {"range", range_query(0.2, 0.4)},
                                   {"level", all_query()},
                                   {"buckets", all_query()}};
  kinds[3].query.max_level = 2;
  kinds[4].query.kind = L4D_QUERY_BUCKETS;
  kinds[4].query.buckets = buckets.data();
  kinds[4].query.num_buckets = buckets.size();
  const size_t count = kinds.size();
  for (size_t i = 0; i < count; ++i) {
    NamedQuery base = kinds[i];
    base.name += ", base colour";
    base.query.detail = L4D_DETAIL_BASE_COLOR;
    kinds.push_back(base);
  }
  return kinds;
}

class QueryReads : public testing::TestWithParam<NamedFile> {};

TEST_P(QueryReads, AreAllThatDecodingReads) {
  const Bytes& file = GetParam().bytes();
  const std::vector<l4d_bucket> buckets = some_buckets(file);
  for (const uint32_t backend : {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU}) {
    for (const NamedQuery& kind : all_kinds(buckets)) {
      SCOPED_TRACE(kind.name);
      Client client(file);
      client.fetch_headers();
      const l4d_decoder_options options = decoder_options(backend, 2);
      DecoderHandle d(&options);
      d.open(client.reader());
      const Ranges ranges = fetch_query(client, d, kind.query);
      expect_in_order(ranges, file.size());
      // What was found so far does not count: a fresh decoder.
      DecoderHandle fresh(&options);
      fresh.open(client.reader());
      client.forget_reads();
      EXPECT_TRUE(same_bits(fresh.decode(kind.query), decode(file, kind.query)));
      // No range is asked for in vain.
      EXPECT_TRUE(same(client.read(), ranges));
      // Nor do they depend on what the decoder holds.
      EXPECT_TRUE(same(fresh.reads(kind.query), ranges));
    }
  }
}

class PackedReads : public testing::TestWithParam<NamedFile> {};

TEST_P(PackedReads, AreAmongThoseOfTheQuery) {
  const Bytes& file = GetParam().bytes();
  DecoderHandle whole;
  whole.open_memory(file.data(), file.size());
  const std::vector<l4d_bucket> buckets = some_buckets(file);
  for (const NamedQuery& kind : all_kinds(buckets)) {
    SCOPED_TRACE(kind.name);
    Client client(file);
    client.fetch_headers();
    DecoderHandle d;
    d.open(client.reader());
    fetch_query(client, d, kind.query);
    const PackedArrays got = decode_packed(d, kind.query);
    const PackedArrays want = decode_packed(whole, kind.query);
    EXPECT_EQ(got.position, want.position);
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      EXPECT_EQ(got.index[c], want.index[c]);
      EXPECT_EQ(got.escape[c], want.escape[c]);
    }
  }
}

TEST_P(QueryReads, AreAllThatSlicesRead) {
  const Bytes& file = GetParam().bytes();
  for (const uint32_t detail : {L4D_DETAIL_FULL, L4D_DETAIL_BASE_COLOR}) {
    Client client(file);
    client.fetch_headers();
    DecoderHandle d, whole;
    d.open(client.reader());
    whole.open_memory(file.data(), file.size());
    d.check(l4d_decoder_set_detail(d.get(), detail));
    d.check(l4d_decoder_set_detail(whole.get(), detail));
    for (const double time : {-1.0, 0.0, 0.3, 0.9, 100.0}) {
      SCOPED_TRACE(time);
      l4d_query query = time_query(time);
      query.detail = detail;
      query.whole_buckets = 1;
      fetch_query(client, d, query);
      EXPECT_TRUE(same_bits(d.slice(time), whole.slice(time)));
    }
  }
}

// Base colours take fewer bytes where a stream keeps detail apart.
TEST(Reads, LeaveOutDetailThatIsNotWanted) {
  DecoderHandle d;
  d.open_memory(detailed_file().data(), detailed_file().size());
  l4d_query query = all_query();
  const auto bytes = [&] {
    uint64_t sum = 0;
    for (const l4d_byte_range& r : d.reads(query)) sum += r.size;
    return sum;
  };
  const uint64_t full = bytes();
  query.detail = L4D_DETAIL_BASE_COLOR;
  const l4d_selection selection = d.select(query);
  ASSERT_GT(selection.sh_bytes, 0u);
  EXPECT_LE(bytes() + selection.sh_bytes, full);
}

TEST(Reads, CountAndFirstRanges) {
  DecoderHandle d;
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  const l4d_query query = time_query(0.5);
  const Ranges all = d.reads(query);
  ASSERT_GT(all.size(), 1u);
  l4d_byte_range one{};
  uint64_t count = 0;
  d.check(l4d_decoder_get_reads(d.get(), &query, L4D_READS_ALL, &one, 1, &count));
  EXPECT_EQ(count, all.size());
  EXPECT_EQ(one.offset, all[0].offset);
  EXPECT_EQ(l4d_decoder_get_reads(d.get(), &query, 3, &one, 1, &count), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_decoder_get_reads(d.get(), &query, L4D_READS_ALL, nullptr, 1, &count),
            L4D_ERR_INVALID_ARGUMENT);
}

// Ranges stay inside the file, whatever the directory says.
TEST(Reads, OfATruncatedFileAreInsideIt) {
  const Anatomy anatomy(tiny_file());
  const size_t size = static_cast<size_t>(anatomy.payload_begin()) + 1;
  const Bytes file(tiny_file().begin(), tiny_file().begin() + static_cast<std::ptrdiff_t>(size));
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  options.tolerant = 1;
  DecoderHandle tolerant(&options);
  tolerant.open_memory(file.data(), file.size());
  for (uint32_t step = 0; step <= L4D_READS_ALL; ++step) {
    expect_in_order(tolerant.reads(all_query(), step), file.size());
  }
}

TEST(Reads, HeaderRange) {
  l4d_byte_range range{};
  const Bytes& file = tiny_file();
  EXPECT_EQ(l4d_get_header_range(file.data(), 39, &range), L4D_ERR_TRUNCATED);
  EXPECT_EQ(l4d_get_header_range(nullptr, 0, &range), L4D_ERR_NOT_L4D);
  EXPECT_EQ(l4d_get_header_range(nullptr, 1, &range), L4D_ERR_INVALID_ARGUMENT);
  ASSERT_EQ(l4d_get_header_range(file.data(), file.size(), &range), L4D_OK);
  EXPECT_GE(range.offset, uint64_t{L4D_FILE_HEADER_BYTES});
  EXPECT_LE(range.offset + range.size, file.size());
  Bytes damaged = file;
  damaged[12] ^= 1;
  EXPECT_EQ(l4d_get_header_range(damaged.data(), damaged.size(), &range), L4D_ERR_CHECKSUM);
}

INSTANTIATE_TEST_SUITE_P(
    Streams, QueryReads,
    testing::Values(NamedFile{"dynamic", dynamic_file}, NamedFile{"staged", staged_file},
                    NamedFile{"rcq", rcq_file}, NamedFile{"transform", transform_file},
                    NamedFile{"detailed", detailed_file},
                    NamedFile{"detailed_codebook", detailed_codebook_file},
                    NamedFile{"lossless", lossless_file}, NamedFile{"wandering", wandering_file}),
    file_name);
INSTANTIATE_TEST_SUITE_P(Streams, PackedReads,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"staged", staged_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"detailed_codebook", detailed_codebook_file},
                                         NamedFile{"wandering", wandering_file}),
                         file_name);

}  // namespace
}  // namespace l4d
