// SPDX-License-Identifier: Apache-2.0
// What the rows of foreign files hold beside usual numbers.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "io/ply/read_ply.h"

namespace l4d::io {
namespace {

float log_of(float x) { return static_cast<float>(std::log(static_cast<double>(x))); }

// Of one column or several: nearly all, since a few rows may be broken.
template <typename Is>
bool are_nearly_all(size_t count, const Is& is) {
  size_t good = 0;
  for (size_t i = 0; i < count; ++i) good += is(i) ? 1U : 0U;
  return count > 0 && good >= count - count / 100;
}

// The note, or "".
std::string activated_note(const Scene& scene) {
  const size_t count = scene.count();
  const bool opacities = are_nearly_all(count, [&](size_t i) {
    const float o = scene.opacity[i];
    return o >= 0 && o <= 1.001F;
  });
  const bool scales = are_nearly_all(
      3 * count, [&](size_t k) { return scene.log_scale[4 * (k / 3) + k % 3] >= 0; });
  // In a scene of large numbers logarithms are positive, too.
  constexpr float kLargest = 2;
  const bool lengths = scales && are_nearly_all(3 * count, [&](size_t k) {
                         return scene.log_scale[4 * (k / 3) + k % 3] < kLargest;
                       });
  if (opacities && scales) {
    return "Opacities are from 0 to 1 and scales are positive, as in files that have opacities and "
           "lengths where logits and logarithms belong; --activated reads them so.";
  }
  // One of the two alone may be so by chance where there are few.
  constexpr size_t kMany = 100;
  if (count < kMany) return "";
  if (opacities) {
    return "Opacities are from 0 to 1, as in files that have opacities where logits belong; they "
           "were read as logits.";
  }
  if (lengths) {
    return "Scales are positive, as in files that have lengths where logarithms belong; they were "
           "read as logarithms.";
  }
  return "";
}

// Bytes where logits or coefficients belong.
void note_bytes(Scene& scene) {
  constexpr float kMostLogit = 30, kMostColor = 20;
  const size_t count = scene.count(), stride = 3 * scene.sh_coefficients();
  const auto note = [&](const char* text, float most) {
    char line[160];
    std::snprintf(line, sizeof(line), text, static_cast<double>(most));
    scene.notes.emplace_back(line);
  };
  float most = 0;
  for (const float o : scene.opacity) most = std::isinf(o) ? most : std::max(most, o);
  if (most > kMostLogit && are_nearly_all(count, [&](size_t i) { return scene.opacity[i] >= 0; })) {
    note("Opacities are from 0 to %g, where logits belong: nearly all are opaque.", most);
  }
  const auto color = [&](size_t k) { return scene.sh[stride * (k / 3) + k % 3]; };
  most = 0;
  for (size_t k = 0; k < 3 * count; ++k) most = std::max(most, color(k));
  if (most > kMostColor && are_nearly_all(3 * count, [&](size_t k) { return color(k) >= 0; })) {
    note("Base colours (f_dc) are from 0 to %g, where coefficients belong: most are white.", most);
  }
}

void take_activated(const PlyReader& reader, size_t num_scales, Scene& scene) {
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 0; k < num_scales; ++k) {
      float& scale = scene.log_scale[4 * i + k];
      if (scale < 0) {
        reader.fail(L4D_ERR_INVALID_SCENE, "Gaussian " + std::to_string(i) + " has a scale of " +
                                               std::to_string(scale) +
                                               ", which is no length: --activated does not fit");
      }
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

void settle_rows(const PlyReader& reader, const ImportOptions& options, Scene& scene,
                 size_t num_scales) {
  if (options.activated) {
    take_activated(reader, num_scales, scene);
  } else if (const std::string note = activated_note(scene); !note.empty()) {
    scene.notes.push_back(note);
  }
  note_bytes(scene);
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
