// SPDX-License-Identifier: Apache-2.0
// playback.hpp: playback.h for C++17. Functions that can fail throw l4d::Error.
#ifndef L4D_PLAYBACK_HPP
#define L4D_PLAYBACK_HPP

#include <string>
#include <vector>

#include "l4d/decode.hpp"
#include "l4d/playback.h"

namespace l4d {

class PlaybackHandle : public Handle<l4d_playback, l4d_playback_destroy> {
 public:
  explicit PlaybackHandle(const l4d_playback_options* options = nullptr)
      : Handle([&](l4d_playback** out) { return l4d_playback_create(options, out); }) {}

  // ---- commands
  void open(double now, const std::string& uri, uint64_t size = 0) {
    check(l4d_playback_open(get(), now, uri.c_str(), L4D_OPEN_STREAM, size));
  }
  void open_playlist(double now, const std::string& uri) {
    check(l4d_playback_open(get(), now, uri.c_str(), L4D_OPEN_PLAYLIST, 0));
  }
  void open(double now, const l4d_reader& reader) {
    check(l4d_playback_open_reader(get(), now, &reader));
  }
  void close(double now) { check(l4d_playback_close(get(), now)); }
  void play(double now) { check(l4d_playback_play(get(), now)); }
  void pause(double now) { check(l4d_playback_pause(get(), now)); }
  void seek(double now, double time, double tolerance = 0, uint32_t id = 0) {
    check(l4d_playback_seek(get(), now, time, tolerance, id));
  }
  void set_rate(double now, double rate) { check(l4d_playback_set_rate(get(), now, rate)); }
  // mode: L4D_PLAY_*.
  void set_range(double now, uint32_t mode, double begin, double end) {
    check(l4d_playback_set_range(get(), now, mode, begin, end));
  }
  void set_quality(double now, const l4d_quality& quality) {
    check(l4d_playback_set_quality(get(), now, &quality));
  }
  void retry(double now) { check(l4d_playback_retry(get(), now)); }
  void refresh(double now) { check(l4d_playback_refresh(get(), now)); }

  // ---- running: reaches `now`, and returns what there is to do
  std::vector<l4d_playback_item> update(double now) {
    check(l4d_playback_update(get(), now));
    std::vector<l4d_playback_item> items;
    for (uint32_t count = kItems; count == kItems;) {
      const size_t before = items.size();
      items.resize(before + kItems);
      check(l4d_playback_take(get(), items.data() + before, kItems, &count));
      items.resize(before + count);
    }
    return items;
  }

  // ---- link
  void answered(double now, uint32_t id, const l4d_answer& answer) {
    check(l4d_playback_answered(get(), now, id, &answer));
  }
  void received(double now, uint32_t id, const void* data, size_t n) {
    check(l4d_playback_received(get(), now, id, data, n));
  }
  // outcome: L4D_TRANSFER_*.
  void finished(double now, uint32_t id, uint32_t outcome) {
    check(l4d_playback_finished(get(), now, id, outcome));
  }

  // ---- showing. The decoder is borrowed: see l4d_playback_get_decoder.
  l4d_decoder* decoder(uint32_t stream) {
    l4d_decoder* out = nullptr;
    check(l4d_playback_get_decoder(get(), stream, &out));
    return out;
  }
  void loaded(double now, uint32_t id, uint64_t units, l4d_status status = L4D_OK) {
    check(l4d_playback_loaded(get(), now, id, units, status));
  }
  // options.point does not count: the engine chooses what is shown.
  SplatArrays slice(double time, const SliceOptions& options = {}) const {
    return splats_of(state().sh_degree, options,
                     [&](l4d_splat_buffers* b) { check(l4d_playback_slice(get(), time, b)); });
  }

  // ---- state
  l4d_playback_state state() const {
    return detail::filled<l4d_playback_state>(
        [&](l4d_playback_state* s) { return l4d_playback_get_state(get(), s); });
  }
  std::vector<l4d_time_span> buffered() const {
    return detail::listed<l4d_time_span>([&](l4d_time_span* out, uint64_t n, uint64_t* count) {
      return l4d_playback_get_buffered(get(), out, n, count);
    });
  }
  std::vector<l4d_shown_member> shown(double begin, double end) const {
    return detail::listed<l4d_shown_member>(
        [&](l4d_shown_member* out, uint64_t n, uint64_t* count) {
          return l4d_playback_get_shown(get(), begin, end, out, n, count);
        });
  }
  std::vector<l4d_playback_loss> losses() const {
    return detail::listed<l4d_playback_loss>(
        [&](l4d_playback_loss* out, uint64_t n, uint64_t* count) {
          return l4d_playback_get_losses(get(), out, n, count);
        });
  }
  std::string uri(uint32_t source) const {
    const char* out = nullptr;
    check(l4d_playback_get_uri(get(), source, &out));
    return out;
  }

 private:
  static constexpr uint32_t kItems = 64;
};

}  // namespace l4d
#endif  // L4D_PLAYBACK_HPP
