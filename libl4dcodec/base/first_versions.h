// SPDX-License-Identifier: Apache-2.0
// The structs of decode.h and cuda.h, as their first version had them.
#pragma once

#include "l4d/cuda.h"
#include "l4d/decode.h"
#include "l4d/experimental/columns.h"
#include "l4d/experimental/copy.h"
#include "l4d/experimental/cuda_packed.h"
#include "l4d/experimental/inspect.h"
#include "l4d/members.h"
#include "l4d/playback.h"
#include "libl4dcodec/base/c_api.h"

namespace l4d::api {

L4D_FIRST_VERSION(l4d_decoder_options, progress_user);
L4D_FIRST_VERSION(l4d_info, level);
L4D_FIRST_VERSION(l4d_coding_errors, min_size);
L4D_FIRST_VERSION(l4d_layer_info, num_coefficients);
L4D_FIRST_VERSION(l4d_query, num_buckets);
L4D_FIRST_VERSION(l4d_selection, sh_bytes);
L4D_FIRST_VERSION(l4d_gaussian_buffers, id);
L4D_FIRST_VERSION(l4d_packed_buffers, num_spans);
L4D_FIRST_VERSION(l4d_codebook, dim);
L4D_FIRST_VERSION(l4d_dequantization, log_scale_t);
L4D_FIRST_VERSION(l4d_level_limits, symbols_per_second);
L4D_FIRST_VERSION(l4d_stream_demand, min_symbols_per_second);
L4D_FIRST_VERSION(l4d_splat_buffers, point);
L4D_FIRST_VERSION(l4d_splat_columns, point);
L4D_FIRST_VERSION(l4d_counters, details_lost);

L4D_FIRST_VERSION(l4d_playback_options, stale_after);
L4D_FIRST_VERSION(l4d_quality, network);
L4D_FIRST_VERSION(l4d_answer, retry_after);
L4D_FIRST_VERSION(l4d_playback_state, reserved);

L4D_FIRST_VERSION(l4d_member, sequence_end);
L4D_FIRST_VERSION(l4d_members_options, ignore_index);
L4D_FIRST_VERSION(l4d_members_info, rest);
L4D_FIRST_VERSION(l4d_member_parameters, tiers);

L4D_FIRST_VERSION(l4d_cuda_device_info, memory_bytes);
L4D_FIRST_VERSION(l4d_cuda_request, workspace_bytes);
L4D_FIRST_VERSION(l4d_cuda_gaussian_buffers, sh);
L4D_FIRST_VERSION(l4d_cuda_packed_buffers, component);

}  // namespace l4d::api
