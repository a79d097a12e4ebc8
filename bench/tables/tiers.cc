// SPDX-License-Identifier: Apache-2.0
// What tiers cost, and what a player shows of the first ones: bytes and fidelity, the PSNR between
// renders of what is decoded and renders of the original, of the basketball scene. Prints Markdown.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "bench/tables/common.h"
#include "io/camera/cameras.h"
#include "l4d/render.hpp"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr int kInstants = 5;

using Images = std::vector<std::vector<float>>;

Images render_all(RendererHandle& renderer, const std::vector<l4d_camera>& cameras,
                  const l4d_timeline& timeline) {
  Images out;
  for (int k = 0; k < kInstants; ++k) {
    renderer.set_time(timeline.time_begin + io::duration(timeline) * (k + 0.5) / kInstants);
    for (const l4d_camera& camera : cameras) {
      out.emplace_back(size_t{3} * camera.width * camera.height);
      renderer.render(camera, out.back().data());
    }
  }
  return out;
}

double psnr(const Images& a, const Images& b) {
  double sum = 0, count = 0;
  for (size_t k = 0; k < a.size(); ++k) {
    for (size_t i = 0; i < a[k].size(); ++i) {
      const double d = static_cast<double>(a[k][i]) - static_cast<double>(b[k][i]);
      sum += d * d;
    }
    count += static_cast<double>(a[k].size());
  }
  return std::min(100.0, -10 * std::log10(std::max(sum / count, 1e-10)));
}

struct Bench {
  WeightedScene scene = load_basketball();
  std::vector<float> sh = sh_weights(scene);
  std::vector<l4d_camera> cameras;
  Images original;

  Bench() {
    const io::CameraSet set = io::read_cameras(data_dir() + "/basketball/cameras.json");
    for (size_t k = 0; k < set.cameras.size(); k += 7) cameras.push_back(set.cameras[k].camera);
    RendererHandle renderer;
    renderer.set_gaussians(scene.scene.view(), scene.scene.timeline);
    original = render_all(renderer, cameras, scene.scene.timeline);
  }

  void print(const char* name, const std::vector<double>& shares) {
    EncoderHandle encoder = make_encoder(scene, sh, "default");
    encoder.set_list(L4D_ENC_TIERS, shares);
    const std::vector<unsigned char> file = encoder.encode();
    for (uint32_t tier = 0; tier <= shares.size(); ++tier) {
      for (const uint32_t detail : {L4D_DETAIL_BASE_COLOR, L4D_DETAIL_FULL}) {
        DecoderHandle decoder;
        decoder.open_memory(file.data(), file.size());
        const l4d_operating_point point = {0, tier + 1, detail, 0};
        l4d_query query = whole_query();
        query.point = point;
        const l4d_selection selection = decoder.select(query);
        query = time_query(scene.scene.timeline.time_begin);
        query.point = point;
        const l4d_selection first = decoder.select(query);
        RendererHandle renderer;
        renderer.set_decoder(decoder, point);
        const double fidelity = psnr(original, render_all(renderer, cameras, scene.scene.timeline));
        std::printf("| %s | %u | %s | %llu | %.1f | %.1f | %.1f | %.1f |\n", name, tier,
                    detail == L4D_DETAIL_FULL ? "full" : "base colour",
                    static_cast<unsigned long long>(selection.num_gaussians),
                    static_cast<double>(file.size()) / 1e3,
                    static_cast<double>(selection.bytes) / 1e3,
                    static_cast<double>(first.bytes) / 1e3, fidelity);
      }
    }
  }
};

}  // namespace

int main() {
  if (data_dir().empty()) {
    std::puts("the basketball scene is not there");
    return 0;
  }
  Bench bench;
  std::puts(
      "| tiers | up to tier | detail | Gaussians | file kB | pages kB | first picture kB | "
      "fidelity dB |\n|---|---:|---|---:|---:|---:|---:|---:|");
  bench.print("none", {});
  bench.print("0.15,0.5", {0.15f, 0.5f});
  bench.print("0.05,0.15,0.3,0.5", {0.05f, 0.15f, 0.3f, 0.5f});
}
