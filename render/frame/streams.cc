// SPDX-License-Identifier: Apache-2.0
#include "render/frame/streams.h"

namespace l4d::render {

void Streams::set(l4d_decoder* const* decoders, const double* shifts, size_t count,
                  const l4d_operating_point& point) {
  restart();
  point_ = point;
  streams_.clear();
  shifts_.clear();
  for (size_t k = 0; k < count; ++k) {
    streams_.push_back({decoders[k], 0});
    shifts_.push_back(shifts == nullptr ? 0 : shifts[k]);
  }
}

Status Streams::slice(double time, MemoryBudget& memory, Frame<float>* out) {
  for (size_t k = 0; k < streams_.size(); ++k) streams_[k].time = time - shifts_[k];
  return slice_streams(streams_, point_, memory, &still_key_, out);
}

}  // namespace l4d::render
