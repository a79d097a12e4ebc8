// SPDX-License-Identifier: Apache-2.0
// Any file behind the playback engine (playback.h), with a user and a link that do what the input
// says: seeks, rates and qualities, answers that are cut, late, wrong or of another kind. Then all
// answers are those of the file, and everything comes to an end.
#include <cmath>
#include <cstdlib>
#include <vector>

#include "l4d/playback.h"
#include "tests/fuzz/stream_mutator.h"
#include "tests/hostile/session.h"

namespace {

using namespace l4d;

constexpr size_t kSteps = 16;
constexpr size_t kControlBytes = 2 + 4 * kSteps;
constexpr int kMostTurns = 3000;

void require(bool holds) {
  if (!holds) std::abort();
}

struct Player {
  explicit Player(const Bytes& bytes) : file(bytes) {}
  const Bytes& file;
  l4d_playback* playback = nullptr;
  double now = 0;
  std::vector<l4d_playback_item> requests;
  uint32_t seeks = 0, seeks_ended = 0;
  l4d_playback_state state = L4D_INIT(l4d_playback_state);

  void check(l4d_status status) { require(status == L4D_OK || status == L4D_ERR_OUT_OF_MEMORY); }
  void load(const l4d_playback_item& item) {
    l4d_decoder* decoder = nullptr;
    l4d_status status = l4d_playback_get_decoder(playback, 0, &decoder);
    require(status == L4D_OK);
    const l4d_bucket bucket = {item.layer, item.bucket};
    l4d_query query = L4D_INIT(l4d_query);
    query.kind = L4D_QUERY_BUCKETS;
    query.buckets = &bucket;
    query.num_buckets = 1;
    query.point.detail = item.detail;
    l4d_selection selection = L4D_INIT(l4d_selection);
    status = l4d_decoder_select(decoder, &query, &selection);
    std::vector<float> position;
    l4d_gaussian_buffers out = L4D_INIT(l4d_gaussian_buffers);
    if (status == L4D_OK) {
      position.resize(3 * static_cast<size_t>(selection.num_gaussians));
      out.capacity = selection.num_gaussians;
      out.position = position.data();
      status = l4d_decoder_decode(decoder, &query, &out);
    }
    require(status != L4D_ERR_INTERNAL && status != L4D_ERR_INVALID_ARGUMENT);
    check(l4d_playback_loaded(playback, now, item.id, out.count, status));
  }
  void update() {
    check(l4d_playback_update(playback, now));
    l4d_playback_item items[16];
    uint32_t count = 16;
    while (count == 16) {
      check(l4d_playback_take(playback, items, 16, &count));
      for (uint32_t i = 0; i < count; ++i) take(items[i]);
    }
    check(l4d_playback_get_state(playback, &state));
    // A bucket that was loaded at once has changed what there is to do.
    require(state.wake_at >= now && state.ready_from <= state.ready_until);
  }
  void take(const l4d_playback_item& item) {
    if (item.kind == L4D_ITEM_REQUEST) requests.push_back(item);
    if (item.kind == L4D_ITEM_LOAD) load(item);
    if (item.kind == L4D_ITEM_CANCEL) {
      for (size_t k = 0; k < requests.size(); ++k) {
        if (requests[k].id == item.id) requests.erase(requests.begin() + static_cast<long>(k--));
      }
    }
    if (item.kind == L4D_ITEM_EVENT &&
        (item.event == L4D_EVENT_SHOWN || item.event == L4D_EVENT_REPLACED ||
         item.event == L4D_EVENT_FAILED)) {
      ++seeks_ended;
    }
  }
  // step: null for an honest answer.
  void answer(const uint8_t* step) {
    if (requests.empty()) return;
    const size_t which = step == nullptr ? 0 : step[3] % requests.size();
    const l4d_playback_item request = requests[which];
    requests.erase(requests.begin() + static_cast<long>(which));
    const uint8_t kind = step == nullptr ? 0 : step[1] % 8;
    l4d_answer head = L4D_INIT(l4d_answer);
    const bool whole = (request.flags & L4D_REQUEST_WHOLE) != 0 || kind == 1;
    head.status = whole ? 200 : 206;
    head.offset = whole ? 0 : request.offset;
    head.total_bytes = file.size();
    if (!whole && request.offset >= file.size()) head.status = 416;
    if (kind == 2) head.status = 503;
    if (kind == 3) head.version = step[2];
    if (kind == 4) head.total_bytes = step[2];
    check(l4d_playback_answered(playback, now, request.id, &head));
    const uint64_t begin = std::min<uint64_t>(head.offset, file.size());
    uint64_t n = file.size() - begin;
    if (!whole) n = std::min(n, request.size);
    if (kind == 5) n = n * step[2] / 256;
    Bytes bytes(file.begin() + static_cast<long>(begin),
                file.begin() + static_cast<long>(begin + n));
    if (kind == 6 && n > 0) bytes[step[2] * n / 256] ^= 1;
    check(l4d_playback_received(playback, now, request.id, bytes.data(), bytes.size()));
    check(l4d_playback_finished(playback, now, request.id, kind == 7 ? L4D_TRANSFER_FAILED : 0));
  }
  void act(const uint8_t* step) {
    l4d_quality quality = L4D_INIT(l4d_quality);
    switch (step[0] % 8) {
      case 0:
        check(l4d_playback_play(playback, now));
        break;
      case 1:
        ++seeks;
        check(l4d_playback_seek(playback, now, step[1] / 32.0, (step[2] & 3) * 0.05, seeks));
        break;
      case 2:
        check(l4d_playback_set_rate(playback, now, (step[1] - 128) / 8.0));
        break;
      case 3:
        quality.point = {step[1] % 3u, step[2] % 4u, step[3] % 2u, 0};
        quality.fixed = step[3] >> 7;
        quality.network = step[3] / 2 % 4;
        check(l4d_playback_set_quality(playback, now, &quality));
        break;
      case 4:
        check(l4d_playback_set_range(playback, now, step[1] % 3, step[2] / 64.0, step[3] / 64.0));
        break;
      case 5:
        now += step[1] / 16.0;
        break;
      case 6:
        slice();
        break;
      default:
        answer(step);
    }
    update();
  }
  void slice() {
    l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
    const l4d_status status = l4d_playback_slice(playback, state.anchor_time, &splats);
    require(status != L4D_ERR_INTERNAL && status != L4D_ERR_INVALID_ARGUMENT);
    // Of a stream that is damaged although its hashes are right, a slice may say so.
    if (status == L4D_ERR_NEED_DATA) require(state.ready == 0);
  }
  void settle() {
    const l4d_quality all = L4D_INIT(l4d_quality);
    check(l4d_playback_set_quality(playback, now, &all));
    check(l4d_playback_pause(playback, now));
    // What is lost is tried again now and then, for ever.
    const double end = now + 1000;
    int turns = 0;
    for (; turns < kMostTurns; ++turns) {
      update();
      if (!requests.empty()) {
        answer(nullptr);
      } else if (state.wake_at < end) {
        now = state.wake_at;
      } else {
        break;
      }
    }
    require(turns < kMostTurns);
    require(state.stream != L4D_STREAM_OPENING);
    slice();
  }
};

}  // namespace

// Options, then steps of four bytes (which, and how), then a file.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < kControlBytes) return 0;
  const Bytes file(data + kControlBytes, data + size);
  if (file.empty()) return 0;
  l4d_playback_options options = L4D_INIT(l4d_playback_options);
  options.strict = data[0] & 1;
  options.loader = (data[0] >> 1) & 1;
  options.byte_pool_bytes = 1 << 20;
  options.max_memory_bytes = test::kSessionMemory;
  Player player(file);
  require(l4d_playback_create(&options, &player.playback) == L4D_OK);
  player.check(l4d_playback_open(player.playback, 0, "", L4D_OPEN_STREAM,
                                 (data[0] & 4) != 0 ? file.size() : 0));
  player.update();
  for (size_t i = 0; i < kSteps; ++i) player.act(data + 2 + 4 * i);
  player.settle();
  require(player.state.memory_bytes <= 2 * test::kSessionMemory + (uint64_t{2} << 20));
  player.check(l4d_playback_close(player.playback, player.now));
  player.update();
  require(player.seeks == player.seeks_ended);
  l4d_playback_destroy(player.playback);
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_input(data, size, max_size, kControlBytes, seed);
}
