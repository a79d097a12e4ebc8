// SPDX-License-Identifier: Apache-2.0
// SH chunks of pages: what comes without them, what is read, and what their loss costs.
#include "tests/common/sh_detail.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "l4d/experimental/inspect.h"
#include "libl4dcodec/quant/codebook.h"
#include "tests/common/codec.h"
#include "tests/decoder/damage.h"
#include "tests/decoder/packed.h"

namespace l4d {
namespace {

using namespace test;

constexpr uint32_t kBackends[] = {L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU};

TestScene scene() {
  SceneOptions o;
  o.count = 1500;
  o.sh_degree = 2;
  return make_scene(o);
}

// SH as a transform, without SH chunks.
const Bytes& plain_file() {
  static const Bytes kBytes = [] {
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 128}, {L4D_ENC_CODING, 1}};
    return encode(scene(), o).bytes;
  }();
  return kBytes;
}

// SH as codebooks, without SH chunks.
const Bytes& plain_codebook_file() {
  static const Bytes kBytes = [] {
    EncodeOptions o = small_options();
    o.rans = true;
    o.stages = {{L4D_ENC_STAGES ".sh", {1.0f, 0.5f}}};
    return encode(scene(), o).bytes;
  }();
  return kBytes;
}

const Bytes& split_file() {
  static const Bytes kBytes = with_sh_detail(plain_file(), 3);
  return kBytes;
}

unsigned coefficients(const Bytes& file) { return StreamEditor(file).header.sh.coefficients(); }

l4d_query base_query(l4d_query query = all_query()) {
  query.point.detail = L4D_DETAIL_BASE_COLOR;
  return query;
}

bool without_sh_same(GaussianArrays a, GaussianArrays b) {
  a.sh.clear();
  b.sh.clear();
  return same_bits(a, b);
}

// Takes coefficients from `base` on out of a page.
void zero_detail(unsigned base, PageColumns& columns) {
  ComponentColumns& sh = columns.component[L4D_COMPONENT_SH];
  for (size_t k = base; k < sh.coefficient.size(); ++k) {
    std::fill(sh.coefficient[k].begin(), sh.coefficient[k].end(), int16_t{0});
  }
}

// spec: DEC-7
TEST(ShDetail, BaseIsTheWholeWithLaterCoefficientsZero) {
  const unsigned most = coefficients(plain_file());
  ASSERT_GT(most, 12u);
  for (const unsigned base : {0u, 1u, 3u, 4u, 5u, 12u, most - 1}) {
    SCOPED_TRACE(base);
    const Bytes split = with_sh_detail(plain_file(), base);
    const Bytes zeroed = with_sh_detail(plain_file(), base,
                                        [&](PageColumns& columns) { zero_detail(base, columns); });
    for (const uint32_t backend : kBackends) {
      EXPECT_TRUE(same_bits(decode(plain_file(), all_query(), backend),
                            decode(split, all_query(), backend)));
      for (const uint32_t threads : {1u, 3u}) {
        EXPECT_TRUE(same_bits(decode(zeroed, all_query(), backend),
                              decode(split, base_query(), backend, threads)));
      }
    }
  }
}

TEST(ShDetail, AWholeBaseHasNoShChunk) {
  const Bytes file = with_sh_detail(plain_file(), coefficients(plain_file()));
  for (const PageRecord& r : page_records(file)) EXPECT_FALSE(r.has_sh_detail());
  EXPECT_TRUE(same_bits(decode(plain_file(), all_query()), decode(file, base_query())));
}

// spec: DEC-7
TEST(ShDetail, WithoutABaseShIsTheOriginOrNothing) {
  const Bytes transform = with_sh_detail(plain_file(), 0);
  const Bytes codebooks = with_sh_detail(plain_codebook_file(), 0);
  StreamDecoder decoder;
  decoder.kernels = &stream_kernels_reference();
  StreamEditor editor(transform);
  const uint32_t dim = editor.header.sh_dim();
  CodebookData basis;
  ASSERT_TRUE(
      decode_codebook(decoder, editor.sh_codebooks[0].raw, 0, editor.header.sh.basis, dim, &basis)
          .ok());
  for (const uint32_t backend : kBackends) {
    const GaussianArrays t = decode(transform, base_query(), backend);
    EXPECT_TRUE(without_sh_same(t, decode(plain_file(), all_query(), backend)));
    for (size_t i = 0; i < t.sh.size(); ++i) ASSERT_EQ(t.sh[i], basis.entries[i % dim]);
    const GaussianArrays c = decode(codebooks, base_query(), backend);
    const GaussianArrays whole = decode(codebooks, all_query(), backend);
    EXPECT_TRUE(same_bits(whole, decode(plain_codebook_file(), all_query(), backend)));
    EXPECT_TRUE(without_sh_same(c, whole));
    EXPECT_TRUE(std::all_of(c.sh.begin(), c.sh.end(), [](float v) { return v == 0; }));
  }
  DecoderHandle d;
  d.open_memory(codebooks.data(), codebooks.size());
  const PackedArrays all = decode_packed(d, all_query());
  const PackedArrays base = decode_packed(d, base_query());
  EXPECT_EQ(all.position, base.position);
  EXPECT_EQ(all.index[L4D_COMPONENT_SCALE], base.index[L4D_COMPONENT_SCALE]);
  const auto& depth = base.depth[L4D_COMPONENT_SH];
  EXPECT_TRUE(std::all_of(depth.begin(), depth.end(), [](uint8_t v) { return v == 0; }));
  EXPECT_EQ(base.num_escapes[L4D_COMPONENT_SH], 0u);
  EXPECT_NE(all.depth[L4D_COMPONENT_SH], depth);
}

// Ranges of a file, and a reader that counts how much of them is requested, or fails there.
struct WatchedReader {
  const Bytes& file;
  std::vector<std::pair<uint64_t, uint64_t>> ranges;  // begin, end
  uint64_t touched = 0;
  uint64_t reads = 0;
  bool fails = false;

  explicit WatchedReader(const Bytes& bytes) : file(bytes) {
    for (const PageRecord& r : page_records(file)) {
      if (!r.has_sh_detail()) continue;
      ranges.emplace_back(r.sh_detail.offset, r.sh_detail.offset + r.sh_detail.stored_bytes);
    }
  }
  l4d_reader reader() {
    l4d_reader r = L4D_INIT(l4d_reader);
    r.user = this;
    r.size = [](void* user) {
      return static_cast<int64_t>(static_cast<WatchedReader*>(user)->file.size());
    };
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      auto& self = *static_cast<WatchedReader*>(user);
      ++self.reads;
      uint64_t overlap = 0;
      for (const auto& [begin, end] : self.ranges) {
        const uint64_t first = std::max(begin, offset), last = std::min(end, offset + n);
        if (first < last) overlap += last - first;
      }
      self.touched += overlap;
      if (overlap > 0 && self.fails) return -1;
      std::copy_n(self.file.data() + offset, n, static_cast<unsigned char*>(dst));
      return static_cast<int64_t>(n);
    };
    return r;
  }
  uint64_t total() const {
    uint64_t sum = 0;
    for (const auto& [begin, end] : ranges) sum += end - begin;
    return sum;
  }
};

// spec: DEC-3
TEST(ShDetail, BaseReadsNoByteOfAShChunk) {
  WatchedReader watched(split_file());
  ASSERT_GT(watched.ranges.size(), 5u);
  const l4d_reader reader = watched.reader();
  DecoderHandle d;
  d.open(reader);
  (void)d.decode(base_query());
  (void)d.decode(base_query(time_query(0.7)));
  (void)d.slice(0.7, {{0, 0, L4D_DETAIL_BASE_COLOR, 0}});
  // Nor does a decode of other attributes.
  const l4d_query all = all_query();
  const l4d_selection s = d.select(all);
  std::vector<float> position(3 * s.num_gaussians);
  l4d_gaussian_buffers buffers = L4D_INIT(l4d_gaussian_buffers);
  buffers.capacity = s.num_gaussians;
  buffers.position = position.data();
  d.check(l4d_decoder_decode(d.get(), &all, &buffers));
  uint64_t sections[L4D_SECTION_COUNT];
  d.check(l4d_decoder_get_sections(d.get(), sections, L4D_SECTION_COUNT, nullptr, nullptr, 0));
  EXPECT_EQ(watched.touched, 0u);
  EXPECT_GT(sections[L4D_SECTION_SH], watched.total());
  (void)d.decode(all);
  EXPECT_EQ(watched.touched, watched.total());
}

TEST(ShDetail, SelectionsTellWhatEachDetailCosts) {
  WatchedReader watched(split_file());
  const l4d_reader reader = watched.reader();
  for (const double t : {0.1, 1.0, 1.9}) {
    DecoderHandle d;
    d.open(reader);
    const l4d_selection full = d.select(time_query(t));
    const l4d_selection base = d.select(base_query(time_query(t)));
    EXPECT_EQ(full.num_gaussians, base.num_gaussians);
    EXPECT_EQ(full.sh_bytes, base.sh_bytes);
    EXPECT_EQ(full.bytes, base.bytes + base.sh_bytes);
    EXPECT_GT(full.sh_bytes, 0u);
    const auto bytes_read = [&](const l4d_query& query) {
      const uint64_t before = counters_of(d).bytes_read;
      (void)d.decode(query);
      return counters_of(d).bytes_read - before;
    };
    (void)d.decode(time_query(t));  // codebooks
    EXPECT_EQ(bytes_read(base_query(time_query(t))), base.bytes);
    EXPECT_GE(bytes_read(time_query(t)), full.bytes);
  }
}

TEST(ShDetail, ToolsTellOfABase) {
  const auto tools = [](const Bytes& file) {
    DecoderHandle d;
    d.open_memory(file.data(), file.size());
    return d.info().tools & L4D_TOOL_SH_BASE;
  };
  EXPECT_NE(tools(split_file()), 0u);
  EXPECT_EQ(tools(with_sh_detail(plain_file(), 0)), 0u);
  EXPECT_EQ(tools(with_sh_detail(plain_codebook_file(), 0)), 0u);
}

TEST(ShDetail, UnknownDetailsAreRefused) {
  DecoderHandle d;
  d.open_memory(split_file().data(), split_file().size());
  l4d_query query = all_query();
  query.point.detail = 2;
  l4d_selection s = L4D_INIT(l4d_selection);
  EXPECT_EQ(l4d_decoder_select(d.get(), &query, &s), L4D_ERR_INVALID_ARGUMENT);
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  b.point.detail = 2;
  EXPECT_EQ(l4d_decoder_slice(d.get(), 0, &b), L4D_ERR_INVALID_ARGUMENT);
  b.point.detail = L4D_DETAIL_BASE_COLOR;
  EXPECT_EQ(l4d_decoder_slice(d.get(), 0, &b), L4D_OK);
}

TEST(ShDetail, TheBucketCacheKeepsDetailsApart) {
  const auto fresh = [](uint32_t detail, double t) {
    DecoderHandle d;
    d.open_memory(split_file().data(), split_file().size());
    return d.slice(t, {{0, 0, detail, 0}});
  };
  DecoderHandle d;
  d.open_memory(split_file().data(), split_file().size());
  for (const double t : {0.5, 0.6, 1.4}) {
    const SplatArrays full = fresh(L4D_DETAIL_FULL, t), base = fresh(L4D_DETAIL_BASE_COLOR, t);
    EXPECT_EQ(full.position, base.position);
    EXPECT_NE(full.sh, base.sh);
    for (const uint32_t detail : {L4D_DETAIL_FULL, L4D_DETAIL_BASE_COLOR, L4D_DETAIL_FULL}) {
      EXPECT_TRUE(
          same_bits(d.slice(t, {{0, 0, detail, 0}}), detail == L4D_DETAIL_FULL ? full : base));
    }
  }
  // Both are at hand now.
  const uint64_t decoded = counters_of(d).buckets_decoded;
  for (const uint32_t detail : {L4D_DETAIL_BASE_COLOR, L4D_DETAIL_FULL}) {
    (void)d.slice(0.5, {{0, 0, detail, 0}});
  }
  EXPECT_EQ(counters_of(d).buckets_decoded, decoded);
}

// One page's SH chunk damaged.
struct Damaged {
  Bytes bytes = split_file();
  std::vector<PageRecord> pages = page_records(bytes);
  size_t page = 0;
  uint64_t first = 0;  // Gaussian

  explicit Damaged(size_t which) {
    for (page = 0; page < which; ++page) first += pages[page].num_gaussians;
    const ChunkRef& c = pages[page].sh_detail;
    bytes[static_cast<size_t>(c.offset + c.stored_bytes / 2)] ^= 0x40;
  }
  // The whole, but for the SH of that page.
  GaussianArrays rest() const {
    GaussianArrays a = decode(split_file(), all_query());
    const GaussianArrays base = decode(split_file(), base_query());
    const size_t dim = 3 * (a.sh_degree + 1) * (a.sh_degree + 1);
    std::copy_n(base.sh.begin() + static_cast<std::ptrdiff_t>(dim * first),
                dim * pages[page].num_gaussians,
                a.sh.begin() + static_cast<std::ptrdiff_t>(dim * first));
    return a;
  }
};

// spec: CHNK-2, DEC-3, DEC-4
TEST(ShDetail, DamageIsRefusedWhereItIsWanted) {
  const Damaged damaged(2);
  EXPECT_EQ(strict_failure(damaged.bytes, "CHNK-2"), L4D_ERR_CHECKSUM);
  EXPECT_TRUE(same_bits(decode(damaged.bytes, base_query()), decode(split_file(), base_query())));
  const std::vector<Violation> found = validate(damaged.bytes);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].clause, "CHNK-2");
  EXPECT_EQ(found[0].offset, damaged.pages[2].sh_detail.offset);
  EXPECT_TRUE(validate(split_file()).empty());
}

Bytes tolerant_copy(const Bytes& stream) {
  Bytes out;
  EXPECT_EQ(copy_rest(stream, &out), L4D_OK) << l4d_last_error_message();
  return out;
}

// Every `step`th page without its SH chunk.
Bytes without_detail(const Bytes& whole, size_t step) {
  Bytes hurt = whole;
  const std::vector<PageRecord> pages = page_records(whole);
  EXPECT_GT(pages.size(), 2 * step);
  for (size_t page = 0; page < pages.size(); page += step) {
    hurt[static_cast<size_t>(pages[page].sh_detail.offset) + 5] ^= 0x40;
  }
  return hurt;
}

double squared_difference(const std::vector<float>& a, const std::vector<float>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += std::pow(double{a[i]} - double{b[i]}, 2);
  return sum;
}

// spec: DEC-7
TEST(ShDetail, ATolerantCopyHasTheBaseForWhatIsLost) {
  for (const unsigned base : {1u, 3u, coefficients(plain_file()) - 1}) {
    // A Gaussian in three has no detail, so that tables have a code for that.
    const Bytes whole = with_sh_detail(plain_file(), base, [base](PageColumns& columns) {
      ComponentColumns& sh = columns.component[L4D_COMPONENT_SH];
      for (size_t k = base; k < sh.coefficient.size(); ++k) {
        for (size_t i = 0; i < sh.coefficient[k].size(); i += 3) sh.coefficient[k][i] = 0;
      }
    });
    for (const size_t step : {size_t{1}, size_t{3}}) {
      const Bytes hurt = without_detail(whole, step);
      const Bytes copy = tolerant_copy(hurt);
      EXPECT_TRUE(validate(copy).empty());
      GaussianArrays shown = decode_rest(tolerant_decoder(hurt), all_query());
      GaussianArrays copied = decode(copy, all_query());
      const GaussianArrays before = decode(whole, all_query());
      ASSERT_EQ(copied.count(), shown.count());
      const double lost = squared_difference(before.sh, shown.sh);
      EXPECT_LE(squared_difference(copied.sh, shown.sh), 0.01 * lost) << base;
      copied.sh = shown.sh;
      EXPECT_TRUE(same_bits(copied, shown));
    }
  }
}

// Where tables have a code for 0, it is the base to the bit.
TEST(ShDetail, ATolerantCopyOfZerosHasTheBaseToTheBit) {
  const Bytes whole = with_sh_detail(plain_file(), 3, [](PageColumns& columns) {
    ComponentColumns& sh = columns.component[L4D_COMPONENT_SH];
    for (size_t k = 3; k < sh.coefficient.size(); ++k) {
      std::fill(sh.coefficient[k].begin(), sh.coefficient[k].end(), int16_t{0});
    }
  });
  const Bytes hurt = without_detail(whole, 1), copy = tolerant_copy(hurt);
  const GaussianArrays copied = decode(copy, all_query());
  EXPECT_TRUE(same_bits(copied, decode_rest(tolerant_decoder(hurt), all_query())));
  // The chunks are those that were lost.
  EXPECT_EQ(copy, tolerant_copy(whole));
}

// Without a base the SH chunk has more than coefficients: its page is left out.
TEST(ShDetail, ATolerantCopyLeavesOutPagesThatLackAllOfSh) {
  for (const Bytes& file : {plain_file(), plain_codebook_file()}) {
    const Bytes whole = with_sh_detail(file, 0);
    const Bytes copy = tolerant_copy(without_detail(whole, 2));
    EXPECT_TRUE(validate(copy).empty());
    EXPECT_EQ(page_records(copy).size(), page_records(whole).size() / 2);
  }
}

// spec: DEC-4
TEST(ShDetail, ATolerantDecoderGivesTheBaseForWhatIsLost) {
  const size_t count = page_records(split_file()).size();
  for (size_t page = 0; page < count; page += 1 + count / 7) {
    const Damaged damaged(page);
    const PageRecord& record = damaged.pages[page];
    const DecoderHandle d = tolerant_decoder(damaged.bytes);
    EXPECT_TRUE(same_bits(decode_rest(d, all_query()), damaged.rest()));
    const std::vector<l4d_loss> losses = losses_of(d);
    ASSERT_EQ(losses.size(), 1u);
    EXPECT_EQ(losses[0].detail_only, 1u);
    EXPECT_EQ(losses[0].status, L4D_ERR_CHECKSUM);
    EXPECT_STREQ(losses[0].clause, "CHNK-2");
    EXPECT_EQ(losses[0].offset, record.sh_detail.offset);
    EXPECT_EQ(losses[0].bucket, record.bucket);
    EXPECT_EQ(losses[0].num_gaussians, record.num_gaussians);
    const l4d_counters c = counters_of(d);
    EXPECT_EQ(c.details_lost, 1u);
    EXPECT_EQ(c.pages_lost, 0u);
    EXPECT_EQ(c.gaussians_lost, 0u);
    (void)decode_rest(d, base_query());
    EXPECT_TRUE(losses_of(d).empty());
  }
}

// Beside a page that is lost altogether.
TEST(ShDetail, LossesOfBothChunksAreToldApart) {
  Damaged damaged(1);
  const ChunkRef& first = damaged.pages[4].chunk;
  damaged.bytes[static_cast<size_t>(first.offset + first.stored_bytes / 2)] ^= 1;
  const DecoderHandle d = tolerant_decoder(damaged.bytes);
  const GaussianArrays want = without(damaged.rest(), Anatomy(split_file()), {4});
  EXPECT_TRUE(same_bits(decode_rest(d, all_query()), want));
  uint64_t details = 0, pages = 0;
  for (const l4d_loss& loss : losses_of(d)) {
    (loss.detail_only != 0 ? details : pages) += loss.num_pages;
  }
  EXPECT_EQ(details, 1u);
  EXPECT_EQ(pages, 1u);
}

TEST(ShDetail, ASliceIsMendedWhenDetailCanBeReadAgain) {
  WatchedReader watched(split_file());
  const l4d_reader reader = watched.reader();
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.tolerant = 1;
  DecoderHandle d(&o), whole;
  d.open(reader);
  whole.open_memory(split_file().data(), split_file().size());
  const SplatArrays full = whole.slice(0.8);
  const SplatArrays base = whole.slice(0.8, {{0, 0, L4D_DETAIL_BASE_COLOR, 0}});
  watched.fails = true;
  for (int again = 0; again < 2; ++again) {
    EXPECT_TRUE(same_bits(d.slice(0.8), base));
    const std::vector<l4d_loss> losses = losses_of(d);
    ASSERT_FALSE(losses.empty());
    for (const l4d_loss& loss : losses) {
      EXPECT_EQ(loss.status, L4D_ERR_IO);
      EXPECT_EQ(loss.detail_only, 1u);
    }
  }
  watched.fails = false;
  EXPECT_TRUE(same_bits(d.slice(0.8), full));
  EXPECT_TRUE(losses_of(d).empty());
}

// spec: CHNK-4
TEST(ShDetail, ShChunksThatShareBytesAreRefused) {
  StreamEditor editor(split_file());
  EditedDirectoryPage& d = editor.at({0, 0});
  ASSERT_TRUE(d.present);
  ASSERT_GT(d.pages.size(), 1u);
  (void)editor.build();
  d.details[1].offset = d.page.pages[0].sh_detail.offset;  // both records name one place
  const Bytes bytes = editor.build();
  bool overlaps = false;
  for (const Violation& v : validate(bytes)) overlaps = overlaps || v.clause == "CHNK-4";
  EXPECT_TRUE(overlaps);
  EXPECT_EQ(strict_failure(bytes, "CHNK-4"), L4D_ERR_CORRUPT);
}

}  // namespace
}  // namespace l4d
