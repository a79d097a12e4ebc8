// SPDX-License-Identifier: Apache-2.0
// Decoding on the device: time of a query, with and without the upload, what its two steps take,
// and the floors beside them. Times are the device's own, medians of many; every result was
// compared with the host's once before.
//
// usage: gpu_decode_bench [--runs N] [--time SECONDS] [--base] FILE...
#include <cuda_runtime_api.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "l4d/cuda.h"
#include "l4d/experimental/cuda_packed.h"
#include "l4d/l4d.hpp"

namespace {

using namespace l4d;

// Measured on an H200: a copy between device arrays, and one from pinned memory.
constexpr double kDeviceBytesPerSecond = 4.27e12;
constexpr double kUploadBytesPerSecond = 55e9;

void cuda_check(cudaError_t error) {
  if (error == cudaSuccess) return;
  std::fprintf(stderr, "%s\n", cudaGetErrorString(error));
  std::exit(1);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

double seconds_now() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

class DeviceArray {
 public:
  explicit DeviceArray(uint64_t bytes) { cuda_check(cudaMalloc(&data_, bytes + 1)); }
  ~DeviceArray() { cudaFree(data_); }
  DeviceArray(const DeviceArray&) = delete;
  DeviceArray& operator=(const DeviceArray&) = delete;
  void* data() const { return data_; }
  float* floats() const { return static_cast<float*>(data_); }

 private:
  void* data_ = nullptr;
};

// Median seconds of `call`, before each of which `before` runs untimed.
double median_time(int runs, cudaStream_t stream, const std::function<void()>& before,
                   const std::function<void()>& call) {
  cudaEvent_t begin = nullptr, end = nullptr;
  cuda_check(cudaEventCreate(&begin));
  cuda_check(cudaEventCreate(&end));
  std::vector<double> seconds;
  for (int i = 0; i < runs + 3; ++i) {
    before();
    cuda_check(cudaEventRecord(begin, stream));
    call();
    cuda_check(cudaEventRecord(end, stream));
    cuda_check(cudaEventSynchronize(end));
    float ms = 0;
    cuda_check(cudaEventElapsedTime(&ms, begin, end));
    if (i >= 3) seconds.push_back(1e-3 * static_cast<double>(ms));
  }
  cuda_check(cudaEventDestroy(begin));
  cuda_check(cudaEventDestroy(end));
  return median(seconds);
}

class Query {
 public:
  Query(DecoderHandle& decoder, const l4d_query& query) : decoder_(decoder), query_(query) {
    decoder.check(l4d_cuda_decoder_create(decoder.get(), 0, &cuda_));
    const uint32_t degree = decoder.info().sh_degree;
    sh_dim_ = 3 * (degree + 1) * (degree + 1);
    host_ = decoder.decode(query);
    for (uint32_t l = 0; l < decoder.info().num_layers; ++l) {
      const l4d_layer_info layer = decoder.layer_info(l);
      for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        stages_[c] = std::max<uint64_t>(stages_[c], layer.num_stages[c]);
      }
    }
    cuda_check(cudaStreamCreate(&stream_));
  }
  ~Query() {
    l4d_cuda_decoder_destroy(cuda_);
    cudaStreamDestroy(stream_);
  }
  Query(const Query&) = delete;
  Query& operator=(const Query&) = delete;

  void run(const char* name, int runs) {
    l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
    check(l4d_cuda_decoder_prepare(cuda_, &query_, &request));
    std::vector<double> prepares;
    for (int i = 0; i < 10; ++i) {
      const double started = seconds_now();
      check(l4d_cuda_decoder_prepare(cuda_, &query_, &request));
      prepares.push_back(seconds_now() - started);
    }
    const double prepare = median(prepares);
    const uint64_t n = request.num_gaussians;
    const DeviceArray position(n * 12), mean_t(n * 4), mean_t_local(n * 4), log_scale(n * 16),
        rotor(n * 32), opacity(n * 4), sh(n * sh_dim_ * 4), workspace(request.workspace_bytes);
    l4d_cuda_gaussian_buffers none = L4D_INIT(l4d_cuda_gaussian_buffers);
    none.capacity = n;
    l4d_cuda_gaussian_buffers geometry = none;
    geometry.position = position.floats();
    geometry.mean_t = mean_t.floats();
    geometry.mean_t_local = mean_t_local.floats();
    geometry.log_scale = log_scale.floats();
    geometry.rotor = rotor.floats();
    geometry.opacity = opacity.floats();
    l4d_cuda_gaussian_buffers all = geometry;
    all.sh = sh.floats();
    const auto upload = [&] {
      check(l4d_cuda_decoder_upload(cuda_, workspace.data(), request.workspace_bytes, stream_));
    };
    const auto decode = [&](const l4d_cuda_gaussian_buffers& out) {
      check(
          l4d_cuda_decoder_decode(cuda_, &out, workspace.data(), request.workspace_bytes, stream_));
    };
    decode(all);
    check(l4d_cuda_decoder_finish(cuda_));
    compare("sh", sh, host_.sh);
    compare("rotor", rotor, host_.rotor);
    compare("log_scale", log_scale, host_.log_scale);
    compare("position", position, host_.position);
    compare("mean_t_local", mean_t_local, host_.mean_t_local);

    const double with_upload = median_time(
        runs, stream_, [] {}, [&] { decode(all); });
    const auto without = [&](const l4d_cuda_gaussian_buffers& out) {
      return median_time(runs, stream_, upload, [&] { decode(out); });
    };
    const double whole = without(all), channels = without(none), no_sh = without(geometry);
    const double upload_only = median_time(
        runs, stream_, [] {}, upload);
    const double bytes = 4.0 * static_cast<double>(n * (18 + sh_dim_));
    std::printf("%s: %llu Gaussians in %llu pages, %.2f MB up, %.1f MB out, workspace %.1f MB\n",
                name, static_cast<unsigned long long>(n),
                static_cast<unsigned long long>(request.num_pages),
                1e-6 * static_cast<double>(request.upload_bytes), 1e-6 * bytes,
                1e-6 * static_cast<double>(request.workspace_bytes));
    std::printf("  prepare (host)          %9.3f ms\n", 1e3 * prepare);
    std::printf("  upload                  %9.3f ms, floor %.3f\n", 1e3 * upload_only,
                1e3 * static_cast<double>(request.upload_bytes) / kUploadBytesPerSecond);
    std::printf("  channels                  %9.3f ms\n", 1e3 * channels);
    std::printf("  geometry                %9.3f ms, floor %.3f\n", 1e3 * (no_sh - channels),
                1e3 * static_cast<double>(n) * 72 / kDeviceBytesPerSecond);
    std::printf("  sh                      %9.3f ms, floor %.3f\n", 1e3 * (whole - no_sh),
                1e3 * static_cast<double>(n * sh_dim_) * 4 / kDeviceBytesPerSecond);
    std::printf("  decode                  %9.3f ms, %.0f GB/s of output\n", 1e3 * whole,
                1e-9 * bytes / whole);
    std::printf("  decode with upload      %9.3f ms, %.0f GB/s of output\n", 1e3 * with_upload,
                1e-9 * bytes / with_upload);
    run_packed(runs);
    std::fflush(stdout);
  }

 private:
  // All arrays of the packed form, which are compared with the host's like the others.
  void run_packed(int runs) {
    l4d_cuda_request request = L4D_INIT(l4d_cuda_request);
    request.forms = L4D_CUDA_FORM_PACKED;
    const l4d_status prepared = l4d_cuda_decoder_prepare(cuda_, &query_, &request);
    if (prepared == L4D_ERR_FEATURE_UNSUPPORTED) return;
    check(prepared);
    const uint64_t n = request.num_gaussians;
    std::vector<uint64_t> bytes = {6 * n, 2 * n, 2 * n, 2 * n};
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const uint64_t dim = c == L4D_COMPONENT_SH ? sh_dim_ : 4;
      for (const uint64_t b : {n, 2 * n * stages_[c], 2 * n * dim}) bytes.push_back(b);
    }
    std::vector<std::unique_ptr<DeviceArray>> arrays;
    for (const uint64_t b : bytes) {
      arrays.push_back(std::make_unique<DeviceArray>(b));
      // Of a layer with fewer stages than others some indices stay as they are.
      cuda_check(cudaMemset(arrays.back()->data(), 0, b));
    }
    const DeviceArray workspace(request.workspace_bytes);
    const auto halves = [&](size_t k) { return static_cast<uint16_t*>(arrays[k]->data()); };
    l4d_cuda_packed_buffers out = L4D_INIT(l4d_cuda_packed_buffers);
    out.capacity = n;
    out.position = halves(0);
    out.mean_t = halves(1);
    out.opacity = halves(2);
    out.scale_factor = halves(3);
    for (size_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      out.component[c] = {static_cast<uint8_t*>(arrays[4 + 3 * c]->data()), halves(5 + 3 * c),
                          halves(6 + 3 * c), n};
    }
    const auto decode = [&] {
      check(l4d_cuda_decoder_decode_packed(cuda_, &out, workspace.data(), request.workspace_bytes,
                                           stream_));
    };
    decode();
    check(l4d_cuda_decoder_finish(cuda_));
    uint64_t escapes[L4D_COMPONENT_COUNT];
    for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      check(l4d_cuda_decoder_get_num_escapes(cuda_, c, &escapes[c]));
    }
    compare_packed(bytes, arrays, escapes);
    double size = 0;
    for (unsigned k = 0; k < bytes.size(); ++k) {
      const bool is_escape = k >= 4 && (k - 4) % 3 == 2;
      const uint64_t rows = is_escape ? escapes[(k - 4) / 3] : n;
      size += n == 0 ? 0 : static_cast<double>(bytes[k] / n * rows);
    }
    const double whole = median_time(
        runs, stream_,
        [&] {
          check(l4d_cuda_decoder_upload(cuda_, workspace.data(), request.workspace_bytes, stream_));
        },
        decode);
    const double with_upload = median_time(
        runs, stream_, [] {}, decode);
    std::printf("  packed, %5.1f MB out    %9.3f ms, %.0f GB/s of it, %.0f of what it expands to\n",
                1e-6 * size, 1e3 * whole, 1e-9 * size / whole,
                4e-9 * static_cast<double>(n * (18 + sh_dim_)) / whole);
    std::printf("  packed with upload      %9.3f ms\n", 1e3 * with_upload);
  }

  void compare_packed(const std::vector<uint64_t>& bytes,
                      const std::vector<std::unique_ptr<DeviceArray>>& arrays,
                      const uint64_t* escapes) {
    std::vector<std::vector<unsigned char>> host;
    for (const uint64_t b : bytes) host.emplace_back(static_cast<size_t>(b) + 1);
    const auto halves = [&](size_t k) { return reinterpret_cast<uint16_t*>(host[k].data()); };
    l4d_packed_buffers out = L4D_INIT(l4d_packed_buffers);
    out.capacity = bytes[1] / 2;
    out.position = halves(0);
    out.mean_t = halves(1);
    out.opacity = halves(2);
    out.scale_factor = halves(3);
    for (size_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      out.component[c] = {host[4 + 3 * c].data(), halves(5 + 3 * c), halves(6 + 3 * c),
                          out.capacity, 0};
    }
    decoder_.check(l4d_decoder_decode_packed(decoder_.get(), &query_, &out));
    for (size_t k = 0; k < bytes.size(); ++k) {
      uint64_t size = bytes[k];
      if (k >= 4 && (k - 4) % 3 == 2 && out.capacity > 0) {
        const size_t c = (k - 4) / 3;
        if (out.component[c].num_escapes != escapes[c]) {
          std::fprintf(stderr, "numbers of escapes differ\n");
          std::exit(1);
        }
        size = size / out.capacity * escapes[c];
      }
      std::vector<unsigned char> found(static_cast<size_t>(size));
      cuda_check(cudaMemcpy(found.data(), arrays[k]->data(), found.size(), cudaMemcpyDeviceToHost));
      if (std::memcmp(found.data(), host[k].data(), found.size()) == 0) continue;
      std::fprintf(stderr, "packed array %zu differs between device and host\n", k);
      std::exit(1);
    }
  }

  void check(l4d_status status) const {
    if (status == L4D_OK) return;
    std::fprintf(stderr, "%s\n", l4d_last_error_message());
    std::exit(1);
  }
  static void compare(const char* what, const DeviceArray& device, const std::vector<float>& host) {
    std::vector<float> found(host.size());
    cuda_check(cudaMemcpy(found.data(), device.data(), found.size() * sizeof(float),
                          cudaMemcpyDeviceToHost));
    if (std::memcmp(found.data(), host.data(), host.size() * sizeof(float)) == 0) return;
    std::fprintf(stderr, "%s differs between device and host\n", what);
    std::exit(1);
  }

  DecoderHandle& decoder_;
  const l4d_query query_;
  l4d_cuda_decoder* cuda_ = nullptr;
  uint64_t sh_dim_ = 0;
  uint64_t stages_[L4D_COMPONENT_COUNT] = {};
  GaussianArrays host_;
  cudaStream_t stream_ = nullptr;
};

int run(int argc, char** argv) {
  int runs = 60;
  l4d_query query = L4D_INIT(l4d_query);
  std::vector<std::string> files;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--runs") == 0 && i + 1 < argc) {
      runs = std::max(1, std::atoi(argv[++i]));
    } else if (std::strcmp(argv[i], "--time") == 0 && i + 1 < argc) {
      query.kind = L4D_QUERY_TIME;
      query.time_begin = std::atof(argv[++i]);
    } else if (std::strcmp(argv[i], "--base") == 0) {
      query.point.detail = L4D_DETAIL_BASE_COLOR;
    } else {
      files.emplace_back(argv[i]);
    }
  }
  if (files.empty()) {
    std::fprintf(stderr, "usage: gpu_decode_bench [--runs N] [--time SECONDS] [--base] FILE...\n");
    return 2;
  }
  for (const std::string& file : files) {
    DecoderHandle decoder;
    decoder.open_file(file);
    Query(decoder, query).run(file.c_str(), runs);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
}
