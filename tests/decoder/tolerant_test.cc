// SPDX-License-Identifier: Apache-2.0
// A tolerant decoder hands out exactly what is left of a damaged stream, and says what is missing.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <set>

#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/common/stream_editor.h"
#include "tests/decoder/damage.h"
#include "tests/decoder/packed.h"
#include "tests/decoder/rows.h"

namespace l4d {
namespace {

using namespace test;

// SH as binary16 of what is left, beside all else: of fewer arrays less is lost. `all`: what there
// was.
std::vector<uint16_t> half_sh_of(const DecoderHandle& d, GaussianArrays all) {
  std::vector<uint16_t> half(all.sh.size());
  l4d_gaussian_buffers b = all.buffers();
  b.sh_half = half.data();
  const l4d_query q = all_query();
  d.check(l4d_decoder_decode(d.get(), &q, &b));
  half.resize(half.size() / all.count() * static_cast<size_t>(b.count));
  return half;
}

class Tolerant : public testing::TestWithParam<NamedFile> {};

// Each chunk of the file in turn: the rest is the whole less the pages that need it.
TEST_P(Tolerant, DecodesWhatIsLeft) {
  const Bytes& whole = GetParam().bytes();
  const GaussianArrays all = decode(whole, all_query());
  const Anatomy anatomy(whole);
  ASSERT_EQ(anatomy.pages.back().first + anatomy.pages.back().count, all.count());
  for (const Chunk& chunk : anatomy.some_chunks(whole.size() > 200000 ? 6 : 100)) {
    SCOPED_TRACE(chunk.name);
    const Bytes damaged = damage(whole, chunk);
    EXPECT_EQ(strict_failure(damaged, "CHNK-2"), L4D_ERR_CHECKSUM);
    const DecoderHandle d = tolerant_decoder(damaged);
    if (chunk.needed_by_all) {
      EXPECT_THROW(decode_rest(d, all_query()), Error);
      continue;
    }
    const std::vector<size_t> lost = anatomy.lost_with(chunk);
    const GaussianArrays rest = decode_rest(d, all_query());
    ASSERT_TRUE(same_bits(without(all, anatomy, lost), rest));
    const std::vector<l4d_loss> losses = losses_of(d);
    ASSERT_EQ(losses.size(), lost.empty() ? 0u : 1u);
    if (lost.empty()) continue;
    const l4d_loss& loss = losses[0];
    EXPECT_EQ(loss.status, L4D_ERR_CHECKSUM);
    EXPECT_STREQ(loss.clause, "CHNK-2");
    EXPECT_EQ(loss.offset, chunk.ref.offset);
    EXPECT_EQ(loss.layer, chunk.layer);
    const Anatomy::Page& first = anatomy.pages[lost.front()];
    const Anatomy::Page& last = anatomy.pages[lost.back()];
    EXPECT_LE(loss.bucket, first.bucket);
    EXPECT_GT(loss.bucket + loss.num_buckets, last.bucket);
    const l4d_counters c = counters_of(d);
    if (chunk.kind == Chunk::kDirectory) {
      EXPECT_EQ(loss.num_pages, 0u);
      EXPECT_EQ(c.pages_lost, 0u);
    } else {
      EXPECT_EQ(loss.num_pages, lost.size());
      EXPECT_EQ(loss.num_gaussians, anatomy.gaussians(lost));
      EXPECT_EQ(loss.num_buckets, last.bucket - first.bucket + 1);
      EXPECT_EQ(c.pages_lost, lost.size());
      EXPECT_EQ(c.gaussians_lost, anatomy.gaussians(lost));
      std::set<std::pair<uint32_t, uint32_t>> buckets;
      for (const size_t p : lost) buckets.emplace(anatomy.pages[p].layer, anatomy.pages[p].bucket);
      EXPECT_EQ(c.buckets_lost, buckets.size());
    }
    EXPECT_GE(c.buckets_lost, 1u);
    ASSERT_EQ(half_sh_of(d, all), halves_of(rest.sh));
  }
}

// A stream that was made without the pages shows at every instant what the damaged one shows.
TEST_P(Tolerant, SlicesWhatIsLeft) {
  const Bytes& whole = GetParam().bytes();
  const Anatomy anatomy(whole);
  size_t with_loss = 0;
  for (size_t p = 0; p < anatomy.pages.size(); p += 1 + anatomy.pages.size() / 8) {
    const Chunk chunk = anatomy.page_chunk(p);
    SCOPED_TRACE(chunk.name);
    const Bytes damaged = damage(whole, chunk);
    const Bytes other = anatomy.rebuilt_without(p);
    const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
    DecoderHandle want(&o);
    want.open_memory(other.data(), other.size());
    const DecoderHandle got = tolerant_decoder(damaged);
    const DecoderHandle strict(&o);
    l4d_decoder* const refuses = strict.get();
    ASSERT_EQ(l4d_decoder_open_memory(refuses, damaged.data(), damaged.size()), L4D_OK);
    for (const double t : {0.0, 0.4, 0.7, 1.0, 1.9}) {
      ASSERT_TRUE(same_bits(want.slice(t), got.slice(t))) << "time " << t;
      l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
      const bool lost = !losses_of(got).empty();
      with_loss += lost;
      EXPECT_EQ(l4d_decoder_slice(refuses, t, &b), lost ? L4D_ERR_CHECKSUM : L4D_OK);
      ASSERT_TRUE(same_bits(decode_rest(want, time_query(t)), decode_rest(got, time_query(t))));
    }
  }
  EXPECT_GT(with_loss, 3u);
}

TEST_P(Tolerant, AnUndamagedFileLosesNothing) {
  const Bytes& whole = GetParam().bytes();
  const DecoderHandle d = tolerant_decoder(whole);
  EXPECT_TRUE(same_bits(decode(whole, all_query()), decode_rest(d, all_query())));
  EXPECT_TRUE(losses_of(d).empty());
  const l4d_counters c = counters_of(d);
  EXPECT_EQ(c.pages_lost + c.buckets_lost + c.gaussians_lost, 0u);
}

// Whatever happens to a file, what comes out is part of what was in it.
TEST_P(Tolerant, RandomDamageAddsNothing) {
  const Bytes& whole = GetParam().bytes();
  const Rows all = rows(decode(whole, all_query()));
  Random random(31);
  size_t parts = 0;
  for (int i = 0; i < 16; ++i) {
    Bytes damaged = whole;
    for (uint32_t k = 0; k < 1 + random.below(6); ++k) {
      damaged[random.below(static_cast<uint32_t>(whole.size()))] ^= 0x5a;
    }
    const size_t half = whole.size() / 2;
    if (i % 4 == 0) damaged.resize(half + random.below(static_cast<uint32_t>(half)));
    try {
      const DecoderHandle d = tolerant_decoder(damaged);
      const GaussianArrays rest = decode_rest(d, all_query());
      EXPECT_TRUE(contains(all, rows(rest)));
      EXPECT_EQ(rest.count() == all.size(), losses_of(d).empty());
      parts += rest.count() > 0;
      for (const double t : {0.1, 1.1}) d.slice(t);
    } catch (const Error& e) {
      EXPECT_NE(e.status(), L4D_ERR_INTERNAL);
    }
  }
  EXPECT_GT(parts, 0u);
}

INSTANTIATE_TEST_SUITE_P(Streams, Tolerant,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"staged", staged_file},
                                         NamedFile{"rcq", rcq_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file}),
                         file_name);

TEST(TolerantPacked, UnpacksWhatIsLeft) {
  for (const Bytes* whole : {&dynamic_file(), &staged_file()}) {
    const Anatomy anatomy(*whole);
    for (size_t p = 0; p < anatomy.pages.size(); p += 5) {
      const Bytes damaged = damage(*whole, anatomy.page_chunk(p));
      const Bytes other = anatomy.rebuilt_without(p);
      DecoderHandle want;
      want.open_memory(other.data(), other.size());
      const PackedArrays a = decode_packed(want, all_query());
      const PackedArrays b = decode_packed(tolerant_decoder(damaged), all_query());
      ASSERT_EQ(b.count(), a.count() + anatomy.pages[p].count);  // room for the whole selection
      const auto starts_with = [](const auto& x, const auto& y) {
        return x.size() >= y.size() && std::equal(y.begin(), y.end(), x.begin());
      };
      EXPECT_TRUE(starts_with(b.position, a.position));
      EXPECT_TRUE(starts_with(b.mean_t, a.mean_t));
      EXPECT_TRUE(starts_with(b.opacity, a.opacity));
      EXPECT_TRUE(starts_with(b.scale_factor, a.scale_factor));
      for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        EXPECT_TRUE(starts_with(b.depth[c], a.depth[c]));
        EXPECT_EQ(b.num_escapes[c], a.num_escapes[c]);
        EXPECT_TRUE(starts_with(b.escape[c], a.escape[c]));
        for (size_t i = 0; i < a.count(); ++i) {
          for (size_t s = 0; s < a.depth[c][i] && a.depth[c][i] != 255; ++s) {
            ASSERT_EQ(a.index[c][s * a.count() + i], b.index[c][s * b.count() + i]);
          }
        }
      }
    }
  }
}

// Everything behind the cut is gone, everything before it is there.
// spec: DEC-4
TEST(TolerantTruncation, KeepsWhatLiesBeforeTheEnd) {
  const Bytes& whole = dynamic_file();
  const GaussianArrays all = decode(whole, all_query());
  const Anatomy anatomy(whole);
  const uint64_t payload = anatomy.payload_begin();
  ASSERT_LT(payload, whole.size());
  for (uint64_t n = payload; n < whole.size(); n += 1 + whole.size() / 60) {
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(n));
    std::vector<size_t> lost;
    for (size_t p = 0; p < anatomy.pages.size(); ++p) {
      const ChunkRef& c = anatomy.pages[p].ref;
      if (c.offset + c.stored_bytes > n) lost.push_back(p);
    }
    const DecoderHandle d = tolerant_decoder(cut);
    ASSERT_TRUE(same_bits(without(all, anatomy, lost), decode_rest(d, all_query()))) << n;
    for (const l4d_loss& loss : losses_of(d)) {
      EXPECT_EQ(loss.status, L4D_ERR_TRUNCATED);
      EXPECT_STREQ(loss.clause, "CHNK-1");
    }
    EXPECT_EQ(counters_of(d).pages_lost, lost.size());
    EXPECT_EQ(strict_failure(cut, "CHNK-1"), L4D_ERR_TRUNCATED);
  }
}

// The whole directory cut off: one loss for each layer, however many pages it has.
TEST(TolerantTruncation, TheDirectoryMayBeMissing) {
  const Bytes& whole = dynamic_file();
  const Anatomy anatomy(whole);
  Bytes cut = whole;
  cut.resize(static_cast<size_t>(anatomy.tables_begin()));
  const DecoderHandle d = tolerant_decoder(cut);
  EXPECT_EQ(decode_rest(d, all_query()).count(), 0u);
  EXPECT_EQ(losses_of(d).size(), d.info().num_layers);
  EXPECT_EQ(d.slice(1.0).count(), 0u);
}

TEST(TolerantHeader, DamageThereIsRefused) {
  const Bytes& whole = tiny_file();
  const StreamEditor editor(whole);
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.tolerant = 1;
  for (const uint64_t at : {uint64_t{9}, editor.file.header_offset + 5}) {
    Bytes damaged = whole;
    damaged[static_cast<size_t>(at)] ^= 0x10;
    DecoderHandle d(&o);
    EXPECT_NE(l4d_decoder_open_memory(d.get(), damaged.data(), damaged.size()), L4D_OK);
  }
}

// ---- readers that fail in places, and recover -------------------------------------------------

struct PatchyReader {
  const Bytes* bytes;
  std::vector<std::pair<uint64_t, uint64_t>> holes;  // offset, bytes
  l4d_reader reader() {
    l4d_reader r = memory_reader(*bytes);
    r.user = this;
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      const PatchyReader& self = *static_cast<PatchyReader*>(user);
      for (const auto& [at, length] : self.holes) {
        if (offset < at + length && at < offset + n) return -1;
      }
      std::memcpy(dst, self.bytes->data() + offset, n);
      return static_cast<int64_t>(n);
    };
    r.size = [](void* user) -> int64_t {
      return static_cast<int64_t>(static_cast<PatchyReader*>(user)->bytes->size());
    };
    return r;
  }
};

TEST(TolerantReader, LosesThePagesInTheHoleAndNoOthers) {
  const Bytes& whole = dynamic_file();
  const GaussianArrays all = decode(whole, all_query());
  const Anatomy anatomy(whole);
  PatchyReader patchy{&whole, {}};
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 2);
  o.tolerant = 1;
  DecoderHandle d(&o);
  d.open(patchy.reader());
  for (const Chunk& chunk : anatomy.chunks) {
    if (chunk.kind != Chunk::kPage) continue;
    SCOPED_TRACE(chunk.name);
    // A byte of one page: pages are read together, and only this one must be lost.
    patchy.holes = {{chunk.ref.offset + chunk.ref.stored_bytes / 2, 1}};
    const std::vector<size_t> lost = anatomy.lost_with(chunk);
    ASSERT_TRUE(same_bits(without(all, anatomy, lost), decode_rest(d, all_query())));
    const auto losses = losses_of(d);
    ASSERT_EQ(losses.size(), 1u);
    EXPECT_EQ(losses[0].status, L4D_ERR_IO);
    EXPECT_STREQ(losses[0].clause, "");
    EXPECT_EQ(losses[0].offset, chunk.ref.offset);
  }
  patchy.holes.clear();
  EXPECT_TRUE(same_bits(all, decode_rest(d, all_query())));
  EXPECT_TRUE(losses_of(d).empty());
}

TEST(TolerantReader, EveryChunkIsAskedForAgain) {
  for (const Bytes* whole : {&dynamic_file(), &rcq_file()}) {
    const Anatomy anatomy(*whole);
    const GaussianArrays all = decode(*whole, all_query());
    for (const Chunk& chunk : anatomy.some_chunks(4)) {
      if (chunk.needed_by_all) continue;
      SCOPED_TRACE(chunk.name);
      PatchyReader patchy{whole, {{chunk.ref.offset, chunk.ref.stored_bytes}}};
      l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
      o.tolerant = 1;
      DecoderHandle d(&o);
      d.open(patchy.reader());
      ASSERT_TRUE(
          same_bits(without(all, anatomy, anatomy.lost_with(chunk)), decode_rest(d, all_query())));
      patchy.holes.clear();
      ASSERT_TRUE(same_bits(all, decode_rest(d, all_query())));
    }
  }
}

// A bucket with a hole stays in the cache as what it is: it is not decoded again while the hole is
// there, and is made whole when it closes.
TEST(TolerantReader, SlicingMendsItselfWhenTheReaderDoes) {
  const Bytes& whole = dynamic_file();
  const Anatomy anatomy(whole);
  const double t = 1.0;
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle undamaged(&o);
  undamaged.open_memory(whole.data(), whole.size());
  const SplatArrays want = undamaged.slice(t);
  o.tolerant = 1;
  size_t tried = 0;
  for (size_t p = 0; p < anatomy.pages.size(); ++p) {
    PatchyReader patchy{&whole, {{anatomy.pages[p].ref.offset, 1}}};
    DecoderHandle d(&o);
    d.open(patchy.reader());
    const SplatArrays first = d.slice(t);
    if (losses_of(d).empty()) continue;
    ++tried;
    const l4d_counters before = counters_of(d);
    EXPECT_TRUE(same_bits(first, d.slice(t)));
    const l4d_counters after = counters_of(d);
    EXPECT_EQ(before.buckets_decoded, after.buckets_decoded);
    EXPECT_EQ(before.pages_decoded, after.pages_decoded);
    EXPECT_GT(after.pages_lost, before.pages_lost);
    patchy.holes.clear();
    EXPECT_TRUE(same_bits(want, d.slice(t)));
    EXPECT_TRUE(losses_of(d).empty());
    const l4d_counters mended = counters_of(d);
    EXPECT_EQ(mended.buckets_decoded, after.buckets_decoded + 1);
    EXPECT_LE(mended.memory_bytes, mended.peak_memory_bytes);
  }
  EXPECT_GT(tried, 5u);
}

// ---- what is no loss ---------------------------------------------------------------------------

TEST(TolerantLimits, CancellingAndLimitsStillEndTheCall) {
  const Bytes& whole = dynamic_file();
  const Bytes damaged = damage(whole, Anatomy(whole).page_chunk(0));
  const DecoderHandle d = tolerant_decoder(damaged);
  const l4d_query q = all_query();
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = d.info().num_gaussians;
  l4d_decoder_set_progress(
      d.get(), [](void*, uint64_t, uint64_t, const char*) { return 1; }, nullptr);
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_ERR_CANCELLED);
  l4d_decoder_set_progress(d.get(), nullptr, nullptr);
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_OK);
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.tolerant = 1;
  o.max_memory_bytes = 20000;
  DecoderHandle small(&o);
  small.open_memory(damaged.data(), damaged.size());
  EXPECT_EQ(l4d_decoder_decode(small.get(), &q, &b), L4D_ERR_LIMIT_EXCEEDED);
}

// A scene with holes would look like damage: what does not fit the limit is refused, at any limit.
TEST(TolerantLimits, AWantOfMemoryIsNoLoss) {
  for (const Bytes* file : {&dynamic_file(), &transform_file(), &rcq_file()}) {
    bool refused = false, done = false;
    for (uint64_t limit = 1024; limit < (uint64_t{1} << 25); limit += limit / 12) {
      SCOPED_TRACE("limit " + std::to_string(limit));
      l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
      o.tolerant = 1;
      o.max_memory_bytes = limit;
      const DecoderHandle d(&o);
      if (l4d_decoder_open_memory(d.get(), file->data(), file->size()) != L4D_OK) continue;
      const l4d_query q = all_query();
      l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
      b.capacity = d.info().num_gaussians;
      std::vector<float> scale(4 * b.capacity);
      b.log_scale = scale.data();
      const l4d_status status = l4d_decoder_decode(d.get(), &q, &b);
      uint64_t losses = 1;
      d.check(l4d_decoder_get_losses(d.get(), nullptr, 0, &losses));
      ASSERT_EQ(losses, 0u);
      if (status == L4D_OK) {
        ASSERT_EQ(b.count, b.capacity);
        done = true;
      } else {
        ASSERT_EQ(status, L4D_ERR_LIMIT_EXCEEDED);
        refused = true;
      }
    }
    EXPECT_TRUE(refused);
    EXPECT_TRUE(done);
  }
}

TEST(TolerantLimits, SectionsAndValidationAreStrict) {
  const Bytes& whole = dynamic_file();
  const Bytes damaged = damage(whole, Anatomy(whole).page_chunk(0));
  const DecoderHandle d = tolerant_decoder(damaged);
  uint64_t sections[L4D_SECTION_COUNT];
  EXPECT_EQ(l4d_decoder_get_sections(d.get(), sections, L4D_SECTION_COUNT, nullptr, nullptr, 0),
            L4D_ERR_CHECKSUM);
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.tolerant = 1;
  const l4d_reader reader = memory_reader(damaged);
  uint64_t violations = 0;
  EXPECT_EQ(l4d_validate(&reader, &o, nullptr, nullptr, &violations), L4D_OK);
  EXPECT_EQ(violations, 1u);
}

TEST(Losses, ArgumentsAndStates) {
  uint64_t count = 77;
  l4d_loss loss[2];
  DecoderHandle closed;
  EXPECT_EQ(l4d_decoder_get_losses(nullptr, loss, 2, &count), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_decoder_get_losses(closed.get(), loss, 2, &count), L4D_ERR_INVALID_STATE);
  const Bytes& whole = dynamic_file();
  const Anatomy anatomy(whole);
  Bytes damaged = whole;
  for (size_t p = 0; p < anatomy.pages.size(); p += 2) {
    damaged = damage(damaged, anatomy.page_chunk(p));
  }
  const DecoderHandle d = tolerant_decoder(damaged);
  EXPECT_EQ(l4d_decoder_get_losses(d.get(), nullptr, 1, &count), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_decoder_get_losses(d.get(), loss, 2, nullptr), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(count, 77u);
  ASSERT_EQ(l4d_decoder_get_losses(d.get(), nullptr, 0, &count), L4D_OK);
  EXPECT_EQ(count, 0u);
  decode_rest(d, all_query());
  std::memset(loss, 0, sizeof loss);
  ASSERT_EQ(l4d_decoder_get_losses(d.get(), loss, 1, &count), L4D_OK);
  EXPECT_EQ(count, (anatomy.pages.size() + 1) / 2);
  EXPECT_EQ(loss[0].offset, anatomy.pages[0].ref.offset);
  EXPECT_EQ(loss[1].num_gaussians, 0u);  // beyond the capacity: untouched
  // Only the last query counts, and a strict decoder has none.
  d.select(all_query());
  ASSERT_EQ(l4d_decoder_get_losses(d.get(), nullptr, 0, &count), L4D_OK);
  EXPECT_EQ(count, 0u);
}

}  // namespace
}  // namespace l4d
