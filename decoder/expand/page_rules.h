// SPDX-License-Identifier: Apache-2.0
// The rules about the Gaussians of a page that a decoder need not check (spec: DEC-3).
#pragma once

#include <vector>

#include "l4d/decode.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d {

// Holds the decoded Gaussians of a page, `record.num_gaussians` of them, against the bucket that
// the page lies in, and against its interval and box: LEVL-9, LAYR-1 or LAYR-3, DIR-9, DIR-10.
// rows: position, mean_t_double, log_scale and rotor, and of flat layers window. bucket: its center
// and width. symbols: of rANS, that the page consists of. scratch: kept from page to page.
Status check_page_rules(const SceneHeader& header, const LayerHeader& layer,
                        const PageRecord& record, const l4d_bucket_span& bucket,
                        const l4d_gaussian_buffers& rows, uint64_t symbols,
                        std::vector<Slice4D<double>>* scratch);

}  // namespace l4d
