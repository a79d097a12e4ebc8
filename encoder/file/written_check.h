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

// What the encoder takes its stream to decode to; its errors are measured on that. Of a lossless
// stream it is the scene as it was given, bit for bit, and what is between is not used.
struct ExpectedStream {
  const EncoderScene& scene;
  const CodedScene& coded;
  const PositionCoding& positions;
  const ScalarCoding& opacity;
  const ErrorStatement& errors;
  const std::vector<uint32_t>& order;  // input index of each Gaussian in decoded order
  bool lossless = false;
};

// Holds the stream that `chunks` make up against every rule that a validator checks. Geometry,
// times and opacities, as decoded from these bytes, must be what is expected (null: nothing), and
// colours no further from the scene than is stated. Fails with INTERNAL, and the rule that is
// broken: an encoder must not write what no decoder takes (ENC-1), nor state errors of other
// numbers than a decoder has. threads: 0 = all. This is no place for one more way to code a
// Gaussian: bounds are kept before, as far as the format can (layer_coder.h, color_bounds.h), and
// what fails here is a defect of the encoder.
Status check_written(const std::vector<Bytes>& chunks, const ExpectedStream* expected, int threads);

}  // namespace l4d
