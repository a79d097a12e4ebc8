// SPDX-License-Identifier: Apache-2.0
// The last look at a stream before anyone gets a byte of it.
#pragma once

#include <vector>

#include "encoder/layer/coded_scene.h"
#include "encoder/prepare/scene.h"
#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/container/scene_header.h"

namespace l4d {

// What the encoder takes its stream to decode to; its errors are measured on that.
struct ExpectedStream {
  const EncoderScene& scene;
  const CodedScene& coded;
  const PositionCoding& positions;
  const ScalarCoding& opacity;
  const std::vector<uint32_t>& order;  // input index of each Gaussian in decoded order
};

// Holds the stream that `chunks` make up against every rule that a validator checks, and geometry,
// times and opacities, as decoded from these bytes, against what is expected (null: nothing). Fails
// with INTERNAL, and the rule that is broken: an encoder must not write what no decoder takes
// (ENC-1), nor state errors of other numbers than a decoder has. threads: 0 = all.
Status check_written(const std::vector<Bytes>& chunks, const ExpectedStream* expected, int threads);

}  // namespace l4d
