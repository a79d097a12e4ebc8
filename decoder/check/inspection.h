// SPDX-License-Identifier: Apache-2.0
// What a whole stream is made of, and whether it keeps to the rules.
#pragma once

#include <functional>

#include "decoder/expand/page_decoder.h"
#include "decoder/read/scene_file.h"
#include "l4d/decode.h"
#include "l4d/experimental/inspect.h"

namespace l4d {

using ViolationFn = std::function<void(const Status&)>;

// As l4d_decoder_get_sections. sections: [L4D_SECTION_COUNT], layer_bytes: [num_layers] or null.
Status measure_sections(SceneFile& file, PageDecoder& pages, uint64_t* sections,
                        uint64_t* layer_bytes);

// As l4d_decoder_get_stream_demand. In and out: the link of *out is given.
Status inspect_stream_demand(SceneFile& file, l4d_stream_demand* out);

// As l4d_decoder_check_conformance. Fails with INVALID_ARGUMENT on unknown ids, which
// check_conformance() reports, since a stream may declare them.
Status check_requested_conformance(SceneFile& file, uint32_t profile, uint32_t level,
                                   const ViolationFn& report);

// Every check of the specification that a file and its members can fail; calls `report` for each.
Status validate_file(const l4d_reader& reader, const l4d_decoder_options& options,
                     const ViolationFn& report);

// A page as the validator has decoded it. Arrays are valid during the call.
struct CheckedPage {
  uint64_t first;  // of its Gaussians, in decoded order
  size_t count;
  const float* position;   // [count, 3]
  const double* mean_t;    // [count]
  const float* log_scale;  // [count, 4]
  const float* rotor;      // [count, 8]
  const float* opacity;    // [count]
  const float* sh;         // [count, (degree + 1)^2, 3]
};
using CheckedPageFn = std::function<void(const CheckedPage&)>;

// The checks of validate_file for one stream that was just written and has no extensions, on
// `threads` threads (0 = all). `report` and `page` are called on several of them at a time; each
// page once, violations outside pages up to once per thread.
Status validate_written(const l4d_reader& reader, int threads, const ViolationFn& report,
                        const CheckedPageFn& page);

}  // namespace l4d
