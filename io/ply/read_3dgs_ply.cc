// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>

#include "io/ply/read_ply.h"

namespace l4d::io {
bool raise_flat_scale(float* log_scale) {
  constexpr float kLeast = -16;
  bool flat = false;
  for (size_t k = 0; k < 3; ++k) {
    if (!(log_scale[k] < kLeast)) continue;
    log_scale[k] = kLeast;
    flat = true;
  }
  return flat;
}

void raise_flat_scales(Scene& scene) {
  size_t raised = 0;
  for (size_t i = 0; i < scene.count(); ++i) raised += raise_flat_scale(&scene.log_scale[4 * i]);
  if (raised > 0) {
    scene.notes.push_back("Gaussians with a scale below e^-16, which was raised to that: " +
                          std::to_string(raised) + ".");
  }
}

void make_static(const std::vector<float>& rotation, Scene& scene) {
  raise_flat_scales(scene);

  // Centred, and 16 sequences wide: the falloff never reaches 1 - exp(-1/2048).
  const double seconds = duration(scene.timeline);
  const float mean_t = static_cast<float>(scene.timeline.time_begin + seconds / 2);
  for (size_t i = 0; i < scene.count(); ++i) {
    scene.mean_t[i] = mean_t;
    Vec4 wxyz;
    for (size_t k = 0; k < 4; ++k) wxyz[k] = static_cast<double>(rotation[4 * i + k]);
    store_still_shape(scene, i, wxyz, 16 * seconds);
    const double length =
        wxyz[0] * wxyz[0] + wxyz[1] * wxyz[1] + wxyz[2] * wxyz[2] + wxyz[3] * wxyz[3];
    // No rotation stands for it: what codes or writes the scene refuses it by its number.
    if (!std::isfinite(length)) scene.rotor[8 * i] = std::numeric_limits<float>::quiet_NaN();
  }
  note_unturned(rotation, scene);
  scene.notes.push_back(kStaticNote);
}

Scene read_3dgs_ply(PlyReader& reader, const ImportOptions& options) {
  Scene scene;
  scene.source = "3dgs_ply";
  scene.flags = L4D_OPACITY_LOGIT;
  set_default_timeline(scene, options);
  read_placement(reader, scene);
  const ShColumns sh = sh_columns_of(reader);
  scene.sh_degree = sh.degree;
  const size_t count = static_cast<size_t>(reader.element().count);
  scene.resize(count);
  std::vector<float> quaternion(count * 4);  // w x y z

  ColumnSet columns(reader, scene);
  columns.add_position();
  columns.add_indexed("scale", 3, scene.log_scale.data(), 4);
  columns.add_indexed("rot", 4, quaternion.data(), 4);
  columns.add("opacity", scene.opacity.data(), 0, 1);
  columns.add_sh(sh);
  columns.read();
  settle_rows(reader, options, scene);

  make_static(quaternion, scene);
  return scene;
}

}  // namespace l4d::io
