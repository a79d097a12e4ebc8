// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "io/sequence/sequence.h"

namespace l4d::io {

// The Gaussians of one frame.
struct Frame {
  uint32_t sh_degree = 0;
  l4d_placement placement{};
  l4d_rendering rendering = default_rendering();
  l4d_presentation presentation = default_presentation();
  std::vector<float> position;     // [N, 3]
  std::vector<float> log_scale;    // [N, 3]
  std::vector<float> rotation;     // [N, 4] w x y z, length 1
  std::vector<float> opacity;      // [N] in [0, 1]
  std::vector<float> sh;           // [N, (D+1)^2, 3]
  std::vector<std::string> notes;  // of its reader
  std::shared_ptr<void> memory;
  size_t count() const { return opacity.size(); }
  size_t sh_numbers() const { return size_t{3} * (sh_degree + 1) * (sh_degree + 1); }
};

// A renderer draws nothing that is fainter.
constexpr float kLeastOpacity = 1.0F / 255;

// Reads the file of a frame. Fails with L4D_ERR_FEATURE_UNSUPPORTED if its Gaussians move or fade,
// and with L4D_ERR_INVALID_SCENE where one is no Gaussian.
Frame read_frame(const std::string& path, bool activated, const Hold& holder);

// Which row of the frame before each row of `now` goes on from: [N], kNoRow where it is new. No row
// is named twice. velocity: [M, 3] of the rows before, scene units a frame.
constexpr uint32_t kNoRow = UINT32_MAX;
std::vector<uint32_t> match_rows(const Frame& before, const std::vector<float>& velocity,
                                 const Frame& now, SequenceMatch match, bool* in_order);

}  // namespace l4d::io
