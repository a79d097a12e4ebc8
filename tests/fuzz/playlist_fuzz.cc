// SPDX-License-Identifier: Apache-2.0
// Any text as the playlist of the playback engine, at first a part of it and later all, over any
// bytes as the file of its members. Whatever they say, the engine settles: it ends its seeks, and
// asks for nothing more until it looks at the playlist or at what is lost again.
#include <algorithm>
#include <cstdlib>
#include <string>
#include <vector>

#include "l4d/playback.h"
#include "libl4dcodec/base/bytes.h"
#include "tests/hostile/session.h"

namespace {

using l4d::Bytes;

constexpr size_t kControlBytes = 6;
constexpr int kMostTurns = 400;

void require(bool holds) {
  if (!holds) std::abort();
}
void check(l4d_status status) { require(status == L4D_OK || status == L4D_ERR_OUT_OF_MEMORY); }

struct Viewer {
  std::string text;
  Bytes file;
  size_t seen = 0;  // bytes of the text that the first answer has
  bool first = true;
  l4d_playback* playback = nullptr;
  double now = 0;
  std::vector<l4d_playback_item> requests;
  uint32_t ended = 0;  // seeks
  l4d_playback_state state = L4D_INIT(l4d_playback_state);

  void take(const l4d_playback_item& item) {
    const char* uri = nullptr;
    switch (item.kind) {
      case L4D_ITEM_REQUEST:
        require(l4d_playback_get_uri(playback, item.source, &uri) == L4D_OK && uri != nullptr);
        requests.push_back(item);
        break;
      case L4D_ITEM_CANCEL:
        requests.erase(std::remove_if(requests.begin(), requests.end(),
                                      [&](const auto& r) { return r.id == item.id; }),
                       requests.end());
        break;
      case L4D_ITEM_EVENT:
        ended += item.event == L4D_EVENT_SHOWN || item.event == L4D_EVENT_REPLACED ||
                 item.event == L4D_EVENT_FAILED;
        break;
      default:
        require(item.kind == L4D_ITEM_UNLOAD);  // the engine loads itself
    }
  }
  void update() {
    check(l4d_playback_update(playback, now));
    l4d_playback_item items[16];
    uint32_t count = 16;
    while (count == 16) {
      check(l4d_playback_take(playback, items, 16, &count));
      std::for_each(items, items + count, [&](const l4d_playback_item& item) { take(item); });
    }
    check(l4d_playback_get_state(playback, &state));
    require(state.wake_at >= now && state.ready_from <= state.ready_until);
    require(state.begin <= state.end);
  }
  void answer() {
    const l4d_playback_item request = requests.front();
    requests.erase(requests.begin());
    l4d_answer head = L4D_INIT(l4d_answer);
    const bool is_list = (request.flags & L4D_REQUEST_PLAYLIST) != 0;
    const auto* const bytes =
        is_list ? reinterpret_cast<const unsigned char*>(text.data()) : file.data();
    const uint64_t size = !is_list ? file.size() : first ? seen : text.size();
    first = first && !is_list;
    const uint64_t begin = is_list ? 0 : std::min<uint64_t>(request.offset, size);
    const uint64_t left = size - begin;
    const uint64_t n = is_list || request.size == 0 ? left : std::min(left, request.size);
    head.status = is_list ? 200 : n > 0 ? 206 : 416;
    head.offset = begin;
    head.total_bytes = size;
    check(l4d_playback_answered(playback, now, request.id, &head));
    check(l4d_playback_received(playback, now, request.id, bytes + begin, static_cast<size_t>(n)));
    check(l4d_playback_finished(playback, now, request.id, L4D_TRANSFER_ENDED));
  }
  // Answers and waits for so many seconds.
  void run(double seconds) {
    const double end = now + seconds;
    for (int turn = 0; turn < kMostTurns; ++turn) {
      update();
      if (!requests.empty()) {
        answer();
      } else if (state.wake_at < end) {
        now = state.wake_at;
      } else {
        break;
      }
    }
    now = std::max(now, end);
  }
  void list() {
    l4d_shown_member shown[8];
    l4d_playback_loss losses[8];
    uint64_t count = 0;
    check(l4d_playback_get_shown(playback, state.begin, state.end, shown, 8, &count));
    for (uint64_t k = 0; k < std::min<uint64_t>(count, 8); ++k)
      require(shown[k].begin <= shown[k].end);
    check(l4d_playback_get_losses(playback, losses, 8, &count));
  }
};

}  // namespace

// How much of the text is seen at first, where a seek goes, how long its bytes are, then the text
// and the file.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < kControlBytes) return 0;
  const size_t rest = size - kControlBytes;
  const size_t length = std::min(size_t{data[2]} | size_t{data[3]} << 8, rest);
  Viewer viewer;
  const uint8_t* const text = data + kControlBytes;
  viewer.text.assign(reinterpret_cast<const char*>(text), length);
  viewer.file.assign(text + length, text + rest);
  viewer.seen = length * (data[0] + size_t{1}) / 256;
  l4d_playback_options options = L4D_INIT(l4d_playback_options);
  options.strict = data[5] & 1;
  options.byte_pool_bytes = 1 << 20;
  options.max_memory_bytes = l4d::test::kSessionMemory;
  require(l4d_playback_create(&options, &viewer.playback) == L4D_OK);
  check(l4d_playback_open(viewer.playback, 0, "list.m3u8", L4D_OPEN_PLAYLIST, 0));
  viewer.run(2);
  viewer.list();
  check(l4d_playback_seek(viewer.playback, viewer.now, data[1] / 16.0, 0, 1));
  check(l4d_playback_play(viewer.playback, viewer.now));
  viewer.run(60);
  viewer.list();
  require(viewer.state.memory_bytes <= 2 * l4d::test::kSessionMemory + (uint64_t{2} << 20));
  check(l4d_playback_close(viewer.playback, viewer.now));
  viewer.update();
  require(viewer.ended == 1);
  l4d_playback_destroy(viewer.playback);
  return 0;
}
