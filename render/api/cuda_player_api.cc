// SPDX-License-Identifier: Apache-2.0
// The C entry points of playing a stream on a device.
#include <algorithm>
#include <cmath>
#include <memory>

#include "l4d/experimental/cuda_player.h"
#include "libl4dcodec/base/c_api.h"
#include "render/api/device.h"
#include "render/api/first_versions.h"
#include "render/api/read_camera.h"
#include "render/cuda/player/bucket_feed.h"
#include "render/view/camera.h"

using l4d::Status;
using l4d::api::call_on;
using l4d::api::fail_without_handle;
using l4d::api::guard;
using l4d::api::keep_last;
using l4d::api::optional;
using l4d::api::read_camera;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;
using l4d::render::BucketFeed;

struct l4d_cuda_player {
  explicit l4d_cuda_player(const l4d_cuda_player_options& options) : player(options) {}
  mutable l4d::render::Player player;
  mutable l4d::api::Busy busy;
};

namespace {

template <typename Body>
l4d_status call(const l4d_cuda_player* handle, const char* bad, const Body& body) {
  return call_on(handle, bad, [&] { return on_device(handle->player, body); });
}

// Calls that are allowed while another one runs. The engine keeps its failures for last_error.
template <typename Body>
l4d_status call_beside(const l4d_cuda_player* handle, const char* bad, const Body& body) {
  if (handle == nullptr) return fail_without_handle();
  l4d_status status = L4D_OK;
  const Status failure = guard([&]() -> Status {
    if (bad != nullptr) return l4d::invalid_argument(bad);
    return on_device(handle->player, [&](auto& p) -> Status {
      status = body(p.feed());
      return {};
    });
  });
  return failure.ok() ? status : keep_last(failure);
}

}  // namespace

l4d_status l4d_cuda_player_create(const l4d_cuda_player_options* options, l4d_cuda_player** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(options)) return l4d::invalid_argument(bad);
    if (const char* bad = required(out)) return l4d::invalid_argument(bad);
    *out = nullptr;
    const l4d_cuda_player_options o = read_struct(*options);
    if (const char* bad = optional(o.reader)) return l4d::invalid_argument(bad);
    if (const char* bad = optional(o.playback)) return l4d::invalid_argument(bad);
    if ((o.reader == nullptr) == (o.uri == nullptr)) {
      return l4d::invalid_argument("a player plays either a reader or a uri");
    }
    if (o.sh_float32 > 1 || o.device > 4096 || o.point.detail > L4D_DETAIL_BASE_COLOR ||
        o.no_read_ahead > 1 || o.automatic > 1 || o.no_wait > 1) {
      return l4d::invalid_argument("an option of the player is out of range");
    }
    auto handle = std::make_unique<l4d_cuda_player>(o);
    L4D_RETURN_IF_ERROR(on_device(handle->player, [](auto& p) { return p.create(); }));
    *out = handle.release();
    return {};
  }));
}
void l4d_cuda_player_destroy(l4d_cuda_player* player) {
  if (l4d::api::may_destroy(player)) delete player;
}
l4d_status l4d_cuda_player_reserve(l4d_cuda_player* player, uint32_t width, uint32_t height,
                                   uint64_t instances) {
  return call(player, nullptr, [&](auto& p) -> Status {
    L4D_RETURN_IF_ERROR(l4d::render::check_image_size(width, height));
    return p.reserve(width, height, instances);
  });
}
l4d_status l4d_cuda_player_seek(l4d_cuda_player* player, double time) {
  return call(player, nullptr, [&](auto& p) -> Status {
    if (std::isnan(time)) return l4d::invalid_argument("the time is not a number");
    return p.seek(time);
  });
}
l4d_status l4d_cuda_player_render(l4d_cuda_player* player, double time, const l4d_camera* camera,
                                  const l4d_cuda_image* image, void* stream) {
  return call(player, required(camera, image), [&](auto& p) -> Status {
    const l4d_camera c = read_camera(*camera);
    L4D_RETURN_IF_ERROR(l4d::render::check_camera(c));
    if (std::isnan(time)) return l4d::invalid_argument("the time is not a number");
    const l4d_cuda_image i = read_struct(*image);
    L4D_RETURN_IF_ERROR(l4d::render::check_background(i.background));
    return p.render(time, c, i.background, {i.rgb, i.alpha, i.rgba8}, stream);
  });
}
l4d_status l4d_cuda_player_get_stats(l4d_cuda_player* player, void* stream,
                                     l4d_cuda_frame_stats* stats) {
  return call(player, required(stats), [&](auto& p) -> Status {
    l4d_cuda_frame_stats out{};
    const Status status = p.stats(stream, &out);
    if (!status.ok() && status.code() != L4D_ERR_LIMIT_EXCEEDED) return status;
    write_struct(out, stats);
    return status;
  });
}
l4d_status l4d_cuda_player_get_counters(const l4d_cuda_player* player,
                                        l4d_cuda_player_counters* counters) {
  return call(player, required(counters), [&](auto& p) -> Status {
    write_struct(p.counters(), counters);
    return {};
  });
}

// ---- link: beside other calls ------------------------------------------------------------------

l4d_status l4d_cuda_player_take(l4d_cuda_player* player, l4d_playback_item* items,
                                uint32_t capacity, uint32_t* count) {
  const char* bad = required(count);
  if (bad == nullptr && capacity > 0) bad = required(items);
  return call_beside(player, bad, [&](BucketFeed& feed) {
    *count = feed.take(items, capacity);
    return L4D_OK;
  });
}
l4d_status l4d_cuda_player_answered(l4d_cuda_player* player, uint32_t id,
                                    const l4d_answer* answer) {
  return call_beside(player, nullptr, [&](BucketFeed& f) { return f.answered(id, answer); });
}
l4d_status l4d_cuda_player_received(l4d_cuda_player* player, uint32_t id, const void* data,
                                    size_t n) {
  return call_beside(player, nullptr, [&](BucketFeed& f) { return f.received(id, data, n); });
}
l4d_status l4d_cuda_player_finished(l4d_cuda_player* player, uint32_t id, uint32_t outcome) {
  return call_beside(player, nullptr, [&](BucketFeed& f) { return f.finished(id, outcome); });
}
l4d_status l4d_cuda_player_set_rate(l4d_cuda_player* player, double rate) {
  return call_beside(player, nullptr, [&](BucketFeed& f) { return f.set_rate(rate); });
}
l4d_status l4d_cuda_player_get_state(const l4d_cuda_player* player, l4d_playback_state* state) {
  return call_beside(player, required(state), [&](BucketFeed& feed) {
    write_struct(feed.state(), state);
    return L4D_OK;
  });
}
