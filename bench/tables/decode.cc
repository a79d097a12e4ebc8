// SPDX-License-Identifier: Apache-2.0
// Decoding speed per core: expanded and packed, reference and SIMD, and where the time goes.
#include <cstdio>

#include "bench/tables/common.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr int kRuns = 15;

DecoderHandle open(const std::vector<unsigned char>& file, uint32_t backend, uint32_t threads) {
  l4d_decoder_options options;
  l4d_decoder_options_init(&options);
  options.backend = backend;
  options.threads = threads;
  DecoderHandle d(&options);
  d.open_memory(file.data(), file.size());
  return d;
}

void run(const char* name, const std::vector<unsigned char>& file) {
  const l4d_query query = whole_query();
  GaussianArrays arrays = open(file, L4D_BACKEND_CPU, 0).decode(query);
  arrays.spans.clear();
  const double n = static_cast<double>(arrays.count());
  const auto rate = [&](double s) { return n / s / 1e6; };
  const auto expanded = [&](uint32_t backend, uint32_t threads, int runs) {
    DecoderHandle d = open(file, backend, threads);
    l4d_gaussian_buffers b = arrays.buffers();
    return time_median(runs, [&] { d.check(l4d_decoder_decode(d.get(), &query, &b)); });
  };
  const size_t count = arrays.count();
  std::vector<uint16_t> position(3 * count), mean(count), opacity(count), factor(count);
  std::vector<uint16_t> index[L4D_COMPONENT_COUNT];
  const auto packed = [&](uint32_t backend, uint32_t threads, int runs) {
    DecoderHandle d = open(file, backend, threads);
    l4d_packed_buffers b;
    l4d_packed_buffers_init(&b);
    b.capacity = count;
    b.position = position.data();
    b.mean_t = mean.data();
    b.opacity = opacity.data();
    b.scale_factor = factor.data();
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      index[c].resize(count * L4D_MAX_STAGES);
      b.component[c].index = index[c].data();
    }
    return time_median(runs, [&] { d.check(l4d_decoder_decode_packed(d.get(), &query, &b)); });
  };
  std::printf("\n%s: %zu Gaussians, %.2f bytes each\n\n", name, count,
              static_cast<double>(file.size()) / n);
  std::puts("| path | threads | million Gaussians/s |\n|---|---|---|");
  std::printf("| expanded, reference | 1 | %.1f |\n", rate(expanded(L4D_BACKEND_REFERENCE, 1, 3)));
  std::printf("| expanded, SIMD | 1 | %.1f |\n", rate(expanded(L4D_BACKEND_CPU, 1, kRuns)));
  std::printf("| expanded, SIMD | 2 | %.1f |\n", rate(expanded(L4D_BACKEND_CPU, 2, kRuns)));
  std::printf("| packed, reference | 1 | %.1f |\n", rate(packed(L4D_BACKEND_REFERENCE, 1, 3)));
  std::printf("| packed, SIMD | 1 | %.1f |\n", rate(packed(L4D_BACKEND_CPU, 1, kRuns)));
  std::printf("| packed, SIMD | 2 | %.1f |\n", rate(packed(L4D_BACKEND_CPU, 2, kRuns)));

  std::puts(
      "\n| attribute alone (SIMD, 1 thread; each reads and checks whole pages) | ns/Gaussian |"
      "\n|---|---|");
  for (const AttributeInfo& alone : kAttributes) {
    DecoderHandle d = open(file, L4D_BACKEND_CPU, 1);
    l4d_gaussian_buffers b = arrays.buffers();
    for_each_attribute(
        [&](const AttributeInfo& a, float*& to) {
          if (a.flag != alone.flag) to = nullptr;
        },
        b);
    const double s = time_median(kRuns, [&] { d.check(l4d_decoder_decode(d.get(), &query, &b)); });
    std::printf("| %s | %.2f |\n", alone.name, s * 1e9 / n);
  }
}

}  // namespace

int main() {
  io::SynthOptions options;
  options.gaussians = 1000000;
  options.seconds = 20;
  WeightedScene synth{io::synthesize(options), {}};
  run("synth, 1 million Gaussians, 20 s", make_encoder(synth, {}, "indexed-small").encode());
  if (data_dir().empty()) {
    std::puts("\nbasketball: SKIPPED, set L4D_DATA_DIR");
    return 0;
  }
  const WeightedScene scene = load_basketball();
  run("basketball", make_encoder(scene, sh_weights(scene), "indexed-small").encode());
  return 0;
}
