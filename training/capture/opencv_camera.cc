// SPDX-License-Identifier: Apache-2.0
#include "training/capture/opencv_camera.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace l4d::train {

void rotation_of(const double* r, double* out) {
  const double angle = std::sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
  const double k[3] = {angle > 0 ? r[0] / angle : 0, angle > 0 ? r[1] / angle : 0,
                       angle > 0 ? r[2] / angle : 0};
  const double cross[9] = {0, -k[2], k[1], k[2], 0, -k[0], -k[1], k[0], 0};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      out[3 * i + j] = (i == j ? std::cos(angle) : 0) + (1 - std::cos(angle)) * k[i] * k[j] +
                       std::sin(angle) * cross[3 * i + j];
    }
  }
}

void set_pinhole(const io::CameraPlace& place, const double* k, l4d_camera* camera) {
  if (k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) place.fail("no pinhole camera");
  if (!(std::abs(k[1]) <= 1e-6 * std::abs(k[0]))) {
    place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "a skew");
  }
  camera->fx = k[0];
  camera->fy = k[4];
  camera->cx = k[2];
  camera->cy = k[5];
}

void set_lens(const io::CameraPlace& place, std::vector<double> d, io::Camera* camera) {
  if (d.size() != 4 && d.size() != 5 && d.size() != 8 && d.size() != 12 && d.size() != 14) {
    place.fail(std::to_string(d.size()) +
               " numbers; OpenCV has 4, 5 or 8 of a lens that is read here");
  }
  d.resize(14);
  const auto is_set = [](double x) { return x != 0; };
  if (std::any_of(d.begin() + 8, d.end(), is_set)) {
    place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "a thin prism or a tilted sensor");
  }
  if (std::none_of(d.begin(), d.end(), is_set)) return;
  io::Distortion& lens = camera->distortion;
  lens.model = io::Distortion::Model::kRadial;
  std::copy_n(d.begin(), 2, lens.k);
  std::copy_n(d.begin() + 2, 2, lens.p);
  std::copy_n(d.begin() + 4, 4, lens.k + 2);
}

void set_extrinsics(const double* rotation, const double* translation, l4d_camera* camera) {
  for (size_t r = 0; r < 3; ++r) {
    std::copy_n(rotation + 3 * r, 3, camera->world_to_camera + 4 * r);
    camera->world_to_camera[4 * r + 3] = translation[r];
  }
}

}  // namespace l4d::train
