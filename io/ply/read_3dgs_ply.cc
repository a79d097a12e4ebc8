// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/ply/read_ply.h"

namespace l4d::io {
namespace {

// Viewers' exporters write flat Gaussians with a scale of e^-20 and less; the codec's least is
// e^-16, which is as flat to any eye. Says how many it raised.
void raise_flat_scales(Scene& scene) {
  constexpr float kLeast = -16;
  size_t raised = 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    bool flat = false;
    for (size_t k = 0; k < 3; ++k) {
      float& s = scene.log_scale[4 * i + k];
      if (s < kLeast) {
        s = kLeast;
        flat = true;
      }
    }
    raised += flat;
  }
  if (raised > 0) {
    scene.notes.push_back(std::to_string(raised) +
                          " Gaussians had a scale below e^-16, which was raised to that.");
  }
}

}  // namespace

Scene read_3dgs_ply(PlyReader& reader, const ImportOptions& options) {
  Scene scene;
  scene.source = "3dgs_ply";
  scene.flags = L4D_OPACITY_LOGIT;
  set_default_timeline(scene, options);
  read_placement(reader, scene);
  scene.sh_degree = sh_degree_of(reader);
  const size_t count = static_cast<size_t>(reader.element().count);
  scene.resize(count);
  std::vector<float> quaternion(count * 4);  // w x y z

  ColumnSet columns(reader);
  columns.add_position(scene);
  columns.add_indexed("scale", 3, scene.log_scale.data(), 4);
  columns.add_indexed("rot", 4, quaternion.data(), 4);
  columns.add("opacity", scene.opacity.data(), 0, 1);
  columns.add_sh(scene);
  columns.read();

  raise_flat_scales(scene);

  // Centred, and 16 sequences wide: the falloff never reaches 1 - exp(-1/2048).
  const double seconds = duration(scene.timeline);
  const float mean_t = static_cast<float>(scene.timeline.time_begin + seconds / 2);
  for (size_t i = 0; i < count; ++i) {
    scene.mean_t[i] = mean_t;
    Vec4 wxyz;
    for (size_t k = 0; k < 4; ++k) wxyz[k] = static_cast<double>(quaternion[4 * i + k]);
    store_still_shape(scene, i, wxyz, 16 * seconds);
  }
  scene.notes.push_back(
      "Static Gaussians last 16 times the sequence: their opacity varies by less than 0.05 %.");
  return scene;
}

}  // namespace l4d::io
