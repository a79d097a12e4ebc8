// SPDX-License-Identifier: Apache-2.0
// What several streams show at an instant, as one: Gaussians of stream after stream, with rows of
// SH of one degree.
#pragma once

#include <cstdint>

#include "decoder/session/decoder.h"
#include "l4d/experimental/columns.h"

namespace l4d {

// Joins slices in the arrays of `out`. Output: l4d_splat_buffers or l4d_splat_columns.
template <typename Output>
class ShownStreams {
 public:
  // sh_degree: of the rows of SH, the highest of the streams. Still Gaussians are not known from
  // call to call.
  ShownStreams(uint32_t sh_degree, Output* out) : degree_(sh_degree), out_(out) {
    out_->count = out_->num_still = out_->still_key = 0;
  }
  // `time` is that of the stream. Once `out` is full, only counts.
  Status add(Decoder& decoder, double time);
  // Fails with BUFFER_TOO_SMALL if the capacity is below the count.
  Status finish() const;

 private:
  uint32_t degree_;
  bool is_full_ = false;
  Output* out_;
};

extern template class ShownStreams<l4d_splat_buffers>;
extern template class ShownStreams<l4d_splat_columns>;

}  // namespace l4d
