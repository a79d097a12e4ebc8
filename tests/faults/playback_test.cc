// SPDX-License-Identifier: Apache-2.0
// Memory that runs out at any allocation of a playback engine: an error, nothing leaks, and the
// engine goes on when there is memory again.
#include "l4d/playback.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/common/codec.h"
#include "tests/faults/failing_new.h"

namespace l4d {
namespace {

using namespace test;

constexpr size_t kGaussians = 4096;

// A player of one instant, with arrays that are made once.
class Player {
 public:
  // is_playlist: the file is a member, twice.
  Player(const Bytes& file, bool is_playlist) : file_(file), position_(3 * kGaussians) {
    if (is_playlist) list_ = list_of(file.size());
    l4d_playback* p = nullptr;
    EXPECT_EQ(l4d_playback_create(nullptr, &p), L4D_OK);
    EXPECT_EQ(play(p), L4D_OK);
    want_ = position_;
    visible_ = got_;
    l4d_playback_destroy(p);
  }
  bool is_open() const { return opened_; }
  bool right() const { return got_ == visible_ && position_ == want_; }

  // Until the first call fails, or the instant is shown.
  l4d_status play(l4d_playback* p) {
    const uint32_t kind = list_.empty() ? L4D_OPEN_STREAM : L4D_OPEN_PLAYLIST;
    l4d_status status = l4d_playback_open(p, now_, "file", kind, list_.empty() ? file_.size() : 0);
    opened_ = status == L4D_OK;
    if (status == L4D_OK) status = l4d_playback_seek(p, now_, 0.5, 0, 1);
    return status == L4D_OK ? go_on(p) : status;
  }
  l4d_status go_on(l4d_playback* p) {
    l4d_playback_state state = L4D_INIT(l4d_playback_state);
    for (int round = 0; round < 2000; ++round) {
      l4d_status status = l4d_playback_update(p, now_);
      uint32_t count = 1;
      l4d_playback_item item{};
      while (status == L4D_OK && count > 0) {
        status = l4d_playback_take(p, &item, 1, &count);
        if (status == L4D_OK && count > 0) status = answer(p, item);
      }
      if (status == L4D_OK) status = l4d_playback_get_state(p, &state);
      if (status != L4D_OK) return status;
      if (state.ready != 0) return slice(p, state.anchor_time);
      now_ = state.wake_at < now_ + 100 ? state.wake_at : now_ + 0.01;
    }
    return L4D_ERR_INTERNAL;
  }

 private:
  static std::string list_of(size_t bytes) {
    const std::string range = "#EXT-X-BYTERANGE:" + std::to_string(bytes) + "@0\nfile\n";
    return "#EXTM3U\n#EXT-X-TARGETDURATION:1\n"
           "#EXT-X-L4D-MEMBER:NUMBER=1,BEGIN=0,SHIFT=0\n#EXTINF:1,\n" +
           range + "#EXT-X-L4D-MEMBER:NUMBER=2,BEGIN=1,SHIFT=1\n#EXTINF:1,\n" + range +
           "#EXT-X-ENDLIST\n";
  }
  l4d_status answer(l4d_playback* p, const l4d_playback_item& item) {
    if (item.kind != L4D_ITEM_REQUEST) return L4D_OK;
    const bool is_list = (item.flags & L4D_REQUEST_PLAYLIST) != 0;
    const void* const from =
        is_list ? static_cast<const void*>(list_.data()) : file_.data() + item.offset;
    const size_t n = is_list ? list_.size() : static_cast<size_t>(item.size);
    const l4d_status status = l4d_playback_received(p, now_, item.id, from, n);
    return status == L4D_OK ? l4d_playback_finished(p, now_, item.id, L4D_TRANSFER_ENDED) : status;
  }
  l4d_status slice(l4d_playback* p, double time) {
    std::fill(position_.begin(), position_.end(), 0.0F);
    l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
    splats.capacity = kGaussians;
    splats.position = position_.data();
    const l4d_status status = l4d_playback_slice(p, time, &splats);
    got_ = splats.count;
    return status;
  }

  const Bytes& file_;
  std::string list_;
  std::vector<float> position_, want_;
  uint64_t visible_ = 0, got_ = 0;
  double now_ = 0;
  bool opened_ = false;
};

class PlaybackAllocations : public testing::TestWithParam<NamedFile> {
 protected:
  void fail_each(bool is_playlist);
};

void PlaybackAllocations::fail_each(bool is_playlist) {
  Player player(GetParam().bytes(), is_playlist);
  uint64_t refused = 0;
  for (const bool all_from : {false, true}) {
    for (uint64_t k = 1;; ++k) {
      const int64_t live = live_allocations();
      uint64_t failed = 0;
      {
        l4d_playback* p = nullptr;
        ASSERT_EQ(l4d_playback_create(nullptr, &p), L4D_OK);
        l4d_status status;
        {
          AllocationFaults faults(k, all_from ? AllocationFaults::kNever : k);
          status = player.play(p);
          faults.stop();
          failed = faults.failed();
        }
        if (status == L4D_OK) {
          EXPECT_TRUE(player.right()) << "allocation " << k;
        } else {
          EXPECT_EQ(status, L4D_ERR_OUT_OF_MEMORY) << "allocation " << k;
          ++refused;
          // What was requested and never came is requested again.
          if (player.is_open()) {
            EXPECT_EQ(player.go_on(p), L4D_OK) << "allocation " << k;
          }
        }
        EXPECT_EQ(player.play(p), L4D_OK) << "allocation " << k;
        EXPECT_TRUE(player.right()) << "allocation " << k;
        l4d_playback_destroy(p);
      }
      EXPECT_EQ(live_allocations(), live) << "allocation " << k;
      if (failed == 0 || HasFailure()) break;
    }
  }
  EXPECT_GT(refused, 40u);
}

TEST_P(PlaybackAllocations, EachFailureLeavesTheEngineGood) { fail_each(false); }

TEST_P(PlaybackAllocations, EachFailureOfAPlaylistLeavesTheEngineGood) { fail_each(true); }

INSTANTIATE_TEST_SUITE_P(Files, PlaybackAllocations,
                         testing::Values(NamedFile{"tiny", tiny_file},
                                         NamedFile{"dynamic", dynamic_file}),
                         file_name);

}  // namespace
}  // namespace l4d
