// SPDX-License-Identifier: Apache-2.0
// Encodes a scene from arrays, with progress, as encode_arrays.c does.
//
//   encode_arrays OUT.l4d
//   c++ -std=c++17 encode_arrays.cc $(pkg-config --cflags --libs l4dencoder)
#include <cmath>
#include <cstdio>
#include <vector>

#include "l4d/encode.hpp"

namespace {

// Arrays that own a scene: a helix of Gaussians that light up one after the other in two seconds.
struct Helix {
  std::vector<float> position, mean_t, log_scale, rotor, opacity, sh;

  explicit Helix(size_t count) {
    for (size_t i = 0; i < count; ++i) {
      const float share = static_cast<float>(i) / static_cast<float>(count), angle = 25 * share;
      const float size = std::log(0.04f), duration = std::log(0.25f);
      position.insert(position.end(), {std::cos(angle), 2 * share - 1, std::sin(angle)});
      mean_t.push_back(2 * share);
      log_scale.insert(log_scale.end(), {size, size, size, duration});
      rotor.insert(rotor.end(), {1, 0, 0, 0, 0, 0, 0, 0});
      opacity.push_back(0.8f);
      sh.insert(sh.end(), {1.5f * std::cos(angle), 1.5f * std::sin(angle), 0.5f});
    }
  }
  l4d_gaussians view() const {
    l4d_gaussians scene = L4D_INIT(l4d_gaussians);
    scene.count = mean_t.size();
    scene.position = position.data();
    scene.mean_t = mean_t.data();
    scene.log_scale = log_scale.data();
    scene.rotor = rotor.data();
    scene.opacity = opacity.data();
    scene.sh = sh.data();
    return scene;
  }
};

bool tell(uint64_t done, uint64_t total, const char* step) {
  if (total > 0) {
    std::printf("%s: %.0f %%\n", step,
                100 * static_cast<double>(done) / static_cast<double>(total));
  }
  return true;  // false: the encoder gives up
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: encode_arrays OUT.l4d\n");
    return 2;
  }
  try {
    const Helix helix(600);
    l4d::EncoderHandle encoder;
    encoder.set_progress(tell);
    encoder.set_preset("large");
    encoder.set_scene(helix.view(), {0.0, 60, 30, 1, 0});
    encoder.encode_file(argv[1]);
    std::printf("%zu Gaussians in %llu bytes\n", helix.mean_t.size(),
                static_cast<unsigned long long>(encoder.report().file_bytes));
  } catch (const l4d::Error& error) {
    std::fprintf(stderr, "encode_arrays: %s\n", error.what());
    return 1;
  }
}
