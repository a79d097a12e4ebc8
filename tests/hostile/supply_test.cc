// SPDX-License-Identifier: Apache-2.0
// Supplies (stream.h) from a server that one cannot trust: bytes that are cut short, come twice,
// overlap, lie, or are of another place. A call may fail; what succeeds is right, memory stays
// within its limit, and honest bytes afterwards make the picture whole.
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "l4d/stream.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"
#include "tests/decoder/allocation_meter.h"

namespace l4d {
namespace {

using namespace test;

using Ranges = std::vector<l4d_planned_range>;

constexpr uint64_t kLimit = uint64_t{16} << 20;
// Working memory of one thread, handle and strings: what is not charged to the limit.
constexpr uint64_t kUncharged = uint64_t{4} << 20;

DecoderHandle supplied(uint64_t size) {
  l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, 1);
  o.max_memory_bytes = kLimit;
  DecoderHandle d(&o);
  d.check(l4d_decoder_open_supplied(d.get(), size));
  return d;
}

// What is wanted for an instant, or nothing where the decoder says that it never will be complete.
std::optional<Ranges> plan(const DecoderHandle& d, double time) {
  l4d_plan_query query;
  l4d_plan_query_init(&query);
  query.time = time;
  uint64_t count = 0;
  if (l4d_decoder_plan(d.get(), &query, nullptr, 0, &count) != L4D_OK) return std::nullopt;
  Ranges ranges(static_cast<size_t>(count));
  if (l4d_decoder_plan(d.get(), &query, ranges.data(), count, &count) != L4D_OK) {
    return std::nullopt;
  }
  return ranges;
}

SplatArrays whole_slice(const Bytes& file, double time) {
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  return d.slice(time);
}

// A slice is what it should be, or an error that one expects of bad bytes.
bool slice_is_right(const DecoderHandle& d, double time, const SplatArrays& want, bool* complete) {
  try {
    const SplatArrays got = d.slice(time);
    *complete = true;
    return static_cast<bool>(same_bits(got, want));
  } catch (const Error& e) {
    *complete = false;
    return e.status() == L4D_ERR_NEED_DATA || e.status() == L4D_ERR_CHECKSUM ||
           e.status() == L4D_ERR_CORRUPT || e.status() == L4D_ERR_LIMIT_EXCEEDED ||
           e.status() == L4D_ERR_NOT_L4D || e.status() == L4D_ERR_VERSION_UNSUPPORTED ||
           e.status() == L4D_ERR_TRUNCATED || e.status() == L4D_ERR_INVALID_STATE;
  }
}

bool fails_as_it_may(l4d_status status) {
  return status == L4D_OK || status == L4D_ERR_CHECKSUM || status == L4D_ERR_CORRUPT ||
         status == L4D_ERR_NOT_L4D || status == L4D_ERR_TRUNCATED ||
         status == L4D_ERR_VERSION_UNSUPPORTED || status == L4D_ERR_FEATURE_UNSUPPORTED ||
         status == L4D_ERR_LIMIT_EXCEEDED || status == L4D_ERR_INVALID_ARGUMENT ||
         status == L4D_ERR_INVALID_STATE;
}

class HostileSupplies : public testing::TestWithParam<NamedFile> {};

// Answers that are shorter than asked, come twice, or overlap others cost rounds and nothing else.
TEST_P(HostileSupplies, ShortRepeatedAndOverlapping) {
  const Bytes& file = GetParam().bytes();
  const SplatArrays want = whole_slice(file, 0.5);
  Random random(11);
  for (int run = 0; run < 20; ++run) {
    const AllocationMeter meter;
    DecoderHandle d = supplied(run % 2 == 0 ? file.size() : 0);
    const auto supply = [&](uint64_t offset, uint64_t size) {
      if (offset >= file.size()) return;
      size = std::min<uint64_t>(size, file.size() - offset);
      EXPECT_EQ(l4d_decoder_supply(d.get(), offset, file.data() + offset, size), L4D_OK);
    };
    bool complete = false;
    for (int round = 0; round < 400 && !complete; ++round) {
      const std::optional<Ranges> ranges = plan(d, 0.5);
      ASSERT_TRUE(ranges);
      for (const l4d_planned_range& r : *ranges) {
        supply(r.offset, 1 + random.below(static_cast<uint32_t>(r.size)));  // cut short
        if (random.below(3) == 0) supply(r.offset, r.size / 2 + 1);         // once more
        const uint64_t before = std::min<uint64_t>(r.offset, random.below(500));
        if (random.below(3) == 0)
          supply(r.offset - before, before + r.size / 3 + 1);  // overlapping
        supply(r.offset, 0);
      }
      EXPECT_TRUE(slice_is_right(d, 0.5, want, &complete));
      if (ranges->empty()) {
        EXPECT_TRUE(complete);
      }
    }
    EXPECT_TRUE(complete);
    EXPECT_LT(meter.peak(), kLimit + kUncharged);
  }
}

// Bytes that lie, or are of another place: nothing wrong is ever shown, plans end, and a decoder
// that starts again with honest bytes shows the picture.
TEST_P(HostileSupplies, WrongBytes) {
  const Bytes& file = GetParam().bytes();
  const SplatArrays want = whole_slice(file, 0.5);
  Random random(12);
  for (int run = 0; run < 60; ++run) {
    const AllocationMeter meter;
    DecoderHandle d = supplied(file.size());
    const uint32_t share = 1 + static_cast<uint32_t>(run % 6);  // one answer in so many lies
    bool complete = false, ended = false;
    for (int round = 0; round < 60 && !ended; ++round) {
      const std::optional<Ranges> ranges = plan(d, 0.5);
      if (!ranges) break;
      ended = ranges->empty();
      for (const l4d_planned_range& r : *ranges) {
        ASSERT_LE(r.offset + r.size, file.size());
        Bytes answer(file.begin() + static_cast<std::ptrdiff_t>(r.offset),
                     file.begin() + static_cast<std::ptrdiff_t>(r.offset + r.size));
        if (random.below(share) == 0) {
          switch (random.below(3)) {
            case 0:
              answer[random.below(static_cast<uint32_t>(answer.size()))] ^=
                  static_cast<unsigned char>(1u << random.below(8));
              break;
            case 1:
              std::fill(answer.begin(), answer.end(), static_cast<unsigned char>(0));
              break;
            default:
              std::reverse(answer.begin(), answer.end());
          }
        }
        EXPECT_TRUE(
            fails_as_it_may(l4d_decoder_supply(d.get(), r.offset, answer.data(), answer.size())));
      }
      EXPECT_TRUE(slice_is_right(d, 0.5, want, &complete));
    }
    EXPECT_LT(meter.peak(), kLimit + kUncharged);
    // The handle is as good as new.
    ASSERT_EQ(l4d_decoder_open_supplied(d.get(), file.size()), L4D_OK);
    ASSERT_EQ(l4d_decoder_supply(d.get(), 0, file.data(), file.size()), L4D_OK);
    EXPECT_TRUE(slice_is_right(d, 0.5, want, &complete));
    EXPECT_TRUE(complete);
  }
}

// Offsets and sizes that no file has.
TEST_P(HostileSupplies, PlacesBeyondTheFile) {
  const Bytes& file = GetParam().bytes();
  for (const uint64_t size : {uint64_t{0}, uint64_t{file.size()}}) {
    DecoderHandle d = supplied(size);
    for (const uint64_t offset : {uint64_t{file.size()} + 1, UINT64_MAX - 10, UINT64_MAX}) {
      const l4d_status status = l4d_decoder_supply(d.get(), offset, file.data(), 16);
      EXPECT_TRUE(fails_as_it_may(status)) << l4d_status_name(status);
      if (size > 0 || offset > UINT64_MAX - 16) {
        EXPECT_EQ(status, L4D_ERR_INVALID_ARGUMENT);
      }
    }
    // A file of petabytes, a byte here and there.
    DecoderHandle sparse = supplied(uint64_t{1} << 50);
    const AllocationMeter meter;
    for (uint64_t k = 1; k < 20000; ++k) {
      l4d_decoder_supply(sparse.get(), k * (uint64_t{1} << 30), file.data(), 1);
    }
    EXPECT_LT(meter.peak(), kLimit + kUncharged);
  }
}

INSTANTIATE_TEST_SUITE_P(Files, HostileSupplies,
                         testing::Values(NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"transform", transform_file},
                                         NamedFile{"lossless", lossless_file}),
                         file_name);

}  // namespace
}  // namespace l4d
