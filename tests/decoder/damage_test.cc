// SPDX-License-Identifier: Apache-2.0
// Damaged files are refused, or decode to what the whole file holds; nothing else.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/common/codec.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using namespace test;

struct Outcome {
  l4d_status status = L4D_OK;
  GaussianArrays arrays;
};

Outcome try_decode(const Bytes& bytes) {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  DecoderHandle d(&o);
  Outcome out;
  try {
    d.open_memory(bytes.data(), bytes.size());
    out.arrays = d.decode(all_query());
  } catch (const Error& e) {
    out.status = e.status();
    EXPECT_STRNE(l4d_last_error_message(), "");
  }
  return out;
}

bool is_damage(l4d_status s) {
  return s == L4D_ERR_NOT_L4D || s == L4D_ERR_TRUNCATED || s == L4D_ERR_CORRUPT ||
         s == L4D_ERR_CHECKSUM || s == L4D_ERR_VERSION_UNSUPPORTED ||
         s == L4D_ERR_FEATURE_UNSUPPORTED;
}

// spec: CHNK-1
TEST(Damage, TruncatedAtEveryLength) {
  const Bytes& whole = tiny_file();
  for (size_t n = 0; n < whole.size(); ++n) {
    const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(n));
    const Outcome out = try_decode(cut);
    ASSERT_EQ(out.status, n == 0 ? L4D_ERR_NOT_L4D : L4D_ERR_TRUNCATED) << n;
  }
  EXPECT_EQ(try_decode(whole).status, L4D_OK);
}

TEST(Damage, BytesBehindTheEndAreIgnored) {
  Bytes longer = tiny_file();
  longer.insert(longer.end(), 100, 0x5a);
  const Outcome out = try_decode(longer);
  ASSERT_EQ(out.status, L4D_OK);
  EXPECT_TRUE(same_bits(out.arrays, try_decode(tiny_file()).arrays));
}

// Every stored byte is under a checksum.
// spec: CHNK-2
TEST(Damage, EveryByteIsProtected) {
  const Bytes& whole = tiny_file();
  for (size_t at = 0; at < whole.size(); ++at) {
    for (const unsigned pattern : {0x01u, 0x80u, 0xffu}) {
      Bytes damaged = whole;
      damaged[at] = static_cast<unsigned char>(damaged[at] ^ pattern);
      const Outcome out = try_decode(damaged);
      ASSERT_NE(out.status, L4D_OK) << "byte " << at;
      ASSERT_TRUE(is_damage(out.status)) << "byte " << at << ": " << l4d_status_name(out.status);
    }
  }
}

TEST(Damage, EveryByteOfLargerFilesIsProtected) {
  Random random(21);
  for (const Bytes* whole : {&dynamic_file(), &staged_file(), &lossless_file(), &rcq_file()}) {
    for (int i = 0; i < 150; ++i) {
      Bytes damaged = *whole;
      const size_t at = random.below(static_cast<uint32_t>(whole->size()));
      damaged[at] = static_cast<unsigned char>(damaged[at] ^ (1u + random.below(255)));
      const Outcome out = try_decode(damaged);
      ASSERT_TRUE(is_damage(out.status)) << "byte " << at << ": " << l4d_status_name(out.status);
    }
  }
}

TEST(Damage, ValidatorFindsIt) {
  Random random(22);
  for (const Bytes* whole : {&tiny_file(), &dynamic_file()}) {
    for (int i = 0; i < 30; ++i) {
      Bytes damaged = *whole;
      const size_t at = random.below(static_cast<uint32_t>(whole->size()));
      damaged[at] = static_cast<unsigned char>(damaged[at] ^ (1u + random.below(255)));
      const auto found = validate(damaged);
      ASSERT_FALSE(found.empty()) << "byte " << at;
      for (const Violation& v : found) {
        EXPECT_TRUE(is_damage(v.status));
        EXPECT_FALSE(v.message.empty());
      }
    }
  }
}

// A time query does not need, and so does not miss, what lies in other buckets.
// spec: PAGE-3
TEST(Damage, OtherBucketsAreNotRead) {
  const Bytes& whole = dynamic_file();
  const GaussianArrays want = decode(whole, time_query(0));
  // The last pages of the file hold the end of the sequence.
  const Bytes cut(whole.begin(), whole.end() - 1000);
  EXPECT_TRUE(same_bits(want, decode(cut, time_query(0))));
  EXPECT_EQ(try_decode(cut).status, L4D_ERR_TRUNCATED);
}

// ---- readers -----------------------------------------------------------------------------------

struct OddReader {
  const Bytes* bytes;
  size_t largest = ~size_t{0};  // bytes per call
  int fail_at = -1;             // call that fails
  int64_t size_offset = 0;
  int calls = 0;
  l4d_reader reader() {
    l4d_reader r = L4D_INIT(l4d_reader);
    r.user = this;
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      OddReader& self = *static_cast<OddReader*>(user);
      if (self.calls++ == self.fail_at) return -1;
      const Bytes& from = *self.bytes;
      if (offset >= from.size()) return 0;
      n = std::min({n, self.largest, from.size() - static_cast<size_t>(offset)});
      std::copy_n(from.data() + offset, n, static_cast<unsigned char*>(dst));
      return static_cast<int64_t>(n);
    };
    r.size = [](void* user) -> int64_t {
      const OddReader& self = *static_cast<OddReader*>(user);
      return self.size_offset == INT64_MIN
                 ? -1
                 : static_cast<int64_t>(self.bytes->size()) + self.size_offset;
    };
    return r;
  }
};

TEST(Reader, ShortReadsAreContinued) {
  const GaussianArrays want = decode(dynamic_file(), all_query());
  for (const size_t largest : {size_t{1}, size_t{7}, size_t{1000}}) {
    OddReader odd{&dynamic_file()};
    odd.largest = largest;
    DecoderHandle d;
    d.open(odd.reader());
    EXPECT_TRUE(same_bits(want, d.decode(all_query())));
  }
}

TEST(Reader, FailureOfAnyCallIsReported) {
  OddReader count{&tiny_file()};
  {
    DecoderHandle d;
    d.open(count.reader());
    d.decode(all_query());
    d.slice(0);
  }
  ASSERT_GT(count.calls, 5);
  for (int k = 0; k < count.calls; ++k) {
    OddReader odd{&tiny_file()};
    odd.fail_at = k;
    DecoderHandle d;
    l4d_status status = L4D_OK;
    try {
      d.open(odd.reader());
      d.decode(all_query());
      d.slice(0);
    } catch (const Error& e) {
      status = e.status();
    }
    EXPECT_EQ(status, L4D_ERR_IO) << "call " << k;
    // The handle goes on working when the reader does.
    if (odd.calls > 2) {
      EXPECT_TRUE(same_bits(decode(tiny_file(), all_query()), d.decode(all_query())))
          << "call " << k;
    }
  }
}

TEST(Reader, SizesThatLie) {
  for (const int64_t offset : {int64_t{INT64_MIN}, int64_t{1000}}) {
    OddReader odd{&tiny_file()};
    odd.size_offset = offset;
    DecoderHandle d;
    const l4d_reader r = odd.reader();
    const l4d_status status = l4d_decoder_open(d.get(), &r);
    EXPECT_EQ(status, offset == INT64_MIN ? L4D_ERR_IO : L4D_OK);
  }
  Bytes cut = tiny_file();
  cut.resize(cut.size() - 10);
  OddReader odd{&cut};
  odd.size_offset = 10;  // it ends before its own size
  DecoderHandle d;
  d.open(odd.reader());
  const l4d_query q = all_query();
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = 1000;
  EXPECT_EQ(l4d_decoder_decode(d.get(), &q, &b), L4D_ERR_IO);
}

// A failing reader is no violation of the stream.
TEST(Reader, FailureEndsValidation) {
  OddReader count{&tiny_file()};
  uint64_t violations = 0;
  l4d_reader r = count.reader();
  ASSERT_EQ(l4d_validate(&r, nullptr, nullptr, nullptr, &violations), L4D_OK);
  ASSERT_EQ(violations, 0u);
  for (int k = 0; k < count.calls; ++k) {
    OddReader odd{&tiny_file()};
    odd.fail_at = k;
    r = odd.reader();
    violations = 99;
    EXPECT_EQ(l4d_validate(&r, nullptr, nullptr, nullptr, &violations), L4D_ERR_IO) << "call " << k;
    EXPECT_EQ(violations, 0u) << "call " << k;
  }
}

}  // namespace
}  // namespace l4d
