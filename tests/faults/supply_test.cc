// SPDX-License-Identifier: Apache-2.0
// Memory that runs out at any allocation of a decoder that is supplied: an error, nothing leaks,
// and the same calls succeed afterwards.
#include <gtest/gtest.h>

#include <vector>

#include "l4d/stream.h"
#include "tests/common/codec.h"
#include "tests/faults/failing_new.h"

namespace l4d {
namespace {

using namespace test;

// The calls of a player for one instant, in arrays that are made once.
class Player {
 public:
  explicit Player(const Bytes& file)
      : file_(file), ranges_(64), position_(3 * kGaussians), want_(3 * kGaussians) {
    l4d_plan_query_init(&query_);
    DecoderHandle d;
    EXPECT_EQ(play(d.get()), L4D_OK);
    want_ = position_;
    visible_ = got_;
  }

  l4d_status play(l4d_decoder* d) {
    l4d_status status = l4d_decoder_open_supplied(d, file_.size());
    for (int round = 0; status == L4D_OK && round < 10; ++round) {
      uint64_t count = 0;
      status = l4d_decoder_plan(d, &query_, ranges_.data(), ranges_.size(), &count);
      if (status != L4D_OK) return status;
      if (count == 0) return slice(d);
      for (uint64_t k = 0; status == L4D_OK && k < std::min<uint64_t>(count, ranges_.size()); ++k) {
        const l4d_planned_range& r = ranges_[static_cast<size_t>(k)];
        status =
            l4d_decoder_supply(d, r.offset, file_.data() + r.offset, static_cast<size_t>(r.size));
      }
    }
    return status == L4D_OK ? L4D_ERR_INTERNAL : status;
  }
  bool right() const { return got_ == visible_ && position_ == want_; }

 private:
  static constexpr size_t kGaussians = 4096;

  l4d_status slice(l4d_decoder* d) {
    std::fill(position_.begin(), position_.end(), 0.0F);
    l4d_splat_buffers splats;
    l4d_splat_buffers_init(&splats);
    splats.capacity = kGaussians;
    splats.position = position_.data();
    const l4d_status status = l4d_decoder_slice(d, 0, &splats);
    got_ = splats.count;
    return status;
  }

  const Bytes& file_;
  l4d_plan_query query_{};
  std::vector<l4d_planned_range> ranges_;
  std::vector<float> position_, want_;
  uint64_t visible_ = 0, got_ = 0;
};

class SupplyAllocations : public testing::TestWithParam<NamedFile> {};

TEST_P(SupplyAllocations, EachFailureLeavesTheHandleGood) {
  Player player(GetParam().bytes());
  l4d_decoder_options options = decoder_options(L4D_BACKEND_AUTO, 1);
  uint64_t refused = 0;
  for (const bool all_from : {false, true}) {
    for (uint64_t k = 1;; ++k) {
      const int64_t live = live_allocations();
      uint64_t failed = 0;
      {
        const DecoderHandle d(&options);
        l4d_status status;
        {
          AllocationFaults faults(k, all_from ? AllocationFaults::kNever : k);
          status = player.play(d.get());
          faults.stop();
          failed = faults.failed();
        }
        if (status == L4D_OK) {
          EXPECT_TRUE(player.right()) << "allocation " << k;
        } else {
          EXPECT_EQ(status, L4D_ERR_OUT_OF_MEMORY) << "allocation " << k;
          ++refused;
        }
        EXPECT_EQ(player.play(d.get()), L4D_OK) << "allocation " << k;
        EXPECT_TRUE(player.right()) << "allocation " << k;
      }
      EXPECT_EQ(live_allocations(), live) << "allocation " << k;
      if (failed == 0 || HasFailure()) break;
    }
  }
  EXPECT_GT(refused, 40u);
}

INSTANTIATE_TEST_SUITE_P(Files, SupplyAllocations,
                         testing::Values(NamedFile{"tiny", tiny_file},
                                         NamedFile{"dynamic", dynamic_file},
                                         NamedFile{"transform", transform_file}),
                         file_name);

}  // namespace
}  // namespace l4d
