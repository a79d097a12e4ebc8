// SPDX-License-Identifier: Apache-2.0
// Decoding speed beside bytes for each preset: whole, without SH detail, positions alone, packed;
// what each attribute takes, beside what writing the arrays takes; and the speed of each target of
// Highway that this machine has.
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "bench/tables/common.h"
#include "io/synth/synth.h"
#include "l4d/experimental/packed.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr int kRuns = 15;
constexpr const char* kPresets[] = {"default", "tiny",    "small",   "large",
                                    "archive", "indexed", "lossless"};

struct Target {
  int64_t bit;
  const char* name;
};
constexpr Target kTargets[] = {
    {HWY_AVX3, "AVX-512"}, {HWY_AVX2, "AVX2"}, {HWY_SSE4, "SSE4"}, {HWY_NEON, "NEON"}};

using File = std::vector<unsigned char>;

DecoderHandle open(const File& file, uint32_t backend, uint32_t threads) {
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.backend = backend;
  options.threads = threads;
  DecoderHandle d(&options);
  d.open_memory(file.data(), file.size());
  return d;
}

GaussianArrays arrays_of(const File& file) {
  GaussianArrays arrays = open(file, L4D_BACKEND_CPU, 0).decode(whole_query());
  arrays.spans.clear();
  return arrays;
}

// Million Gaussians a second into the arrays that `buffers` has.
double expanded(const File& file, const l4d_query& query, l4d_gaussian_buffers buffers,
                size_t count, uint32_t backend, uint32_t threads, int runs = kRuns) {
  DecoderHandle d = open(file, backend, threads);
  const double s =
      time_median(runs, [&] { d.check(l4d_decoder_decode(d.get(), &query, &buffers)); });
  return static_cast<double>(count) / s / 1e6;
}

// Codebook indices alone have a packed form.
double packed(const File& file, size_t count) {
  std::vector<uint16_t> position(3 * count), mean(count), opacity(count), factor(count);
  std::vector<uint16_t> index[L4D_COMPONENT_COUNT];
  DecoderHandle d = open(file, L4D_BACKEND_CPU, 1);
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  b.capacity = count;
  b.position = position.data();
  b.mean_t = mean.data();
  b.opacity = opacity.data();
  b.scale_factor = factor.data();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    index[c].resize(count * L4D_MAX_STAGES);
    b.component[c].index = index[c].data();
  }
  const l4d_query query = whole_query();
  const double s =
      time_median(kRuns, [&] { d.check(l4d_decoder_decode_packed(d.get(), &query, &b)); });
  return static_cast<double>(count) / s / 1e6;
}

bool has_indices(const char* preset) { return std::string(preset) == "indexed"; }

void print_preset(const char* preset, const File& file) {
  GaussianArrays arrays = arrays_of(file);
  const size_t n = arrays.count();
  const l4d_gaussian_buffers all = arrays.buffers();
  l4d_gaussian_buffers positions = all;
  for_each_attribute(
      [&](const AttributeInfo& a, float*& to) {
        if (a.flag != info_of(Attribute::kPosition).flag) to = nullptr;
      },
      positions);
  const l4d_query whole = whole_query();
  l4d_query base = whole;
  base.point.detail = L4D_DETAIL_BASE_COLOR;
  std::printf("| %s | %.2f | %.1f | %.1f | %.1f | %.1f | ", preset,
              static_cast<double>(file.size()) / static_cast<double>(n),
              expanded(file, whole, all, n, L4D_BACKEND_CPU, 1),
              expanded(file, whole, all, n, L4D_BACKEND_CPU, 2),
              expanded(file, base, all, n, L4D_BACKEND_CPU, 1),
              expanded(file, whole, positions, n, L4D_BACKEND_CPU, 1));
  if (has_indices(preset)) {
    std::printf("%.1f |", packed(file, n));
  } else {
    std::printf("- |");
  }
  std::printf(" %.1f |\n", expanded(file, whole, all, n, L4D_BACKEND_REFERENCE, 1, 3));
  std::fflush(stdout);
}

// Seconds to write the arrays of all attributes, by the fastest of several runs.
double seconds_to_fill(const GaussianArrays& arrays, l4d_gaussian_buffers buffers) {
  double best = HUGE_VAL;
  for (int run = 0; run < kRuns; ++run) {
    const double started = seconds_now();
    for_each_attribute(
        [&](const AttributeInfo& a, float*& to) {
          const size_t row = a.numbers(arrays.sh_degree);
          if (to != nullptr) std::memset(to, run, arrays.count() * row * sizeof(float));
        },
        buffers);
    best = std::min(best, seconds_now() - started);
  }
  return best;
}

void print_attributes(const File& file) {
  GaussianArrays arrays = arrays_of(file);
  const size_t n = arrays.count();
  std::puts(
      "\nThe preset default, one thread; channels before an attribute are decoded with it:\n"
      "\n| attribute alone | ns/Gaussian |\n|---|---|");
  for (const AttributeInfo& alone : kAttributes) {
    l4d_gaussian_buffers b = arrays.buffers();
    for_each_attribute(
        [&](const AttributeInfo& a, float*& to) {
          if (a.flag != alone.flag) to = nullptr;
        },
        b);
    std::printf("| %s | %.2f |\n", alone.name,
                1000 / expanded(file, whole_query(), b, n, L4D_BACKEND_CPU, 1));
  }
  const l4d_gaussian_buffers all = arrays.buffers();
  std::vector<uint16_t> halves(arrays.sh.size());
  l4d_gaussian_buffers uploaded = all;
  uploaded.sh = nullptr;
  uploaded.sh_half = halves.data();
  std::printf("| all of them | %.2f |\n| all, SH as binary16 | %.2f |\n",
              1000 / expanded(file, whole_query(), all, n, L4D_BACKEND_CPU, 1),
              1000 / expanded(file, whole_query(), uploaded, n, L4D_BACKEND_CPU, 1));
  std::printf("| memset of all arrays | %.2f |\n",
              seconds_to_fill(arrays, all) / static_cast<double>(n) * 1e9);
}

// Each target alone, as on a machine that has no wider one.
void print_targets(const File& file) {
  GaussianArrays arrays = arrays_of(file);
  const size_t n = arrays.count();
  const l4d_query whole = whole_query();
  l4d_query base = whole;
  base.point.detail = L4D_DETAIL_BASE_COLOR;
  std::puts(
      "\nThe preset default, one thread, million Gaussians a second:\n"
      "\n| target | all | base colours |\n|---|---:|---:|");
  for (const Target& target : kTargets) {
    hwy::SetSupportedTargetsForTest(0);
    if ((hwy::SupportedTargets() & target.bit) == 0) continue;
    hwy::SetSupportedTargetsForTest(target.bit);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    const l4d_gaussian_buffers buffers = arrays.buffers();
    std::printf("| %s | %.1f | %.1f |\n", target.name,
                expanded(file, whole, buffers, n, L4D_BACKEND_CPU, 1),
                expanded(file, base, buffers, n, L4D_BACKEND_CPU, 1));
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

void run(const char* name, const WeightedScene& scene) {
  const std::vector<float> weights =
      scene.weights.count == 0 ? std::vector<float>() : sh_weights(scene);
  std::printf("\n%s\n\nMillion Gaussians a second:\n\n", name);
  std::puts(
      "| preset | bytes a Gaussian | all | 2 threads | base colours | positions | packed | "
      "reference |\n|---|---:|---:|---:|---:|---:|---:|---:|");
  File first;
  for (const char* preset : kPresets) {
    EncoderHandle encoder = make_encoder(scene, weights, preset);
    if (has_indices(preset)) {
      encoder.check(l4d_encoder_set(encoder.get(), L4D_ENC_PROFILE, L4D_PROFILE_INDEXED));
    }
    File file = encoder.encode();
    print_preset(preset, file);
    if (first.empty()) first = std::move(file);
  }
  print_attributes(first);
  print_targets(first);
}

}  // namespace

int main() {
  io::SynthOptions options;
  options.gaussians = 1000000;
  options.seconds = 20;
  run("synth, 1 million Gaussians, 20 s", {io::synthesize(options), {}});
  if (data_dir().empty()) {
    std::puts("\nbasketball: SKIPPED, set L4D_DATA_DIR");
    return 0;
  }
  run("basketball", load_basketball());
  return 0;
}
