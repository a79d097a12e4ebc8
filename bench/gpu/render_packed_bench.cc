// SPDX-License-Identifier: Apache-2.0
// Rendering streams of codebooks with their SH expanded and as indices: memory of a Gaussian,
// frames per second, and the step that makes colours, for the same frames.
//
//   gpu_render_packed_bench FILE...
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include "bench/gpu/render_timing.h"
#include "io/camera/cameras.h"
#include "io/scene/scene.h"
#include "l4d/cuda.h"
#include "l4d/experimental/cuda_packed.h"
#include "l4d/l4d.hpp"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr uint32_t kWidth = 1352, kHeight = 1014;
constexpr int kRuns = 300;

size_t free_memory() {
  size_t left = 0, all = 0;
  check(cudaDeviceSynchronize());
  check(cudaMemGetInfo(&left, &all));
  return left;
}

// A stream on the device: Gaussians with their SH, and the indices of it.
struct Stream {
  DecoderHandle decoder;
  l4d_cuda_decoder* cuda = nullptr;
  std::vector<std::unique_ptr<Array<unsigned char>>> arrays;
  l4d_gaussians gaussians{};
  l4d_cuda_sh_indices indices;
  std::vector<l4d_codebook> codebooks;
  l4d_timeline timeline{};
  std::vector<l4d_camera> cameras;

  explicit Stream(const std::string& file) {
    decoder.open_file(file);
    decoder.check(l4d_cuda_decoder_create(decoder.get(), 0, &cuda));
    const l4d_info info = decoder.info();
    timeline = info.timeline;
    const size_t terms = (info.sh_degree + 1) * (info.sh_degree + 1);
    l4d_query query = L4D_INIT(l4d_query);
    for (uint32_t s = 0; s < L4D_MAX_STAGES; ++s) {
      l4d_codebook codebook = L4D_INIT(l4d_codebook);
      must_decode(
          l4d_cuda_decoder_get_codebook(cuda, 0, L4D_COMPONENT_SH, s, L4D_NO_BLOCK, &codebook));
      if (codebook.entries != nullptr) codebooks.push_back(codebook);
    }
    l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
    request.forms = L4D_CUDA_FORM_EXPANDED | L4D_CUDA_FORM_PACKED;
    must_decode(l4d_cuda_decoder_prepare(cuda, &query, &request));
    const size_t n = static_cast<size_t>(request.num_gaussians);
    const Array<unsigned char> workspace(static_cast<size_t>(request.workspace_bytes));
    l4d_cuda_gaussian_buffers out = L4D_INIT(l4d_cuda_gaussian_buffers);
    out.capacity = n;
    gaussians = {};
    gaussians.struct_size = sizeof gaussians;
    gaussians.count = n;
    gaussians.sh_degree = info.sh_degree;
    gaussians.flags = info.flags;
    for_each_attribute(
        [&](const AttributeInfo& a, float*& to, const float*& from) {
          from = to = array<float>(a.numbers(info.sh_degree) * n);
        },
        out, gaussians);
    if ((info.tools & L4D_TOOL_FLAT_WINDOWS) != 0) {
      gaussians.window = out.window = array<uint32_t>(2 * n);
    }
    must_decode(
        l4d_cuda_decoder_decode(cuda, &out, workspace.get(), request.workspace_bytes, nullptr));
    must_decode(l4d_cuda_decoder_finish(cuda));
    l4d_cuda_packed_buffers packed = L4D_INIT(l4d_cuda_packed_buffers);
    packed.capacity = n;
    l4d_cuda_packed_component& sh = packed.component[L4D_COMPONENT_SH];
    sh = {array<uint8_t>(n), array<uint16_t>(codebooks.size() * n), array<uint16_t>(3 * terms * n),
          n};
    must_decode(l4d_cuda_decoder_decode_packed(cuda, &packed, workspace.get(),
                                               request.workspace_bytes, nullptr));
    must_decode(l4d_cuda_decoder_finish(cuda));
    uint64_t escapes[L4D_COMPONENT_COUNT];
    for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      must_decode(l4d_cuda_decoder_get_num_escapes(cuda, c, &escapes[c]));
    }
    indices = L4D_INIT(l4d_cuda_sh_indices);
    indices.depth = sh.depth;
    indices.index = sh.index;
    indices.stride = n;
    indices.escape = sh.escape;
    indices.num_escapes = escapes[L4D_COMPONENT_SH];
    place_cameras(info);
  }
  ~Stream() { l4d_cuda_decoder_destroy(cuda); }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  double time_of(int k) const {
    return timeline.time_begin + io::duration(timeline) * (k % 97 + 0.5) / 97;
  }
  const l4d_camera& camera_of(int k) const {
    return cameras[static_cast<size_t>(k) % cameras.size()];
  }

 private:
  template <typename T>
  T* array(size_t count) {
    const size_t bytes = std::max<size_t>(count, 1) * sizeof(T);
    arrays.push_back(std::make_unique<Array<unsigned char>>(bytes));
    return reinterpret_cast<T*>(arrays.back()->get());
  }
  void must_decode(l4d_status status) const {
    if (status == L4D_OK) return;
    std::fprintf(stderr, "%s\n", l4d_last_error_message());
    std::exit(1);
  }
  void place_cameras(const l4d_info& info) {
    l4d_query query = L4D_INIT(l4d_query);
    const GaussianArrays host = decoder.decode(query);
    io::Scene scene;
    scene.timeline = info.timeline;
    scene.placement = info.placement;
    static_cast<AttributeArrays&>(scene) = host;
    for (const io::Camera& c : io::orbit_cameras(scene, 8, kWidth, kHeight).cameras) {
      cameras.push_back(c.camera);
    }
  }
};

class Rendering {
 public:
  Rendering(const Stream& stream, uint32_t format, bool indexed, bool timed) : stream_(stream) {
    l4d_cuda_renderer_options options = L4D_INIT(l4d_cuda_renderer_options);
    options.sh_format = format;
    options.time_passes = timed;
    if (l4d_cuda_renderer_create(&options, &r_) != L4D_OK) std::exit(1);
    const size_t before = free_memory();
    const l4d_gaussians& g = stream.gaussians;
    if (indexed) {
      must(l4d_cuda_renderer_set_sh_codebooks(r_, stream.codebooks.data(),
                                              static_cast<uint32_t>(stream.codebooks.size())));
      l4d_gaussians geometry = g;
      geometry.sh = nullptr;
      must(l4d_cuda_renderer_set_gaussians(r_, &geometry, &stream.indices, &stream.timeline));
    } else {
      must(l4d_cuda_renderer_set_gaussians(r_, &g, nullptr, &stream.timeline));
    }
    bytes_ = static_cast<double>(before - free_memory()) / static_cast<double>(g.count);
    l4d_cuda_frame_capacity capacity = L4D_INIT(l4d_cuda_frame_capacity);
    capacity.width = kWidth;
    capacity.height = kHeight;
    capacity.visible = g.count;
    capacity.instances = 6 * g.count;
    must(l4d_cuda_renderer_reserve(r_, &capacity));
    check(cudaStreamCreate(&on_));
    image_ = L4D_INIT(l4d_cuda_image);
    image_.rgb = rgb_.get();
  }
  ~Rendering() {
    cudaStreamDestroy(on_);
    l4d_cuda_renderer_destroy(r_);
  }
  Rendering(const Rendering&) = delete;
  Rendering& operator=(const Rendering&) = delete;

  // A line of the table; the images are compared with those of `expanded`, if any. timed: the same
  // scene, whose frames time their passes.
  void run(const char* name, const Rendering& timed, Rendering* expanded) {
    const Timing t = time_runs(kRuns, on_, [&](int k) { frame(k); });
    double largest = 0;
    for (int k = 0; expanded != nullptr && k < 5; ++k) {
      const std::vector<float> a = image(k), b = expanded->image(k);
      for (size_t i = 0; i < a.size(); ++i) {
        largest = std::max(largest, std::fabs(static_cast<double>(a[i] - b[i])));
      }
    }
    l4d_cuda_frame_stats f = L4D_INIT(l4d_cuda_frame_stats);
    constexpr int kFrames = 64;
    double project = 0, visible = 0;
    for (int k = 0; k < kFrames; ++k) {
      timed.frame(k);
      must(l4d_cuda_renderer_get_stats(timed.r_, timed.on_, &f));
      project += f.seconds[L4D_RENDER_PASS_PROJECT] / kFrames;
      visible += static_cast<double>(f.visible) / kFrames;
    }
    std::printf("| %s | %.1f | %.0f | %.3f | %.3f | %.1f | %.0f | ", name, bytes_, 1e3 / t.median,
                t.median, t.p99, 1e6 * project, visible);
    if (expanded != nullptr) std::printf("%.2g", largest);
    std::printf(" |\n");
    std::fflush(stdout);
  }

 private:
  void frame(int k) const {
    must(l4d_cuda_renderer_render(r_, stream_.time_of(k), &stream_.camera_of(k), &image_, on_));
  }
  std::vector<float> image(int k) const {
    frame(k);
    check(cudaStreamSynchronize(on_));
    std::vector<float> out(3 * size_t{kWidth} * kHeight);
    check(cudaMemcpy(out.data(), rgb_.get(), out.size() * sizeof(float), cudaMemcpyDeviceToHost));
    return out;
  }

  const Stream& stream_;
  l4d_cuda_renderer* r_ = nullptr;
  cudaStream_t on_ = nullptr;
  const Array<float> rgb_{3 * size_t{kWidth} * kHeight};
  l4d_cuda_image image_;
  double bytes_ = 0;
};

void run(const std::string& file) {
  const Stream stream(file);
  std::printf("\n%s: %zu Gaussians, SH degree %u in %zu stages, %llu escapes\n\n", file.c_str(),
              static_cast<size_t>(stream.gaussians.count), stream.gaussians.sh_degree,
              stream.codebooks.size(), static_cast<unsigned long long>(stream.indices.num_escapes));
  std::puts(
      "| SH | bytes a Gaussian | frames/s | median ms | 99th percentile ms | project us "
      "| visible | largest difference |\n|---|---|---|---|---|---|---|---|");
  for (const uint32_t format : {L4D_CUDA_SH_FLOAT16, L4D_CUDA_SH_FLOAT32}) {
    const bool half = format == L4D_CUDA_SH_FLOAT16;
    Rendering expanded(stream, format, false, false), indexed(stream, format, true, false);
    const Rendering timed(stream, format, false, true), timed_indexed(stream, format, true, true);
    expanded.run(half ? "binary16" : "binary32", timed, nullptr);
    indexed.run(half ? "indices, binary16" : "indices, binary32", timed_indexed, &expanded);
  }
}

}  // namespace

int main(int argc, char** argv) {
  uint32_t count = 0;
  if (l4d_cuda_get_device_count(&count) != L4D_OK || count == 0) {
    std::puts("SKIPPED: there is no CUDA device");
    return 0;
  }
  try {
    for (int k = 1; k < argc; ++k) run(argv[k]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
  return 0;
}
