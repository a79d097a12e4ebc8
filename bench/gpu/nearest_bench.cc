// SPDX-License-Identifier: Apache-2.0
// Codebooks on the device against the host, and the quantisation of a whole scene.
//   gpu_nearest_bench [GAUSSIANS]
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "encoder/search/cuda/device_nearest.h"
#include "io/synth/synth.h"
#include "l4d/experimental/parameters.h"
#include "l4d/l4d.hpp"
#include "libl4dcodec/cuda/device.h"

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point t) {
  return std::chrono::duration<double>(Clock::now() - t).count();
}

template <typename Body>
double median_of(int runs, const Body& body) {
  std::vector<double> all;
  for (int i = 0; i < runs; ++i) {
    const Clock::time_point started = Clock::now();
    body();
    all.push_back(seconds_since(started));
  }
  std::nth_element(all.begin(), all.begin() + runs / 2, all.end());
  return all[static_cast<size_t>(runs / 2)];
}

// Rows whose numbers fall off, as attributes' do.
std::vector<float> rows(size_t n, size_t dim, uint64_t seed) {
  std::vector<float> v(n * dim);
  uint64_t x = seed;
  for (size_t i = 0; i < v.size(); ++i) {
    float sum = 0;
    for (int k = 0; k < 4; ++k) {
      x = x * 6364136223846793005u + 1442695040888963407u;
      sum += static_cast<float>(x >> 40) / 16777216.0f - 0.5f;
    }
    v[i] = sum / (1.0f + 0.3f * static_cast<float>(i % dim));
  }
  return v;
}

void assignments(size_t n) {
  const auto device = l4d::cuda::make_device_nearest(0, 0);
  std::printf(
      "| points | numbers | codewords | host s | device s | ratio | device floor s |\n"
      "|---:|---:|---:|---:|---:|---:|---:|\n");
  for (const size_t dim : {size_t{3}, size_t{4}, size_t{48}}) {
    for (const size_t k : {size_t{1024}, size_t{4096}}) {
      const std::vector<float> points = rows(n, dim, dim), codebook = rows(k, dim, k + dim);
      std::vector<uint32_t> labels(n), host_labels(n);
      std::vector<float> sq_dist(n);
      const double host = median_of(1, [&] {
        l4d::assign_nearest(points.data(), n, dim, codebook.data(), k, 0, nullptr,
                            host_labels.data(), sq_dist.data());
      });
      const auto search = [&] {
        l4d::assign_nearest(points.data(), n, dim, codebook.data(), k, {0, device.get()}, nullptr,
                            labels.data(), sq_dist.data());
      };
      search();
      const double on_device = median_of(9, search);
      // Two instructions for each difference of numbers at the full rate of 33.4e12 a second.
      const double floor = 2.0 * static_cast<double>(n) * static_cast<double>(k * dim) / 33.4e12;
      std::printf("| %zu | %zu | %zu | %.3f | %.4f | %.1f | %.4f |%s\n", n, dim, k, host, on_device,
                  host / on_device, floor, labels == host_labels ? "" : " DIFFERENT");
    }
  }
}

// Returns the file.
std::vector<unsigned char> quantise(const l4d::io::Scene& scene, bool by_hand, uint32_t backend) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.backend = backend;
  l4d::EncoderHandle e(&options);
  e.set_preset("indexed");
  if (by_hand) {
    e.set(L4D_ENC_CODEBOOK_SIZE, 4096);
    e.set_list(L4D_ENC_STAGES, std::vector<double>{1});
  }
  const l4d_gaussians view = scene.view();
  e.set_scene(view, scene.timeline, &scene.placement);
  const Clock::time_point started = Clock::now();
  std::vector<unsigned char> file = e.encode();
  const double total = seconds_since(started);
  double vq = 0;
  const l4d_encode_report report = e.report();
  for (uint32_t i = 0; i < report.num_steps; ++i) {
    if (std::strstr(report.steps[i].name, "_vq") != nullptr) vq += report.steps[i].seconds;
  }
  std::printf("| %s | %s | %.2f | %.2f | %zu |\n",
              by_hand ? "one stage of 4096, RCQ where it pays" : "preset indexed",
              backend == L4D_BACKEND_CUDA ? "device" : "host", vq, total, file.size());
  for (uint32_t i = 0; i < report.num_steps; ++i) {
    std::printf("  %s %.3f", report.steps[i].name, report.steps[i].seconds);
  }
  std::puts("");
  return file;
}

}  // namespace

int main(int argc, char** argv) {
  const l4d::Status usable = l4d::cuda::use_device(0);
  if (!usable.ok()) {
    std::printf("SKIPPED: %s\n", usable.detail().c_str());
    return 0;
  }
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  const size_t n = argc > 1 ? static_cast<size_t>(std::atoll(argv[1])) : 1400000;
  assignments(n);
  l4d::io::SynthOptions options;
  options.gaussians = n;
  options.seconds = 40;
  const l4d::io::Scene scene = l4d::io::synthesize(options);
  std::printf(
      "\n| codebooks | searches | VQ, RCQ and SQ s | all s | bytes |\n|---|---|---:|---:|---:|\n");
  for (const bool by_hand : {true, false}) {
    const auto host = quantise(scene, by_hand, L4D_BACKEND_CPU);
    const auto device = quantise(scene, by_hand, L4D_BACKEND_CUDA);
    std::printf("the files are %s\n", host == device ? "the same" : "DIFFERENT");
  }
  return 0;
}
