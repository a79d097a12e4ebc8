// SPDX-License-Identifier: Apache-2.0
// A stranger's C++ program over the installed l4d.hpp.
#include <cstdio>
#include <l4d/l4d.hpp>
#include <vector>

int main() {
  try {
    const std::vector<float> position{0, 0, 0}, mean_t{0.5f}, log_scale{-3, -3, -3, -1},
        rotor{1, 0, 0, 0, 0, 0, 0, 0}, opacity{0.5f}, sh{0.1f, 0.2f, 0.3f};
    l4d_gaussians scene = L4D_INIT(l4d_gaussians);
    scene.count = 1;
    scene.position = position.data();
    scene.mean_t = mean_t.data();
    scene.log_scale = log_scale.data();
    scene.rotor = rotor.data();
    scene.opacity = opacity.data();
    scene.sh = sh.data();
    const l4d_timeline timeline{0.0, 30, 30, 1, 0};

    l4d::EncoderHandle encoder;
    encoder.check(l4d_encoder_set_scene(encoder.get(), &scene, &timeline, nullptr));
    const std::vector<unsigned char> stream = encoder.encode();

    l4d::DecoderHandle decoder;
    decoder.open_memory(stream.data(), stream.size());
    const size_t visible = decoder.slice(0.5).count();
    std::printf("%zu bytes, %zu visible\n", stream.size(), visible);
    if (visible != 1) return 1;

    // An error of the library arrives as an exception with its status.
    try {
      decoder.open_memory("not a stream", 12);
    } catch (const l4d::Error& error) {
      return error.status() == L4D_ERR_NOT_L4D || error.status() == L4D_ERR_TRUNCATED ? 0 : 1;
    }
    return 1;
  } catch (const l4d::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
