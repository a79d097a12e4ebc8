// SPDX-License-Identifier: Apache-2.0
// Playing streams from a cache of buckets: wall time of frames from the call to the finished image,
// while a thread reads and decodes what comes next; seeks; memory.
//
//   gpu_playback_bench [--fps N] [--seconds S] [--seeks N] FILE...
//
// --fps: frames per second of the sequence, 60 unless given; frames are drawn as fast as they come,
// not at that pace. --seconds: how much of the sequence is played, all unless given.
#include <cuda_runtime_api.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "io/camera/cameras.h"
#include "l4d/experimental/cuda_player.h"
#include "l4d/l4d.hpp"

namespace {

using namespace l4d;
using Clock = std::chrono::steady_clock;

constexpr uint32_t kWidth = 1352, kHeight = 1014;

void check(cudaError_t error) {
  if (error == cudaSuccess) return;
  std::fprintf(stderr, "%s\n", cudaGetErrorString(error));
  std::exit(1);
}

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

uint64_t device_memory_in_use() {
  size_t free = 0, total = 0;
  check(cudaMemGetInfo(&free, &total));
  return total - free;
}

struct Timing {
  double median, p99, most;  // milliseconds
};
Timing timing_of(std::vector<double> seconds) {
  std::sort(seconds.begin(), seconds.end());
  return {1e3 * seconds[seconds.size() / 2],
          1e3 * seconds[seconds.size() - 1 - seconds.size() / 100], 1e3 * seconds.back()};
}

// Cameras around what is visible in the middle of the sequence.
std::vector<l4d_camera> cameras_of(const DecoderHandle& decoder) {
  const l4d_info info = decoder.info();
  l4d_query query = L4D_INIT(l4d_query);
  query.kind = L4D_QUERY_TIME;
  query.time_begin = info.timeline.time_begin + 0.5 * info.duration;
  const GaussianArrays now = decoder.decode(query);
  io::Scene scene;
  scene.timeline = info.timeline;
  static_cast<AttributeArrays&>(scene) = now;
  std::vector<l4d_camera> cameras;
  for (const io::Camera& c : io::orbit_cameras(scene, 8, kWidth, kHeight).cameras) {
    cameras.push_back(c.camera);
  }
  return cameras;
}

l4d_reader reader_of(std::FILE* file) {
  l4d_reader r = L4D_INIT(l4d_reader);
  r.user = file;
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    return pread(fileno(static_cast<std::FILE*>(user)), dst, n, static_cast<off_t>(offset));
  };
  r.size = [](void* user) -> int64_t {
    struct stat s {};
    return fstat(fileno(static_cast<std::FILE*>(user)), &s) == 0 ? s.st_size : -1;
  };
  return r;
}

class Playback {
 public:
  explicit Playback(const char* path) {
    decoder_.open_file(path);
    cameras_ = cameras_of(decoder_);
    file_ = std::fopen(path, "rb");
    before_ = device_memory_in_use();
    const l4d_reader reader = reader_of(file_);
    l4d_cuda_player_options options = L4D_INIT(l4d_cuda_player_options);
    options.reader = &reader;
    const l4d_status status = l4d_cuda_player_create(&options, &player_);
    if (status != L4D_OK) {
      std::fprintf(stderr, "%s: %s\n", path, l4d_status_name(status));
      std::exit(1);
    }
    must(l4d_cuda_player_reserve(player_, kWidth, kHeight, 3 << 20));
    void* rgba8 = nullptr;
    check(cudaMalloc(&rgba8, size_t{kWidth} * kHeight * 4));
    image_ = L4D_INIT(l4d_cuda_image);
    image_.rgba8 = static_cast<uint32_t*>(rgba8);
    int lowest = 0, highest = 0;
    check(cudaDeviceGetStreamPriorityRange(&lowest, &highest));
    check(cudaStreamCreateWithPriority(&stream_, cudaStreamNonBlocking, highest));
  }
  ~Playback() {
    l4d_cuda_player_destroy(player_);
    std::fclose(file_);
    cudaFree(image_.rgba8);
    cudaStreamDestroy(stream_);
  }
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  void must(l4d_status status) const {
    if (status == L4D_OK) return;
    std::fprintf(stderr, "%s\n", l4d_last_error_message());
    std::exit(1);
  }
  // Seconds from the call until the image is there.
  double frame(double time, size_t k) const {
    const Clock::time_point begin = Clock::now();
    must(l4d_cuda_player_render(player_, time, &cameras_[k / 90 % cameras_.size()], &image_,
                                stream_));
    check(cudaStreamSynchronize(stream_));
    return seconds_since(begin);
  }
  void seek(double time) const { must(l4d_cuda_player_seek(player_, time)); }
  l4d_cuda_frame_stats stats() const {
    l4d_cuda_frame_stats f = L4D_INIT(l4d_cuda_frame_stats);
    must(l4d_cuda_player_get_stats(player_, stream_, &f));
    return f;
  }
  l4d_cuda_player_counters counters() const {
    l4d_cuda_player_counters c = L4D_INIT(l4d_cuda_player_counters);
    must(l4d_cuda_player_get_counters(player_, &c));
    return c;
  }
  l4d_info info() const { return decoder_.info(); }
  uint64_t memory() const { return device_memory_in_use() - before_; }

 private:
  DecoderHandle decoder_;
  std::FILE* file_ = nullptr;
  std::vector<l4d_camera> cameras_;
  uint64_t before_ = 0;
  l4d_cuda_player* player_ = nullptr;
  l4d_cuda_image image_{};
  cudaStream_t stream_ = nullptr;
};

void play(const char* path, double fps, double limit, int seeks) {
  const Playback p(path);
  const l4d_info info = p.info();
  const double begin = info.timeline.time_begin, length = std::min(info.duration, limit);
  const auto frames = static_cast<size_t>(std::max(1.0, std::floor(length * fps)));
  // The first frames make room for themselves.
  for (size_t k = 0; k < 60; ++k) p.frame(begin + static_cast<double>(k) / fps, 0);
  p.seek(begin);
  const l4d_cuda_player_counters warm = p.counters();
  std::vector<double> seconds;
  double visible = 0;
  const Clock::time_point started = Clock::now();
  for (size_t k = 0; k < frames; ++k)
    seconds.push_back(p.frame(begin + static_cast<double>(k) / fps, k));
  const double all = seconds_since(started);
  const l4d_cuda_player_counters c = p.counters();
  for (int k = 0; k < 16; ++k) {
    p.frame(begin + length * (k + 0.5) / 16, 0);
    visible += static_cast<double>(p.stats().visible) / 16;
  }
  const Timing t = timing_of(seconds);
  std::printf("%s: %.0f s, %llu Gaussians, %.0f visible\n", path, info.duration,
              static_cast<unsigned long long>(info.num_gaussians), visible);
  std::printf(
      "  forward, %g frames per second of the sequence, %zu frames: %.0f drawn per second (%.1f "
      "times "
      "its pace); ms a frame: median %.3f, 99th percentile %.3f, most %.3f\n",
      fps, frames, static_cast<double>(frames) / all, length / all, t.median, t.p99, t.most);
  std::printf(
      "  %llu frames, %llu waited for (%.1f ms in all); %llu Gaussians decoded, %.1f MB "
      "uploaded\n",
      static_cast<unsigned long long>(c.frames - warm.frames),
      static_cast<unsigned long long>(c.stalls - warm.stalls),
      1e3 * (c.stall_seconds - warm.stall_seconds),
      static_cast<unsigned long long>(c.gaussians_decoded - warm.gaussians_decoded),
      1e-6 * static_cast<double>(c.bytes_uploaded - warm.bytes_uploaded));
  std::printf("  memory in MB: store %.1f, to decode in %.1f, all %.1f\n",
              1e-6 * static_cast<double>(c.store_bytes),
              1e-6 * static_cast<double>(c.scratch_bytes), 1e-6 * static_cast<double>(p.memory()));
  if (seeks > 0) {
    std::mt19937 random(7);
    std::uniform_real_distribution<double> anywhere(begin, begin + info.duration);
    seconds.clear();
    for (int k = 0; k < seeks; ++k) seconds.push_back(p.frame(anywhere(random), 0));
    const Timing s = timing_of(seconds);
    std::printf(
        "  %d random seeks, ms until the image is there: median %.2f, 99th percentile %.2f\n",
        seeks, s.median, s.p99);
  }
}

}  // namespace

int main(int argc, char** argv) {
  double fps = 60, seconds = 1e9;
  int seeks = 200;
  std::vector<const char*> files;
  for (int i = 1; i < argc; ++i) {
    const auto number = [&] { return i + 1 < argc ? std::atof(argv[++i]) : 0.0; };
    if (std::strcmp(argv[i], "--fps") == 0) {
      fps = number();
    } else if (std::strcmp(argv[i], "--seconds") == 0) {
      seconds = number();
    } else if (std::strcmp(argv[i], "--seeks") == 0) {
      seeks = static_cast<int>(number());
    } else {
      files.push_back(argv[i]);
    }
  }
  if (files.empty() || !(fps > 0) || !(seconds > 0)) {
    std::fprintf(stderr, "usage: gpu_playback_bench [--fps N] [--seconds S] [--seeks N] FILE...\n");
    return 2;
  }
  try {
    for (const char* file : files) play(file, fps, seconds, seeks);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 1;
  }
}
