// SPDX-License-Identifier: Apache-2.0
// Profile and level of an open stream, from its headers and directory.
#pragma once

#include <functional>
#include <memory>

#include "decoder/read/scene_file.h"
#include "libl4dcodec/container/level_meter.h"

namespace l4d {

// A meter that has seen the whole directory, and the memory it takes.
struct StreamDemand {
  explicit StreamDemand(SceneFile& file) : memory(file.memory()), meter(file.header()) {}
  MemoryCharge memory;
  LevelMeter meter;
};
Status measure_stream_demand(SceneFile& file, StreamDemand* out);

// Reports what a stream breaks of a profile and a level, 0 = not asked. An id that is not known is
// reported too.
Status check_conformance(SceneFile& file, uint32_t profile, uint32_t level,
                         const std::function<void(const Status&)>& report);

}  // namespace l4d
