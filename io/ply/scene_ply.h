// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "io/file/memory.h"
#include "io/scene/scene.h"
#include "io/scene/statements.h"

namespace l4d::io {

// Timeline to use for formats that carry none (3DGS PLY), and for those whose time is normalised.
struct ImportOptions {
  // 0 = what the file says, else 1 second. An l4d_ply that states its end keeps that.
  double seconds = 0;
  double fps = 0;  // 0 = what the file says, else 30
  // Opacities of the file are in [0, 1] and scales are lengths, in the columns that layouts have
  // for logits and for logarithms.
  bool activated = false;
  Hold holder;  // counts the scene before it is read; it keeps that as Scene::memory
  // Called with each file that is read because another one names it, before it is opened.
  std::function<void(const std::string& path)> reads = [](const std::string&) {};
};

// Reads any scene PLY, told apart by its header: l4d_ply, .ftgs.ply, SpacetimeGaussians lite, 3DGS,
// plain and compressed.
// Throws Error: L4D_ERR_IO, L4D_ERR_CORRUPT (with line or byte), L4D_ERR_FEATURE_UNSUPPORTED.
Scene read_scene_ply(const std::string& path, const ImportOptions& options = {});

// Writers go to a temporary name and rename on success. Each converts what its format demands.
// What `check` throws ends them, and leaves what was there before.
void write_l4d_ply(const std::string& path, const Scene& scene, const Check& check = {});
// Bytes that the next two take besides the scene.
uint64_t bytes_to_write_moving(const Scene& scene);
// Returns what the file does not have of the scene.
WriteNotes write_ftgs_ply(const std::string& path, const Scene& scene, const Check& check = {});
// The columns t, scale_t and motion_0..2, of lines: a scene of SpacetimeGaussians without turning.
WriteNotes write_stg_ply(const std::string& path, const Scene& scene, const Check& check = {});
// In an order of its own.
WriteNotes write_compressed_ply(const std::string& path, const Splats& splats,
                                const Hold& holder = {}, const Check& check = {});
// Scales and rotations come from the eigen-decomposition of each covariance, in double.
void write_3dgs_ply(const std::string& path, const Splats& splats, const Check& check = {});

}  // namespace l4d::io
