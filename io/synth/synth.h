// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "io/file/memory.h"
#include "io/scene/scene.h"

namespace l4d::io {

// Deterministic dynamic scenes for demos, tests and benchmarks: equal options give equal bits on
// every machine (no library transcendental or distribution whose bits are unspecified decides a
// value).
struct SynthOptions {
  // "cloud": a random room, whose statistics are those of trained scenes at their worst. Places,
  // for people to look at: "square", a market square at dusk; "room", a living room in the evening.
  std::string scene = "cloud";
  double seconds = 5;
  double fps = 30;
  uint64_t gaussians = 100000;
  uint64_t seed = 1;
  // Gaussians of the room, for scenes that differ in length alone; 0 = a fixed share of all.
  uint64_t static_gaussians = 0;
  // Subset of: static, rigid, deform, flicker, appear (places: drops), view, frames. Empty =
  // all but the last.
  std::vector<std::string> effects;
  int threads = 0;  // 0 = one per core; the result is the same for any number
  Check check;      // called from several threads
};
extern const std::array<const char*, 7> kSynthEffects;  // of the cloud
extern const std::array<const char*, 7> kPlaceEffects;  // of the square and the room
Scene synthesize(const SynthOptions& options);
// Writes cameras.json for a place, "square" or "room": ids 0 to 7 named views (0 is the first view
// that the scene states) and 200 on, a walk with one camera per frame, at most 150, are for tests,
// and 100 to 123, a ring within it, for training. 960x540, no images.
void write_place_cameras(const std::string& path, const std::string& place,
                         const l4d_timeline& timeline);

}  // namespace l4d::io
