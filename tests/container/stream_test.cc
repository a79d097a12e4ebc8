// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/entropy/stream.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "tests/common/random.h"
#include "tests/common/stream_writer.h"

namespace l4d {
namespace {

using test::Random;

constexpr size_t kCounts[] = {1, 2, 7, 8, 9, 31, 32, 33, 1000, 65536};

const StreamKernels* const kKernels[] = {&stream_kernels_reference(), &stream_kernels_simd()};

std::vector<uint16_t> values16(size_t n, unsigned width, unsigned fill, uint64_t seed) {
  Random random(seed);
  const uint32_t limit = 1u << width;
  std::vector<uint16_t> v(n);
  uint32_t walk = limit / 2;
  for (uint16_t& x : v) {
    switch (fill) {
      case 0:  // anything
        x = static_cast<uint16_t>(random.below(limit));
        break;
      case 1:  // mostly small
        x = static_cast<uint16_t>(random.below(limit) & random.below(limit) & random.below(limit));
        break;
      case 2:  // the ends of the range
        x = static_cast<uint16_t>(random.below(2) == 0 ? 0 : limit - 1);
        break;
      default:  // smooth
        walk = (walk + random.below(5) + limit - 2) % limit;
        x = static_cast<uint16_t>(walk);
        break;
    }
  }
  return v;
}

struct Decoded {
  Status status;
  std::vector<uint16_t> values;
  size_t left = 0;  // bytes not read
};

Decoded read16(const StreamKernels* kernels, ByteSpan bytes, size_t n, unsigned width,
               uint32_t limit = 0) {
  StreamDecoder decoder;
  decoder.kernels = kernels;
  ByteReader in(bytes);
  Decoded out;
  out.values.assign(n, 0xaaaa);
  out.status = decode_stream(decoder, in, 1000, n, width, limit, "TEST-1", out.values.data());
  out.left = in.remaining();
  return out;
}

struct Decoded32 {
  Status status;
  std::vector<uint32_t> values;
  size_t left = 0;
};

Decoded32 read32(ByteSpan bytes, size_t n) {
  StreamDecoder decoder;
  decoder.kernels = &stream_kernels_reference();
  ByteReader in(bytes);
  Decoded32 out;
  out.values.assign(n, 0xaaaaaaaau);
  out.status = decode_stream32(decoder, in, 1000, n, out.values.data());
  out.left = in.remaining();
  return out;
}

size_t skipped(ByteSpan bytes, size_t n, unsigned width) {
  ByteReader in(bytes);
  EXPECT_TRUE(skip_stream(in, 0, n, width).ok());
  return in.position();
}

TEST(Stream, BitWidth) {
  EXPECT_EQ(bit_width(1), 0u);
  EXPECT_EQ(bit_width(2), 1u);
  EXPECT_EQ(bit_width(3), 2u);
  EXPECT_EQ(bit_width(4), 2u);
  EXPECT_EQ(bit_width(5), 3u);
  EXPECT_EQ(bit_width(4096), 12u);
  EXPECT_EQ(bit_width(4097), 13u);
  EXPECT_EQ(bit_width(65536), 16u);
}

TEST(Stream, EncodedStreamsDecode) {
  StreamEncoder encoder(3);
  for (unsigned width = 1; width <= 16; ++width) {
    for (const size_t n : kCounts) {
      for (unsigned fill = 0; fill < 4; ++fill) {
        if (n == 65536 && fill != width % 4) continue;
        const auto values = values16(n, width, fill, width * 1000 + n);
        Bytes bytes;
        encoder.encode(values.data(), n, width, true, bytes);
        for (const StreamKernels* k : kKernels) {
          const Decoded d = read16(k, bytes, n, width);
          ASSERT_TRUE(d.status.ok()) << d.status.detail();
          ASSERT_EQ(d.values, values) << "width " << width << ", n " << n << ", fill " << fill;
          ASSERT_EQ(d.left, 0u);
        }
        ASSERT_EQ(skipped(bytes, n, width), bytes.size());
      }
    }
  }
}

// spec: STRM-5
TEST(Stream, EveryLayoutDecodes) {
  for (unsigned width = 1; width <= 16; ++width) {
    for (const size_t n : kCounts) {
      const auto values = values16(n, width, width % 4, width * 77 + n);
      std::vector<Bytes> forms = {test::packed_stream(values, width)};
      for (unsigned codecs = 0; codecs < (width > 8 ? 4u : 2u); ++codecs) {
        forms.push_back(test::planes_stream(values, width, false, codecs));
      }
      if (width == 16) {
        forms.push_back(test::packed_stream(values, width, true));
        forms.push_back(test::planes_stream(values, width, true, 0));
        forms.push_back(test::planes_stream(values, width, true, 3));
      }
      for (const Bytes& form : forms) {
        Bytes followed = form;
        followed.insert(followed.end(), 5, 0xee);  // bytes of the next stream
        for (const StreamKernels* k : kKernels) {
          const Decoded d = read16(k, followed, n, width);
          ASSERT_TRUE(d.status.ok()) << d.status.detail();
          ASSERT_EQ(d.values, values)
              << "width " << width << ", n " << n << ", mode " << int{form[0]};
          ASSERT_EQ(d.left, 5u);
        }
        ASSERT_EQ(skipped(followed, n, width), form.size());
      }
    }
  }
}

TEST(Stream, ConstantsDecode) {
  for (unsigned width = 1; width <= 16; ++width) {
    for (const uint32_t value : {0u, 1u, (1u << width) - 1}) {
      for (const size_t n : kCounts) {
        const Decoded d = read16(kKernels[0], test::constant_stream(value, width), n, width);
        ASSERT_TRUE(d.status.ok()) << d.status.detail();
        ASSERT_EQ(d.values, std::vector<uint16_t>(n, static_cast<uint16_t>(value)));
        ASSERT_EQ(d.left, 0u);
      }
    }
  }
  const Decoded32 d = read32(test::constant_stream(0x89abcdefu, 32), 9);
  ASSERT_TRUE(d.status.ok());
  EXPECT_EQ(d.values, std::vector<uint32_t>(9, 0x89abcdefu));
}

TEST(Stream, EncoderWritesConstantsInAFewBytes) {
  StreamEncoder encoder(3);
  Bytes bytes;
  encoder.encode(std::vector<uint16_t>(1000, 513).data(), 1000, 12, true, bytes);
  EXPECT_EQ(bytes, (Bytes{2, 1, 2}));
}

TEST(Stream, EncoderUsesDeltaWhereItPays) {
  std::vector<uint16_t> ramp(4096);
  for (size_t i = 0; i < ramp.size(); ++i) ramp[i] = static_cast<uint16_t>(i * 16);
  StreamEncoder encoder(3);
  Bytes plain, delta;
  encoder.encode(ramp.data(), ramp.size(), 16, false, plain);
  encoder.encode(ramp.data(), ramp.size(), 16, true, delta);
  EXPECT_NE(delta[0] & kStreamDeltaBit, 0);
  EXPECT_EQ(plain[0] & kStreamDeltaBit, 0);
  EXPECT_LT(delta.size() * 4, plain.size());
}

TEST(Stream, NothingIsReadForNoValuesOrNoBits) {
  const Bytes bytes{0x77};
  const Decoded none = read16(kKernels[0], bytes, 0, 16);
  EXPECT_TRUE(none.status.ok());
  EXPECT_EQ(none.left, 1u);
  const Decoded zeros = read16(kKernels[0], bytes, 5, 0, 1);
  EXPECT_TRUE(zeros.status.ok());
  EXPECT_EQ(zeros.left, 1u);
  EXPECT_EQ(zeros.values, std::vector<uint16_t>(5, 0));
  EXPECT_EQ(read32(bytes, 0).left, 1u);
  EXPECT_EQ(skipped(bytes, 0, 16), 0u);
  EXPECT_EQ(skipped(bytes, 5, 0), 0u);
  StreamEncoder encoder(1);
  Bytes out;
  encoder.encode(nullptr, 0, 16, true, out);
  const uint16_t zero = 0;
  encoder.encode(&zero, 1, 0, true, out);
  EXPECT_TRUE(out.empty());
}

TEST(Stream, Streams32) {
  Random random(5);
  StreamEncoder encoder(3);
  for (const size_t n : kCounts) {
    for (unsigned fill = 0; fill < 3; ++fill) {
      std::vector<uint32_t> values(n);
      uint32_t walk = 0x80000000u;
      for (uint32_t& v : values) {
        walk += random.below(200) - 100;
        v = fill == 0   ? static_cast<uint32_t>(random.bits())
            : fill == 1 ? walk
                        : (random.below(2) == 0 ? 0 : 0xffffffffu);
      }
      std::vector<Bytes> forms(2);
      encoder.encode32(values.data(), n, false, forms[0]);
      encoder.encode32(values.data(), n, true, forms[1]);
      for (const bool delta : {false, true}) {
        forms.push_back(test::packed_stream(values, 32, delta));
        for (const unsigned codecs : {0u, 5u, 15u}) {
          forms.push_back(test::planes_stream(values, 32, delta, codecs));
        }
      }
      for (Bytes& form : forms) {
        const size_t size = form.size();
        form.insert(form.end(), 3, 0xee);
        const Decoded32 d = read32(form, n);
        ASSERT_TRUE(d.status.ok()) << d.status.detail();
        ASSERT_EQ(d.values, values) << "n " << n << ", fill " << fill << ", mode " << int{form[0]};
        ASSERT_EQ(d.left, 3u);
        ASSERT_EQ(skipped(form, n, 32), size);
      }
    }
  }
}

// Every way of reading a stream, for the hostile tests.
std::vector<std::pair<std::string, std::function<Status(ByteSpan)>>> readers(size_t n,
                                                                             unsigned width) {
  if (width == 32) {
    return {{"decode32", [=](ByteSpan b) { return read32(b, n).status; }},
            {"skip", [=](ByteSpan b) {
               ByteReader in(b);
               return skip_stream(in, 1000, n, width);
             }}};
  }
  return {{"reference", [=](ByteSpan b) { return read16(kKernels[0], b, n, width).status; }},
          {"simd", [=](ByteSpan b) { return read16(kKernels[1], b, n, width).status; }},
          {"skip", [=](ByteSpan b) {
             ByteReader in(b);
             return skip_stream(in, 1000, n, width);
           }}};
}

// spec: STRM-2
TEST(Stream, TruncatedAtEveryLength) {
  for (const unsigned width : {1u, 5u, 8u, 11u, 16u, 32u}) {
    const size_t n = 41;
    Random random(width);
    std::vector<uint32_t> values(n);
    for (uint32_t& v : values) {
      v = static_cast<uint32_t>(random.bits()) & (width == 32 ? ~0u : (1u << width) - 1);
    }
    for (const Bytes& form :
         {test::packed_stream(values, width), test::planes_stream(values, width, false, 0),
          test::planes_stream(values, width, false, 0xf),
          test::constant_stream(values[0], width)}) {
      for (const auto& [name, read] : readers(n, width)) {
        // An exact copy, so that a sanitizer sees every byte read beyond the end.
        for (size_t cut = 0; cut < form.size(); ++cut) {
          const Bytes shorter(form.begin(), form.begin() + static_cast<std::ptrdiff_t>(cut));
          const Status s = read(shorter);
          ASSERT_EQ(s.code(), L4D_ERR_CORRUPT) << name << " width " << width << " cut " << cut;
          ASSERT_STREQ(s.clause(), "STRM-2") << name << " width " << width << " cut " << cut;
        }
        ASSERT_TRUE(read(form).ok()) << name << " width " << width;
      }
    }
  }
}

// spec: STRM-1, STRM-6
TEST(Stream, UnknownModesAreRefused) {
  for (const unsigned width : {1u, 8u, 12u, 16u, 32u}) {
    for (unsigned mode = 0; mode < 256; ++mode) {
      const bool known = (mode & 3) <= 2 && mode < 8;
      const bool delta = (mode & 4) != 0;
      const bool delta_allowed = (width == 16 || width == 32) && (mode & 3) != 2;
      Bytes bytes(200, 0);
      bytes[0] = static_cast<unsigned char>(mode);
      for (const auto& [name, read] : readers(3, width)) {
        const Status s = read(bytes);
        if (!known) {
          ASSERT_STREQ(s.clause(), "STRM-1") << name << " width " << width << " mode " << mode;
        } else if (delta && !delta_allowed) {
          ASSERT_STREQ(s.clause(), "STRM-6") << name << " width " << width << " mode " << mode;
        } else {
          ASSERT_TRUE(s.ok()) << name << " width " << width << " mode " << mode << s.detail();
        }
        ASSERT_EQ(s.code(), s.ok() ? L4D_OK : L4D_ERR_CORRUPT);
      }
    }
  }
}

// spec: STRM-4
TEST(Stream, PaddingBitsMustBeZero) {
  for (unsigned width = 1; width <= 16; ++width) {
    const size_t n = 5;
    const Bytes good = test::packed_stream(values16(n, width, 0, width), width);
    for (size_t bit = n * width; bit < (good.size() - 1) * 8; ++bit) {
      Bytes bad = good;
      bad[1 + bit / 8] = static_cast<unsigned char>(bad[1 + bit / 8] | (1u << (bit % 8)));
      const Status s = read16(kKernels[1], bad, n, width).status;
      EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
      EXPECT_STREQ(s.clause(), "STRM-4") << "width " << width;
    }
  }
}

// spec: STRM-3
TEST(Stream, ValuesOutOfRangeAreRefused) {
  const size_t n = 70;
  for (unsigned width = 1; width <= 15; ++width) {
    for (const size_t at : {size_t{0}, size_t{37}, n - 1}) {
      std::vector<uint16_t> values(n, 0);
      values[at] = static_cast<uint16_t>(1u << width);
      // Widths of whole bytes leave a plane no room for a value out of range.
      if (width % 8 != 0) {
        const Bytes planes = test::planes_stream(values, width);
        for (const StreamKernels* k : kKernels) {
          const Status s = read16(k, planes, n, width).status;
          EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
          EXPECT_STREQ(s.clause(), "STRM-3") << "width " << width;
        }
        const Bytes constant = test::constant_stream(1u << width, width);
        EXPECT_STREQ(read16(kKernels[0], constant, n, width).status.clause(), "STRM-3");
      }
      // A limit that is no power of two names the rule of the caller, in every layout.
      const uint32_t limit = (1u << width) - (width > 1 ? 1u : 0u);
      values[at] = static_cast<uint16_t>(limit);
      if (limit >= 1u << width) continue;
      for (const Bytes& form :
           {test::packed_stream(values, width), test::planes_stream(values, width),
            test::planes_stream(values, width, false, 3)}) {
        for (const StreamKernels* k : kKernels) {
          EXPECT_STREQ(read16(k, form, n, width, limit).status.clause(), "TEST-1");
          EXPECT_TRUE(read16(k, form, n, width, limit + 1).status.ok());
        }
      }
    }
  }
}

// spec: CHNK-5, CHNK-6
TEST(Stream, PlanesOfOtherSizesOrCodecsAreRefused) {
  const size_t n = 100;
  const auto values = values16(n, 8, 1, 3);
  Bytes plane(values.begin(), values.end());
  const auto stream_of = [](const Bytes& frame) {
    Bytes out{1, 1};
    append_vlq(frame.size(), out);
    out.insert(out.end(), frame.begin(), frame.end());
    return out;
  };
  ZstdCompressor zstd(3);
  const Bytes good = zstd.compress(plane);
  ASSERT_TRUE(read16(kKernels[0], stream_of(good), n, 8).status.ok());

  Bytes longer = plane, shorter = plane;
  longer.push_back(0);
  shorter.pop_back();
  Bytes two_frames = zstd.compress(Bytes(plane.begin(), plane.begin() + 50));
  const Bytes second = zstd.compress(Bytes(plane.begin() + 50, plane.end()));
  two_frames.insert(two_frames.end(), second.begin(), second.end());
  Bytes with_tail = good;
  with_tail.push_back(0);
  Bytes cut = good;
  cut.pop_back();
  for (const Bytes& frame : {zstd.compress(longer), zstd.compress(shorter), two_frames, with_tail,
                             cut, Bytes{}, plane}) {
    const Status s = read16(kKernels[0], stream_of(frame), n, 8).status;
    EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
    EXPECT_STREQ(s.clause(), "CHNK-5");
  }
  for (const unsigned codec : {2u, 3u, 255u}) {
    Bytes unknown = stream_of(good);
    unknown[1] = static_cast<unsigned char>(codec);
    for (const auto& [name, read] : readers(n, 8)) {
      const Status s = read(unknown);
      EXPECT_EQ(s.code(), L4D_ERR_FEATURE_UNSUPPORTED) << name;
      EXPECT_STREQ(s.clause(), "CHNK-6") << name;
    }
  }
}

TEST(Stream, AbsurdPlaneLengthsAreRefused) {
  Bytes endless{1, 1};
  endless.insert(endless.end(), 12, 0xff);  // a length that never ends
  Bytes huge{1, 1};
  append_vlq(~uint64_t{0} >> 1, huge);
  for (const Bytes& bytes : {endless, huge}) {
    for (const auto& [name, read] : readers(10, 8)) {
      EXPECT_STREQ(read(bytes).clause(), "STRM-2") << name;
    }
  }
}

// spec: STRM-2
TEST(Stream, LengthsTakeNineBytesAtMost) {
  const size_t n = 100;
  const auto values = values16(n, 8, 1, 3);
  ZstdCompressor zstd(3);
  const Bytes frame = zstd.compress(Bytes(values.begin(), values.end()));
  ASSERT_LT(frame.size(), size_t{1} << 14);
  for (const size_t length : {2u, 8u, 9u, 10u, 11u}) {
    // The same number, with groups of zeros behind it.
    Bytes bytes{1, 1};
    for (size_t k = 0; k < length; ++k) {
      const size_t group = k < 2 ? (frame.size() >> (7 * k)) & 0x7f : 0;
      bytes.push_back(static_cast<unsigned char>(group | (k + 1 < length ? 0x80 : 0)));
    }
    bytes.insert(bytes.end(), frame.begin(), frame.end());
    for (const auto& [name, read] : readers(n, 8)) {
      EXPECT_STREQ(read(bytes).clause(), length <= 9 ? "" : "STRM-2") << name << ", " << length;
    }
    // The ninth byte still says that more follow, and the frame comes at once.
    if (length != 9) continue;
    bytes[2 + 8] = 0x80;
    for (const auto& [name, read] : readers(n, 8)) {
      EXPECT_STREQ(read(bytes).clause(), "STRM-2") << name;
    }
  }
}

TEST(Stream, RandomBytesNeverPassTheirEnd) {
  Random random(99);
  for (int round = 0; round < 20000; ++round) {
    const unsigned width = 1 + random.below(17);
    const size_t n = random.below(60);
    Bytes bytes(random.below(40));
    for (unsigned char& b : bytes) {
      b = static_cast<unsigned char>(random.below(4) == 0 ? random.below(256) : random.below(6));
    }
    for (const auto& [name, read] : readers(n, width == 17 ? 32 : width)) {
      const Status s = read(bytes);
      if (!s.ok()) {
        ASSERT_TRUE(s.code() == L4D_ERR_CORRUPT || s.code() == L4D_ERR_FEATURE_UNSUPPORTED);
        ASSERT_STRNE(s.clause(), "") << name;
        ASSERT_GE(s.offset(), 1000u);
      }
    }
  }
}

TEST(Chunk, StoredAndCompressed) {
  StreamDecoder decoder;
  const Bytes raw{1, 2, 3, 4, 5, 6, 7, 8};
  Bytes storage;
  ByteSpan out;
  ASSERT_TRUE(decode_chunk(decoder, 0, raw, raw.size(), 100, 0, storage, &out).ok());
  EXPECT_EQ(out.data(), raw.data());  // no copy
  const Bytes frame = ZstdCompressor(3).compress(raw);
  ASSERT_TRUE(decode_chunk(decoder, 1, frame, raw.size(), raw.size(), 0, storage, &out).ok());
  EXPECT_EQ(Bytes(out.begin(), out.end()), raw);
}

// spec: CHNK-3, CHNK-5, CHNK-6
TEST(Chunk, RefusesWrongSizesAndCodecs) {
  StreamDecoder decoder;
  const Bytes raw{1, 2, 3, 4, 5, 6, 7, 8};
  const Bytes frame = ZstdCompressor(3).compress(raw);
  Bytes storage;
  ByteSpan out;
  EXPECT_STREQ(decode_chunk(decoder, 0, raw, 9, 100, 0, storage, &out).clause(), "CHNK-3");
  EXPECT_STREQ(decode_chunk(decoder, 0, raw, 7, 100, 0, storage, &out).clause(), "CHNK-3");
  EXPECT_STREQ(decode_chunk(decoder, 1, frame, 9, 100, 0, storage, &out).clause(), "CHNK-5");
  EXPECT_STREQ(decode_chunk(decoder, 1, frame, 7, 100, 0, storage, &out).clause(), "CHNK-5");
  EXPECT_STREQ(decode_chunk(decoder, 1, raw, 8, 100, 0, storage, &out).clause(), "CHNK-5");
  const Status unknown = decode_chunk(decoder, 2, raw, 8, 100, 0, storage, &out);
  EXPECT_STREQ(unknown.clause(), "CHNK-6");
  EXPECT_EQ(unknown.code(), L4D_ERR_FEATURE_UNSUPPORTED);
}

// spec: CHNK-8
TEST(Chunk, RefusesMoreThanItsContentCanTakeBeforeAllocating) {
  StreamDecoder decoder;
  const Bytes raw{1, 2, 3, 4, 5, 6, 7, 8};
  const Bytes frame = ZstdCompressor(3).compress(raw);
  Bytes storage;
  ByteSpan out;
  EXPECT_TRUE(decode_chunk(decoder, 1, frame, 8, 8, 0, storage, &out).ok());
  storage = Bytes();
  EXPECT_STREQ(decode_chunk(decoder, 1, frame, 8, 7, 0, storage, &out).clause(), "CHNK-8");
  EXPECT_STREQ(decode_chunk(decoder, 0, raw, 8, 7, 0, storage, &out).clause(), "CHNK-8");
  const Status huge = decode_chunk(decoder, 1, frame, ~uint64_t{0}, 8, 0, storage, &out);
  EXPECT_STREQ(huge.clause(), "CHNK-8");
  EXPECT_EQ(huge.code(), L4D_ERR_CORRUPT);
  EXPECT_EQ(storage.capacity(), 0u);
}

}  // namespace
}  // namespace l4d
