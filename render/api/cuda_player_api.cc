// SPDX-License-Identifier: Apache-2.0
// The C entry points of playing a stream on a device.
#include <algorithm>
#include <cmath>
#include <memory>

#include "l4d/cuda_player.h"
#include "libl4dcodec/base/c_api.h"
#include "render/api/first_versions.h"
#include "render/cuda/player/device_player.h"
#include "render/view/camera.h"

using l4d::Status;
using l4d::api::call_on;
using l4d::api::ErrorMessage;
using l4d::api::guard;
using l4d::api::init_struct;
using l4d::api::keep_last;
using l4d::api::look_at;
using l4d::api::optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;
using l4d::render::default_camera;

struct l4d_cuda_player {
  std::unique_ptr<l4d::render::DevicePlayer> player;
  mutable l4d::api::Busy busy;
  ErrorMessage error;
};

namespace {

l4d_cuda_player_options default_options() {
  l4d_cuda_player_options options{};
  options.sh_format = L4D_CUDA_SH_FLOAT16;
  options.max_level = UINT32_MAX;
  options.max_tier = UINT32_MAX;
  options.read_ahead = 1;
  return options;
}

template <typename Body>
l4d_status call(l4d_cuda_player* handle, const char* bad, const Body& body) {
  return call_on(handle, bad, [&] { return body(*handle->player); });
}

}  // namespace

void l4d_cuda_player_options_init_(l4d_cuda_player_options* options, size_t struct_size) {
  init_struct(options, struct_size, default_options());
}
void l4d_cuda_player_counters_init_(l4d_cuda_player_counters* counters, size_t struct_size) {
  init_struct(counters, struct_size, l4d_cuda_player_counters{});
}

l4d_status l4d_cuda_player_create(l4d_decoder* decoder, const l4d_cuda_player_options* options,
                                  l4d_cuda_player** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = required(decoder, out)) return l4d::invalid_argument(bad);
    if (const char* bad = optional(options)) return l4d::invalid_argument(bad);
    const l4d_cuda_player_options o =
        options == nullptr ? default_options() : read_struct(*options, default_options());
    if (o.sh_format > L4D_CUDA_SH_FLOAT16 || o.device > 4096 || o.detail > L4D_DETAIL_BASE_COLOR ||
        o.read_ahead > 1 || !(o.window >= 0 && std::isfinite(o.window))) {
      return l4d::invalid_argument("an option of the player is out of range");
    }
    auto handle = std::make_unique<l4d_cuda_player>();
    L4D_RETURN_IF_ERROR(l4d::render::make_device_player(decoder, o, &handle->player));
    *out = handle.release();
    return {};
  }));
}
void l4d_cuda_player_destroy(l4d_cuda_player* player) {
  if (l4d::api::may_destroy(player)) delete player;
}
const char* l4d_cuda_player_error_message(const l4d_cuda_player* player) {
  return player == nullptr ? "" : player->error.c_str();
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
    const l4d_camera c = read_struct(*camera, default_camera());
    L4D_RETURN_IF_ERROR(l4d::render::check_camera(c));
    if (std::isnan(time)) return l4d::invalid_argument("the time is not a number");
    const l4d_cuda_image i = read_struct(*image, l4d_cuda_image{});
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
  return look_at(player, required(counters), [&]() -> Status {
    write_struct(player->player->counters(), counters);
    return {};
  });
}
