// SPDX-License-Identifier: Apache-2.0
// A scene header that uses every field, for tests that change one of them.
#pragma once

#include "libl4dcodec/container/scene_header.h"

namespace l4d::test {

inline ChunkRef example_chunk(uint64_t seed) {
  return {0x100 + seed * 0x1000, 0xabcdef0000000000u + seed, static_cast<uint32_t>(30 + seed),
          static_cast<uint32_t>(90 + seed), static_cast<uint32_t>(seed % 2)};
}

inline ComponentCoding example_vq(uint32_t entries, size_t stages, bool escapes, uint64_t seed) {
  ComponentCoding c;
  c.coding = ComponentCodingId::kVq;
  c.escapes = escapes;
  for (size_t s = 0; s < stages; ++s) {
    c.stages.push_back(
        {entries + static_cast<uint32_t>(s), ElementType::kF16, example_chunk(seed + s)});
  }
  return c;
}

// 60 frames at 30000/1001 Hz; layer 0 permanent, layer 1 of level 0, layer 2 of level 3 with RCQ.
inline SceneHeader example_header() {
  SceneHeader h;
  h.num_gaussians = 600;
  h.timeline = {12.5, 60, 30000, 1001, 0};
  h.gate = 9;
  h.placement = {
      {1e6, -2e6, 0.125}, 0.01, L4D_COORDINATES_RIGHT_DOWN_FORWARD, L4D_COLOR_LINEAR_SRGB};
  h.position_center[0] = 1.5f;
  h.position_center[1] = -2.25f;
  h.position_center[2] = 0;
  h.position_scale = 0.0009765625f;
  h.opacity = {ScalarCodingId::kSq, 8, 0.25f, 0.5f / 255};
  h.sh_degree = 2;
  h.sh = example_vq(300, 3, true, 1);
  h.payload_offset = 77777;
  h.metadata = {{"title", "caf\xc3\xa9"}, {"empty", ""}, {"title", "twice"}};
  h.layers.resize(3);
  for (unsigned i = 0; i < 3; ++i) {
    LayerHeader& l = h.layers[i];
    l.level = i == 2 ? 3 : 0;
    l.permanent = i == 0;
    l.num_gaussians = 100 * (i + 1);
    l.mean_t = i == 0 ? CoordinateCodingId::kNone : CoordinateCodingId::kF16;
    l.log_scale_t = i == 0 ? 4.5f : 0;
    l.scale_factor = {ScalarCodingId::kSq, 5 + i, -6.0f, 0.1f};
    l.component[L4D_COMPONENT_SCALE] = example_vq(40 + i, 1, false, 10 * i + 4);
    l.component[L4D_COMPONENT_ROTOR_SPATIAL] = example_vq(50 + i, 2, false, 10 * i + 5);
    if (i > 0) l.component[L4D_COMPONENT_ROTOR_TEMPORAL] = example_vq(60, 1, true, 10 * i + 7);
    l.directory_bits = i == 2 ? 2 : 0;
    l.page_table_offset = 5000 + 64 * i;
  }
  ComponentCoding& scale = h.layers[2].component[L4D_COMPONENT_SCALE];
  scale.has_rcq = true;
  scale.rcq = {17, ElementType::kSq, example_chunk(99), 0.0625f};
  return h;
}

}  // namespace l4d::test
