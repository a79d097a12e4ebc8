// SPDX-License-Identifier: Apache-2.0
// What an instant of a stream costs, where all Gaussians stand still, where half of them do and
// where all move: slices into the caller's arrays beside a memcpy of the same bytes, slices that
// keep the rows of what stands still, and set_time of a renderer; and the first instants of a
// player. Prints Markdown tables.
#include <cstdio>
#include <cstring>

#include "bench/tables/common.h"
#include "io/synth/synth.h"
#include "l4d/render.hpp"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr uint64_t kGaussians = 200000;
constexpr double kSeconds = 10;
constexpr int kRuns = 15;

// Arrays as a player has them: SH stays in the decoder.
struct Arrays {
  std::vector<float> position, covariance, opacity;
  std::vector<const float*> rows;
  l4d_splat_buffers buffers;
  explicit Arrays(size_t n) : position(3 * n), covariance(6 * n), opacity(n), rows(n) {
    buffers = L4D_INIT(l4d_splat_buffers);
    buffers.capacity = n;
    buffers.position = position.data();
    buffers.covariance = covariance.data();
    buffers.opacity = opacity.data();
    buffers.sh_rows = rows.data();
  }
};

double copy_seconds(const Arrays& from, size_t n) {
  Arrays to(n);
  return time_median(kRuns, [&] {
    std::memcpy(to.position.data(), from.position.data(), 3 * n * sizeof(float));
    std::memcpy(to.covariance.data(), from.covariance.data(), 6 * n * sizeof(float));
    std::memcpy(to.opacity.data(), from.opacity.data(), n * sizeof(float));
    std::memcpy(to.rows.data(), from.rows.data(), n * sizeof(float*));
  });
}

void print_row(const char* name, const std::vector<std::string>& effects, uint64_t still) {
  io::SynthOptions options;
  options.seconds = kSeconds;
  options.gaussians = kGaussians;
  options.effects = effects;
  options.static_gaussians = still;
  const WeightedScene scene{io::synthesize(options), {}};
  const std::vector<unsigned char> file = make_encoder(scene, {}, "default").encode();
  l4d_decoder_options decoding = L4D_INIT(l4d_decoder_options);
  decoding.threads = 1;
  DecoderHandle d(&decoding);
  d.open_memory(file.data(), file.size());
  Arrays arrays(static_cast<size_t>(d.info().num_gaussians));
  // Instants within one bucket of each level: what is decoded stays decoded.
  int step = 0;
  const auto next = [&] { return 4.4 + 1e-4 * (step++ % 50); };
  const auto slice = [&](bool keep) {
    return time_median(kRuns, [&] {
      if (!keep) arrays.buffers.still_key = 0;
      d.check(l4d_decoder_slice(d.get(), next(), &arrays.buffers));
    });
  };
  const double whole = slice(false), kept = slice(true);
  const size_t n = static_cast<size_t>(arrays.buffers.count);
  const double copied = copy_seconds(arrays, n);
  l4d_renderer_options rendering = L4D_INIT(l4d_renderer_options);
  rendering.threads = 1;
  RendererHandle renderer(&rendering);
  renderer.set_decoder(d);
  const double time = time_median(kRuns, [&] { renderer.set_time(next()); });
  std::printf("| %s | %zu | %llu | %.3f | %.3f | %.2f | %.3f | %.3f |\n", name, n,
              static_cast<unsigned long long>(arrays.buffers.num_still), 1e3 * whole, 1e3 * copied,
              whole / copied, 1e3 * kept, 1e3 * time);
  std::fflush(stdout);
}

// A decoder that has just been opened shows an instant with half a million visible Gaussians, then
// frame after frame, and then another instant, of which only long-lived Gaussians are decoded.
void print_player(const std::vector<unsigned char>& file, uint32_t threads) {
  constexpr double kInstant = 20, kFrame = 1.0 / 30, kOther = 33;
  constexpr int kOpenings = 7, kFrames = 30;
  std::vector<double> first, next, seek;
  size_t visible = 0;
  for (int k = 0; k < kOpenings; ++k) {
    l4d_decoder_options decoding = L4D_INIT(l4d_decoder_options);
    decoding.threads = threads;
    DecoderHandle d(&decoding);
    d.open_memory(file.data(), file.size());
    Arrays arrays(static_cast<size_t>(d.info().num_gaussians));
    const auto show = [&](double time) {
      const double started = seconds_now();
      d.check(l4d_decoder_slice(d.get(), time, &arrays.buffers));
      return seconds_now() - started;
    };
    first.push_back(show(kInstant));
    visible = static_cast<size_t>(arrays.buffers.count);
    for (int frame = 1; frame <= kFrames; ++frame) next.push_back(show(kInstant + frame * kFrame));
    seek.push_back(show(kOther));
  }
  std::printf("| %zu | %u | %.2f | %.2f | %.2f |\n", visible, threads, 1e3 * median(first),
              1e3 * median(next), 1e3 * median(seek));
  std::fflush(stdout);
}

void print_players() {
  io::SynthOptions options;
  options.seconds = 40;
  options.gaussians = 656000;
  const WeightedScene scene{io::synthesize(options), {}};
  const std::vector<unsigned char> file = make_encoder(scene, {}, "default").encode();
  std::puts(
      "\n| visible | threads | first instant ms | next frame ms | seek ms "
      "|\n|---|---|---|---|---|");
  for (const uint32_t threads : {1u, 2u}) print_player(file, threads);
}

}  // namespace

int main() {
  std::puts(
      "| scene | visible | still | slice ms | memcpy ms | ratio | slice that keeps ms |"
      " renderer's set_time ms |");
  std::puts("|---|---|---|---|---|---|---|---|");
  print_row("all still", {"static", "view"}, kGaussians);
  print_row("half", {"static", "rigid", "view"}, kGaussians / 2);
  print_row("all moving", {"rigid", "view"}, 0);
  print_players();
  return 0;
}
