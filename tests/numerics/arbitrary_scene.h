// SPDX-License-Identifier: Apache-2.0
// Scenes and encoder settings drawn at random, which shrink towards small and simple ones.
#pragma once

#include <rapidcheck.h>

#include "tests/common/codec.h"

namespace l4d::numerics {

struct ArbitraryScene {
  test::SceneOptions scene;
  test::EncodeOptions encode;
  uint32_t flags = 0;

  test::TestScene make() const;
};

// Timelines of 1 frame to 24 hours, all degrees, all codings. Without `lossy` settings the scene
// goes with the lossless preset.
ArbitraryScene draw_scene(bool lossy);

}  // namespace l4d::numerics
