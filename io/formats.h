// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "io/memory.h"
#include "io/scene.h"

namespace l4d::io {

// Timeline to use for formats that carry none (3DGS PLY), and for those whose time is normalised.
struct ImportOptions {
  // 0 = what the file says, else 1 second. An l4d_ply that states its end keeps that.
  double seconds = 0;
  double fps = 0;  // 0 = what the file says, else 30
  Hold holder;     // counts the scene before it is read; it keeps that as Scene::memory
};

// Reads any scene PLY, told apart by its header: l4d_ply, .ftgs.ply, SpacetimeGaussians lite, 3DGS.
// Throws Error: L4D_ERR_IO, L4D_ERR_CORRUPT (with line or byte), L4D_ERR_FEATURE_UNSUPPORTED.
Scene read_scene_ply(const std::string& path, const ImportOptions& options = {});

// Per-Gaussian importance, a PLY with `comment l4d_weights 1`. Empty vectors where a column lacks.
struct Weights {
  std::vector<float> alpha_t, sh, scale, rotor_spatial, rotor_temporal, position, opacity, mean_t;
  // Measured as L4D_SENSITIVITY_GAUSS_NEWTON, and not as L4D_SENSITIVITY_SUM.
  bool gauss_newton = false;
  // sh is the column weight_sh_gradient, zero for Gaussians whose colour is clamped, and not
  // weight_sh.
  bool sh_is_clamped = false;
  size_t count = 0;
  std::shared_ptr<void> memory;  // counts them
};
// holder: counts the weights before they are read.
Weights read_weights_ply(const std::string& path, const Hold& holder = {});
// All columns must be there but position, opacity and mean_t; sh is written as weight_sh.
void write_weights_ply(const std::string& path, const Weights& weights);

// Writers go to a temporary name and rename on success. Each converts what its format demands.
void write_l4d_ply(const std::string& path, const Scene& scene);
void write_ftgs_ply(const std::string& path, const Scene& scene);
// Scales and rotations come from the eigen-decomposition of each covariance, in double.
void write_3dgs_ply(const std::string& path, const Splats& splats);

// Deterministic dynamic scenes for demos, tests and benchmarks: equal options give equal bits on
// every machine (no library transcendental or distribution whose bits are unspecified decides a
// value).
struct SynthOptions {
  // "cloud": a random room, whose statistics are those of trained scenes at their worst. "square":
  // a market square at dusk, for people to look at.
  std::string scene = "cloud";
  double seconds = 5;
  double fps = 30;
  uint64_t gaussians = 100000;
  uint64_t seed = 1;
  // Gaussians of the room, for scenes that differ in length alone; 0 = a fixed share of all.
  uint64_t static_gaussians = 0;
  // Subset of: static, rigid, deform, flicker, appear (the square: drops), view, frames. Empty =
  // all but the last.
  std::vector<std::string> effects;
  int threads = 0;  // 0 = one per core; the result is the same for any number
};
extern const std::array<const char*, 7> kSynthEffects;   // of the cloud
extern const std::array<const char*, 7> kSquareEffects;  // of the square
Scene synthesize(const SynthOptions& options);
// Writes cameras.json for the square: ids 0 to 7 named views (0 is the first view that the scene
// states) and 200 on, a walk with one camera per frame, at most 150, are for tests, and 100 to 123,
// a ring within the square, for training. 960x540, no images.
void write_square_cameras(const std::string& path, const l4d_timeline& timeline);

}  // namespace l4d::io
