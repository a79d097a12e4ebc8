// SPDX-License-Identifier: Apache-2.0
// experimental/inspect.hpp: what experimental/inspect.h says of a stream, for C++.
#ifndef L4D_EXPERIMENTAL_INSPECT_HPP
#define L4D_EXPERIMENTAL_INSPECT_HPP

#include "l4d/decode.hpp"
#include "l4d/experimental/inspect.h"

namespace l4d {

inline l4d_coding_errors coding_errors(const DecoderHandle& decoder) {
  l4d_coding_errors e = L4D_INIT(l4d_coding_errors);
  decoder.check(l4d_decoder_get_coding_errors(decoder.get(), &e));
  return e;
}

// What playing the stream asks for over a link of `bytes_per_second`, with `burst_bytes` buffered.
inline l4d_stream_demand stream_demand(const DecoderHandle& decoder, uint64_t bytes_per_second = 0,
                                       uint64_t burst_bytes = 0) {
  l4d_stream_demand d = L4D_INIT(l4d_stream_demand);
  d.bytes_per_second = bytes_per_second;
  d.burst_bytes = burst_bytes;
  decoder.check(l4d_decoder_get_stream_demand(decoder.get(), &d));
  return d;
}

}  // namespace l4d
#endif  // L4D_EXPERIMENTAL_INSPECT_HPP
