// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/ply/read_ply.h"

namespace l4d::io {
namespace {

// Three programs write the attributes of a checkpoint of Real-time-4DGS under these names.
struct Names {
  const char* time;
  const char* time_scale;
  const char *left, *right;  // quaternions, with the number of the first component of `right`
  int first_right;

  std::string left_name(int k) const { return std::string(left) + "_" + std::to_string(k); }
  std::string right_name(int k) const {
    return std::string(right) + "_" + std::to_string(first_right + k);
  }
};
constexpr Names kNames[] = {{"t", "scale_t", "rot", "rot_r", 0},
                            {"mu_t", "t_scale", "rot_l", "rot_r", 0},
                            {"t", "scale_3", "rot", "rot", 4}};

const Names* names_of(const PlyElement& vertex) {
  for (const Names& names : kNames) {
    if (vertex.has(names.time) && vertex.has(names.time_scale) && vertex.has(names.left_name(3)) &&
        vertex.has(names.right_name(3))) {
      return &names;
    }
  }
  return nullptr;
}

// Quaternions (w, x, y, z of any length) of a rotation in space-time to its rotor. The two halves
// of a rotor are the right one, with one sign, and the left one.
Rotor rotor_of(const float* left, const float* right) {
  Vec4 a, b;
  for (size_t k = 0; k < 4; ++k) {
    a[k] = static_cast<double>(right[k]);
    b[k] = static_cast<double>(left[k]);
  }
  for (Vec4* half : {&a, &b}) {
    double norm = 0;
    for (const double x : *half) norm += x * x;
    norm = std::sqrt(norm);
    if (!(norm > 0)) *half = {1, 0, 0, 0};
    for (double& x : *half) x /= norm > 0 ? norm : 1;
  }
  const double a2 = -a[2], b2 = -b[2];
  return {(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a2 + b2) / 2,     (a[3] + b[3]) / 2,
          (b[3] - a[3]) / 2, (a2 - b2) / 2,     (b[1] - a[1]) / 2, (a[0] - b[0]) / 2};
}

}  // namespace

bool is_rt4dgs_ply(const PlyElement& vertex) { return names_of(vertex) != nullptr; }

Scene read_rt4dgs_ply(PlyReader& reader, const ImportOptions& options) {
  const Names& names = *names_of(reader.element());
  Scene scene;
  scene.source = "rt4dgs_ply";
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  set_default_timeline(scene, options);
  read_placement(reader, scene);
  const ShColumns sh = sh_columns_of(reader, true);
  scene.sh_degree = sh.degree;
  const size_t count = static_cast<size_t>(reader.element().count);
  scene.resize(count);
  std::vector<float> left(count * 4), right(count * 4);

  ColumnSet columns(reader, scene);
  columns.add_position();
  columns.add_time(names.time);
  columns.add_indexed("scale", 3, scene.log_scale.data(), 4);
  columns.add(names.time_scale, scene.log_scale.data(), 3, 4);
  for (int k = 0; k < 4; ++k) {
    columns.add(names.left_name(k), left.data(), static_cast<size_t>(k), 4);
    columns.add(names.right_name(k), right.data(), static_cast<size_t>(k), 4);
  }
  columns.add("opacity", scene.opacity.data(), 0, 1);
  columns.add_sh(sh);
  columns.read();
  settle_rows(reader, options, scene, 4);
  note_unturned(left, scene);
  note_unturned(right, scene);
  raise_flat_scales(scene);

  for (size_t i = 0; i < scene.count(); ++i) {
    const Rotor rotor = rotor_of(&left[4 * i], &right[4 * i]);
    if (!all_finite(rotor.data(), rotor.size())) {
      store_invalid_shape(scene, i);
      continue;
    }
    for (size_t k = 0; k < 8; ++k) scene.rotor[8 * i + k] = static_cast<float>(rotor[k]);
  }
  scene.notes.push_back(
      "Times of a Real-time-4DGS model are taken as seconds from the beginning of the sequence.");
  return scene;
}

}  // namespace l4d::io
