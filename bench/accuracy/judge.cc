// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/judge.h"

#include <algorithm>

namespace l4d::bench {

Judge::Judge(const BenchScene& scene, std::vector<uint32_t> frames)
    : scene_(scene), frames_(std::move(frames)) {
  RendererHandle renderer;
  renderer.set_gaussians(scene.scene.view(), scene.scene.timeline);
  for (const uint32_t f : frames_) {
    renderer.set_time(scene.time_of(f));
    for (const l4d_camera& camera : scene.cameras) {
      io::Image image(camera.width, camera.height);
      renderer.render(camera, image.rgb.data());
      originals_.push_back(std::move(image));
    }
  }
}

void Judge::visit(RendererHandle& renderer, const Visit& visit) const {
  size_t index = 0;
  for (const uint32_t f : frames_) {
    renderer.set_time(scene_.time_of(f));
    for (const l4d_camera& camera : scene_.cameras) {
      io::Image image(camera.width, camera.height);
      renderer.render(camera, image.rgb.data());
      visit(index, originals_[index], image);
      ++index;
    }
  }
}

io::Fidelity Judge::judge(RendererHandle& renderer, bool with_ssim) const {
  io::FidelityAccumulator sums;
  visit(renderer, [&](size_t, const io::Image& a, const io::Image& b) {
    sums.add(io::mse(a, b), with_ssim ? io::ssim(a, b, 0) : 1);
  });
  io::Fidelity f = sums.result();
  f.psnr = std::min(f.psnr, kMaxDecibels);
  f.min_psnr = std::min(f.min_psnr, kMaxDecibels);
  return f;
}

io::Fidelity Judge::of_file(const std::vector<unsigned char>& file, bool with_ssim) const {
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  RendererHandle renderer;
  renderer.set_decoder(decoder);
  return judge(renderer, with_ssim);
}

io::Fidelity Judge::of_scene(const io::Scene& scene, bool with_ssim) const {
  RendererHandle renderer;
  renderer.set_gaussians(scene.view(), scene.timeline);
  return judge(renderer, with_ssim);
}

void Judge::visit_file(const std::vector<unsigned char>& file, const Visit& visit_view) const {
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  RendererHandle renderer;
  renderer.set_decoder(decoder);
  visit(renderer, visit_view);
}

}  // namespace l4d::bench
