// SPDX-License-Identifier: Apache-2.0
#include "io/sequence/frame.h"

#include <algorithm>
#include <cmath>

#include "io/formats/scene_file.h"
#include "io/ply/read_ply.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

bool is_static(const Scene& scene) {
  if (!scene.window.empty()) return false;
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 4; k < 8; ++k) {
      if (scene.rotor[8 * i + k] != 0) return false;
    }
  }
  return true;
}

}  // namespace

Frame read_frame(const std::string& path, bool activated, const Hold& holder) {
  ImportOptions import;
  import.seconds = 1;
  import.fps = 1;
  import.activated = activated;
  import.holder = holder;
  Scene scene = read_scene_file(path, path, import);
  ImportOptions given;  // the clock is that of the sequence
  given.activated = activated;
  for (std::string& note : unused_options(given, scene.timeline, scene.source)) {
    scene.notes.push_back(std::move(note));
  }
  // Formats of static scenes alone: of others, an instant would have to be chosen.
  const bool has_time = scene.source == "l4d_ply" || scene.source == "ftgs_ply" ||
                        scene.source == "stg_ply" || scene.source == "rt4dgs_ply" ||
                        scene.source == "splatv" || scene.source == "raw";
  if (has_time || !is_static(scene)) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path +
                    ": a scene that changes over time; a frame of a sequence is a static one, "
                    "as `l4dcodec slice` writes it");
  }
  require_valid(scene, path);
  Frame frame;
  for (std::string& note : scene.notes) {
    if (note != kStaticNote) frame.notes.push_back(std::move(note));
  }
  const size_t n = scene.count();
  frame.sh_degree = scene.sh_degree;
  const uint64_t numbers = 3 + 3 + 4 + 1 + frame.sh_numbers();
  frame.memory = hold(holder, n * numbers * sizeof(float), path);
  frame.placement = scene.placement;
  frame.rendering = scene.rendering;
  frame.presentation = scene.presentation;
  frame.position = std::move(scene.position);
  frame.sh = std::move(scene.sh);
  frame.log_scale.resize(3 * n);
  frame.rotation.resize(4 * n);
  frame.opacity.resize(n);
  const bool is_logit = (scene.flags & L4D_OPACITY_LOGIT) != 0;
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = 0; k < 3; ++k) frame.log_scale[3 * i + k] = scene.log_scale[4 * i + k];
    const float* r = &scene.rotor[8 * i];
    const float wxyz[4] = {r[0], -r[3], r[2], -r[1]};
    double norm = 0;
    for (const float x : wxyz) norm += static_cast<double>(x) * static_cast<double>(x);
    norm = std::sqrt(norm);
    for (size_t k = 0; k < 4; ++k) {
      frame.rotation[4 * i + k] = static_cast<float>(static_cast<double>(wxyz[k]) / norm);
    }
    frame.opacity[i] =
        static_cast<float>(linear_opacity(static_cast<double>(scene.opacity[i]), is_logit));
  }
  return frame;
}

}  // namespace l4d::io
