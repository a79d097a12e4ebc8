// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "l4d/experimental/inspect.h"
#include "l4d/l4d.hpp"

namespace l4d::eval {

// A scene in memory, and how its stream arranges it.
struct DecodedScene {
  std::shared_ptr<void> memory;  // of a stream: what its arrays are counted as
  io::Scene scene;
  std::vector<double> mean_t;          // of a stream: where scene's are rounded; seconds
  std::vector<l4d_bucket_span> spans;  // of a stream; empty for other scenes
  std::vector<uint32_t> levels;        // of a stream: temporal level of each layer
  std::vector<bool> permanent;         // of a stream: whether each layer's Gaussians never fade
  l4d_coding_errors stated{};          // of a stream: what it states of itself
};

// Reads all of an open stream, or what `query` selects. Throws Error.
DecodedScene decode_scene(const DecoderHandle& decoder, const l4d_query* query = nullptr,
                          const io::Hold& holder = {});

// Moves the times of a scene by `shift` seconds, and leaves of its sequence what is between `begin`
// and `end`, seconds of the sequence: the scene then has the times at which it is presented.
// Gaussians whose flat window lies elsewhere are dropped.
void present(double begin, double end, double shift, DecodedScene* loaded);

// From `begin` to `end` at the frame rate of `like`: whole frames, the last of which may be cut.
l4d_timeline timeline_between(const l4d_timeline& like, double begin, double end);

// Bytes that the arrays of a slice take at most, with rows of SH of `sh_degree`.
uint64_t slice_bytes(const DecoderHandle& decoder, double seconds, uint32_t sh_degree);

}  // namespace l4d::eval
