// SPDX-License-Identifier: Apache-2.0
// What the rows of foreign files hold beside usual numbers.
#include <algorithm>
#include <cmath>

#include "io/ply/read_ply.h"

namespace l4d::io {
namespace {

float log_of(float x) { return static_cast<float>(std::log(static_cast<double>(x))); }

bool looks_activated(const Scene& scene) {
  if (scene.count() == 0) return false;
  const auto is_opacity = [](float o) { return o >= 0 && o <= 1; };
  if (!std::all_of(scene.opacity.begin(), scene.opacity.end(), is_opacity)) return false;
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      if (!(scene.log_scale[4 * i + k] > 0)) return false;
    }
  }
  return true;
}

void take_activated(Scene& scene) {
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      float& scale = scene.log_scale[4 * i + k];
      scale = log_of(scale);
    }
    float& opacity = scene.opacity[i];
    // NaN and what no opacity is stay for the encoder to name.
    if (opacity >= 0 && opacity <= 1) {
      opacity = static_cast<float>(logit(static_cast<double>(opacity)));
    }
  }
}

}  // namespace

void note_unturned(const std::vector<float>& quaternion, Scene& scene) {
  size_t unturned = 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    const float* q = &quaternion[4 * i];
    unturned += std::all_of(q, q + 4, [](float x) { return x == 0; }) ? 1U : 0U;
  }
  if (unturned == 0) return;
  scene.notes.push_back(
      "Rotations of length 0, which are taken as none: " + std::to_string(unturned) + ".");
}

void settle_rows(const ImportOptions& options, Scene& scene) {
  if (options.activated) {
    take_activated(scene);
  } else if (looks_activated(scene)) {
    scene.notes.push_back(
        "All opacities are from 0 to 1 and all scales are positive, as in files that have "
        "opacities and lengths where logits and logarithms belong; --activated reads them so.");
  }
  size_t infinite = 0;
  for (float& opacity : scene.opacity) {
    if (!std::isinf(opacity)) continue;
    opacity = static_cast<float>(logit(opacity > 0 ? 1 : 0));
    ++infinite;
  }
  if (infinite == 0) return;
  scene.notes.push_back(
      "Infinite logits, which are taken as opacity 1 or 0: " + std::to_string(infinite) + ".");
}

}  // namespace l4d::io
