// SPDX-License-Identifier: Apache-2.0
// The pixels of a stream as the reference path renders them, in double precision:
//   render_pixels STREAM TIME R,G,B < CAMERA
// R,G,B: the background. CAMERA: width height fx fy cx cy near_plane and the 12 numbers of
// world_to_camera. Prints "r g b alpha" of each pixel, row by row.
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include "l4d/render.h"

namespace {

l4d_status draw(l4d_decoder* decoder, l4d_renderer* renderer, char** argv, const float* background,
                const l4d_camera& camera, const l4d_image& image) {
  l4d_status status = l4d_decoder_open_file(decoder, argv[1]);
  if (status == L4D_OK) status = l4d_renderer_set_streams(renderer, &decoder, nullptr, 1, nullptr);
  if (status == L4D_OK) status = l4d_renderer_set_background(renderer, background);
  if (status == L4D_OK) status = l4d_renderer_set_time(renderer, std::stod(argv[2]));
  if (status == L4D_OK) status = l4d_renderer_render(renderer, &camera, &image);
  return status;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) return 2;
  float background[3];
  if (std::sscanf(argv[3], "%f,%f,%f", background, background + 1, background + 2) != 3) return 2;
  l4d_camera camera = L4D_INIT(l4d_camera);
  std::cin >> camera.width >> camera.height >> camera.fx >> camera.fy >> camera.cx >> camera.cy >>
      camera.near_plane;
  for (double& v : camera.world_to_camera) std::cin >> v;
  if (!std::cin) return 2;

  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = L4D_BACKEND_REFERENCE;
  l4d_renderer* renderer = nullptr;
  l4d_decoder* decoder = nullptr;
  if (l4d_renderer_create(&options, &renderer) != L4D_OK) return 1;
  if (l4d_decoder_create(nullptr, &decoder) != L4D_OK) return 1;
  const size_t pixels = size_t{camera.width} * camera.height;
  std::vector<float> rgb(3 * pixels), alpha(pixels);
  l4d_image image = L4D_INIT(l4d_image);
  image.rgb = rgb.data();
  image.alpha = alpha.data();
  const l4d_status status = draw(decoder, renderer, argv, background, camera, image);
  if (status != L4D_OK) std::fprintf(stderr, "%s\n", l4d_status_name(status));
  for (size_t i = 0; status == L4D_OK && i < pixels; ++i) {
    std::printf("%.9g %.9g %.9g %.9g\n", static_cast<double>(rgb[3 * i]),
                static_cast<double>(rgb[3 * i + 1]), static_cast<double>(rgb[3 * i + 2]),
                static_cast<double>(alpha[i]));
  }
  l4d_renderer_destroy(renderer);
  l4d_decoder_destroy(decoder);
  return status == L4D_OK ? 0 : 1;
}
