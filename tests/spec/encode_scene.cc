// SPDX-License-Identifier: Apache-2.0
// Encodes a small moving scene with the library, for the rules about encoders:
//   encode_scene PRESET FILE
#include <cmath>
#include <cstring>
#include <vector>

#include "l4d/decode.h"
#include "l4d/encode.h"
#include "l4d/experimental/parameters.h"

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  constexpr size_t kCount = 3000;
  std::vector<float> position, mean, log_scale, rotor, opacity, sh;
  // Low-discrepancy numbers: even coverage, and the same everywhere.
  const auto number = [](size_t i, unsigned axis) {
    const double v = (static_cast<double>(i) + 1) * std::sqrt(2.0 + 3.0 * axis);
    return static_cast<float>(v - std::floor(v));
  };
  for (size_t i = 0; i < kCount; ++i) {
    for (unsigned k = 0; k < 3; ++k) position.push_back(8 * number(i, k) - 4);
    mean.push_back(3 * number(i, 3) - 1);
    for (unsigned k = 0; k < 3; ++k) log_scale.push_back(-5 + 2 * number(i, 4 + k));
    log_scale.push_back(-5 + 6 * number(i, 7));
    rotor.push_back(1);
    for (unsigned k = 1; k < 4; ++k) rotor.push_back(number(i, 8 + k) - 0.5f);
    for (unsigned k = 4; k < 8; ++k) rotor.push_back(0.1f * (number(i, 8 + k) - 0.5f));
    opacity.push_back(number(i, 16));
    for (unsigned k = 0; k < 12; ++k) sh.push_back(number(i, 17 + k) - 0.5f);
  }
  l4d_gaussians g = L4D_INIT(l4d_gaussians);
  g.count = kCount;
  g.sh_degree = 1;
  g.position = position.data();
  g.mean_t = mean.data();
  g.log_scale = log_scale.data();
  g.rotor = rotor.data();
  g.opacity = opacity.data();
  g.sh = sh.data();
  l4d_timeline timeline{};
  timeline.num_frames = 30;
  timeline.fps_num = 30;
  timeline.fps_den = 1;
  l4d_encoder* encoder = nullptr;
  if (l4d_encoder_create(nullptr, &encoder) != L4D_OK) return 1;
  l4d_status status = l4d_encoder_set_preset(encoder, argv[1]);
  // The packed form is of this profile alone.
  if (status == L4D_OK && std::strcmp(argv[1], "indexed") == 0) {
    status = l4d_encoder_set(encoder, L4D_ENC_PROFILE, L4D_PROFILE_INDEXED);
  }
  if (status == L4D_OK) {
    status = l4d_encoder_set(encoder, L4D_ENC_CODEBOOK_SIZE, 64);
  }
  if (status == L4D_OK) status = l4d_encoder_set(encoder, L4D_ENC_MERGE_COUNT, 1);
  if (status == L4D_OK) {
    status = l4d_encoder_set(encoder, L4D_ENC_MERGE_FRACTION, 0);
  }
  if (status == L4D_OK) status = l4d_encoder_set_scene(encoder, &g, &timeline, nullptr);
  if (status == L4D_OK) status = l4d_encoder_encode_file(encoder, argv[2]);
  l4d_encoder_destroy(encoder);
  return status == L4D_OK ? 0 : 1;
}
