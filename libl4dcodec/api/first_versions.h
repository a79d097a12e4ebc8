// SPDX-License-Identifier: Apache-2.0
// The structs of decode.h that have grown since their first version.
#pragma once

#include "l4d/decode.h"
#include "libl4dcodec/base/c_api.h"

namespace l4d::api {

L4D_FIRST_VERSION(l4d_decoder_options, tolerant);
L4D_FIRST_VERSION(l4d_info, profile);
L4D_FIRST_VERSION(l4d_layer_info, coding);
L4D_FIRST_VERSION(l4d_query, detail);
L4D_FIRST_VERSION(l4d_selection, sh_bytes);
L4D_FIRST_VERSION(l4d_gaussian_buffers, mean_t_double);
L4D_FIRST_VERSION(l4d_dequantization, log_scale_t);
L4D_FIRST_VERSION(l4d_splat_buffers, sh_rows);
L4D_FIRST_VERSION(l4d_counters, pages_lost);

}  // namespace l4d::api
