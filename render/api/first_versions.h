// SPDX-License-Identifier: Apache-2.0
// The structs of render.h and of experimental/sensitivity.h, cuda_render.h, cuda_player.h and
// cuda_train.h, as their first version had them.
#pragma once

#include "l4d/experimental/cuda_player.h"
#include "l4d/experimental/cuda_train.h"
#include "l4d/experimental/sensitivity.h"
#include "libl4dcodec/base/first_versions.h"

namespace l4d::api {

L4D_FIRST_VERSION(l4d_renderer_options, max_memory_bytes);
L4D_FIRST_VERSION(l4d_camera, near_plane);
L4D_FIRST_VERSION(l4d_image, alpha);
L4D_FIRST_VERSION(l4d_gradients, sh);
L4D_FIRST_VERSION(l4d_sensitivity_options, seed);
L4D_FIRST_VERSION(l4d_process_group, user);
L4D_FIRST_VERSION(l4d_measure_options, group);
L4D_FIRST_VERSION(l4d_measure_report, unseen);
L4D_FIRST_VERSION(l4d_render_stats, seconds);

L4D_FIRST_VERSION(l4d_cuda_renderer_options, reserved);
L4D_FIRST_VERSION(l4d_cuda_frame_capacity, instances);
L4D_FIRST_VERSION(l4d_cuda_image, reserved);
L4D_FIRST_VERSION(l4d_cuda_frame_stats, seconds);

L4D_FIRST_VERSION(l4d_cuda_player_options, reserved);
L4D_FIRST_VERSION(l4d_cuda_player_counters, scratch_bytes);

L4D_FIRST_VERSION(l4d_cuda_trainable_rows, overflow);
L4D_FIRST_VERSION(l4d_cuda_trainable_view, alpha);
L4D_FIRST_VERSION(l4d_cuda_trainable_loss, error);
L4D_FIRST_VERSION(l4d_cuda_trainable_statistics, screen_gradient);
L4D_FIRST_VERSION(l4d_cuda_trainable_report, seconds);

}  // namespace l4d::api
