// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/cuda/device_nearest.h"

#include <algorithm>
#include <cstring>
#include <mutex>
#include <utility>
#include <vector>

#include "encoder/search/cuda/nearest_kernels.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/cuda/device.h"

namespace l4d::cuda {
namespace {

// Below this many differences of numbers, the way to the device and back takes longer than the
// search.
constexpr double kMinWork = 2e7;
// The same where the points are there already, and for points to go there for tens of searches.
constexpr double kMinWorkHeld = 1e5;
constexpr double kMinWorkToHold = 2e6;
// Points go up in slices: one is copied while another is searched.
constexpr size_t kSliceBytes = size_t{4} << 20;
constexpr int kSlots = 3;
constexpr size_t kCopyGrain = size_t{512} << 10;
// SH and three components of a layer, each with points that stay and others that do not.
constexpr size_t kMostBusy = 8;

class Stream {
 public:
  ~Stream() {
    if (stream_ != nullptr) cudaStreamDestroy(stream_);
  }
  Status create() {
    if (stream_ != nullptr) return {};
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking));
    return {};
  }
  cudaStream_t get() const { return stream_; }

 private:
  cudaStream_t stream_ = nullptr;
};

void copy(int threads, void* to, const void* from, size_t bytes) {
  parallel_for(threads, bytes, kCopyGrain, [&](size_t begin, size_t end) {
    std::memcpy(static_cast<char*>(to) + begin, static_cast<const char*>(from) + begin,
                end - begin);
  });
}

// Memory and streams for one caller at a time.
class Workspace {
 public:
  // Whether its last work was done in full.
  bool sound() const { return sound_; }

  // Points from and results to arrays of the host.
  Status search(const NearestDevice::Job& job, int threads) {
    sound_ = false;
    for (Slot& slot : slots_) L4D_RETURN_IF_ERROR(slot.stream.create());
    const size_t rows =
        std::min(job.n, std::max<size_t>(1, kSliceBytes / (job.dim * sizeof(float))));
    const Layout layout(rows, job.dim);
    L4D_RETURN_IF_ERROR(put_codebook(job));
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(slots_[0].stream.get()));
    for (Slot& slot : slots_) slot.count = 0;
    size_t turn = 0;
    for (size_t first = 0; first < job.n; first += rows, ++turn) {
      Slot& slot = slots_[turn % kSlots];
      L4D_RETURN_IF_ERROR(collect(job, layout, slot));
      L4D_RETURN_IF_ERROR(slot.host.reserve(layout.bytes));
      L4D_RETURN_IF_ERROR(slot.memory.reserve(layout.bytes));
      slot.first = first;
      slot.count = std::min(rows, job.n - first);
      L4D_RETURN_IF_ERROR(start(job, layout, threads, slot));
    }
    for (size_t s = 0; s < kSlots; ++s) {
      L4D_RETURN_IF_ERROR(collect(job, layout, slots_[(turn + s) % kSlots]));
    }
    sound_ = true;
    return {};
  }

  // Takes points up that searches then are of, until other ones are.
  Status hold(const float* points, size_t n, size_t dim, int threads) {
    sound_ = false;
    for (Slot& slot : slots_) L4D_RETURN_IF_ERROR(slot.stream.create());
    const size_t bytes = n * dim * sizeof(float);
    L4D_RETURN_IF_ERROR(points_.reserve(bytes));
    L4D_RETURN_IF_ERROR(results_.reserve(2 * n * sizeof(float)));
    L4D_RETURN_IF_ERROR(host_results_.reserve(2 * n * sizeof(float)));
    size_t turn = 0;
    for (size_t first = 0; first < bytes; first += kSliceBytes, ++turn) {
      Slot& slot = slots_[turn % kSlots];
      L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(slot.stream.get()));
      L4D_RETURN_IF_ERROR(slot.host.reserve(std::min(bytes, kSliceBytes)));
      const size_t count = std::min(kSliceBytes, bytes - first);
      copy(threads, slot.host.data(), reinterpret_cast<const char*>(points) + first, count);
      L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(points_.as<char>() + first, slot.host.data(), count,
                                               cudaMemcpyHostToDevice, slot.stream.get()));
    }
    for (Slot& slot : slots_) L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(slot.stream.get()));
    sound_ = true;
    return {};
  }

  Status search_held(const NearestDevice::Job& job) {
    sound_ = false;
    const cudaStream_t stream = slots_[0].stream.get();
    const size_t bytes = job.n * sizeof(float);
    uint32_t* labels = results_.as<uint32_t>();
    float* sq_dist = results_.as<float>() + job.n;
    L4D_RETURN_IF_ERROR(put_codebook(job));
    if (job.keep) {
      std::memcpy(host_results_.data(), job.labels, bytes);
      std::memcpy(host_results_.as<char>() + bytes, job.sq_dist, bytes);
      L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(results_.data(), host_results_.data(), 2 * bytes,
                                               cudaMemcpyHostToDevice, stream));
    }
    L4D_RETURN_IF_CUDA_ERROR(launch_nearest(points_.as<float>(), job.n, job.dim,
                                            codebook_.as<float>(), job.k, job.first_label, job.keep,
                                            labels, sq_dist, stream));
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(host_results_.data(), results_.data(), 2 * bytes,
                                             cudaMemcpyDeviceToHost, stream));
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
    std::memcpy(job.labels, host_results_.data(), bytes);
    std::memcpy(job.sq_dist, host_results_.as<char>() + bytes, bytes);
    sound_ = true;
    return {};
  }

 private:
  struct Slot {
    Stream stream;
    PinnedMemory host;
    DeviceMemory memory;
    size_t first = 0, count = 0;  // of the points under way
  };

  // Of one slice: points, then labels, then distances.
  struct Layout {
    size_t points, labels, distances, bytes;
    Layout(size_t rows, size_t dim)
        : points(0),
          labels(rows * dim * sizeof(float)),
          distances(labels + rows * sizeof(uint32_t)),
          bytes(distances + rows * sizeof(float)) {}
  };

  // In the order of the first slot's stream.
  Status put_codebook(const NearestDevice::Job& job) {
    const size_t bytes = job.k * job.dim * sizeof(float);
    L4D_RETURN_IF_ERROR(codebook_.reserve(bytes));
    L4D_RETURN_IF_ERROR(host_codebook_.reserve(bytes));
    std::memcpy(host_codebook_.data(), job.codebook, bytes);
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(codebook_.data(), host_codebook_.data(), bytes,
                                             cudaMemcpyHostToDevice, slots_[0].stream.get()));
    return {};
  }

  Status start(const NearestDevice::Job& job, const Layout& layout, int threads, Slot& slot) {
    char* host = slot.host.as<char>();
    char* device = slot.memory.as<char>();
    copy(threads, host, job.points + slot.first * job.dim, slot.count * job.dim * sizeof(float));
    const size_t number_bytes = slot.count * sizeof(uint32_t);
    if (job.keep) {
      std::memcpy(host + layout.labels, job.labels + slot.first, number_bytes);
      std::memcpy(host + layout.distances, job.sq_dist + slot.first, number_bytes);
    }
    const size_t up = job.keep ? layout.bytes : slot.count * job.dim * sizeof(float);
    const cudaStream_t stream = slot.stream.get();
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(device, host, up, cudaMemcpyHostToDevice, stream));
    L4D_RETURN_IF_CUDA_ERROR(launch_nearest(
        reinterpret_cast<const float*>(device), slot.count, job.dim, codebook_.as<float>(), job.k,
        job.first_label, job.keep, reinterpret_cast<uint32_t*>(device + layout.labels),
        reinterpret_cast<float*>(device + layout.distances), stream));
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(host + layout.labels, device + layout.labels,
                                             layout.bytes - layout.labels, cudaMemcpyDeviceToHost,
                                             stream));
    return {};
  }

  Status collect(const NearestDevice::Job& job, const Layout& layout, Slot& slot) {
    if (slot.count == 0) return {};
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(slot.stream.get()));
    const char* host = slot.host.as<char>();
    std::memcpy(job.labels + slot.first, host + layout.labels, slot.count * sizeof(uint32_t));
    std::memcpy(job.sq_dist + slot.first, host + layout.distances, slot.count * sizeof(float));
    slot.count = 0;
    return {};
  }

  bool sound_ = true;
  // Streams last: they end before the memory that they work on.
  PinnedMemory host_codebook_, host_results_;
  DeviceMemory codebook_, points_, results_;
  Slot slots_[kSlots];
};

class DeviceNearest : public NearestDevice {
 public:
  DeviceNearest(int device, int threads) : device_(device), threads_(threads) {}

  bool search(const Job& job) override {
    const double work =
        static_cast<double>(job.n) * static_cast<double>(job.k) * static_cast<double>(job.dim);
    if (job.held != nullptr) {
      Held& held = static_cast<Held&>(*job.held);
      if (held.points == job.points && held.n == job.n && held.dim == job.dim) {
        if (work < kMinWorkHeld || !enter()) return false;
        return keep_trust(held.workspace->search_held(job));
      }
    }
    if (work < kMinWork || !nearest_has_kernel(job.dim) || !enter()) return false;
    std::unique_ptr<Workspace> workspace = take();
    if (workspace == nullptr) return false;  // the host's cores are there for it
    const bool done = keep_trust(workspace->search(job, threads_));
    give_back(std::move(workspace));
    return done;
  }

  std::unique_ptr<HeldPoints> hold(const float* points, size_t n, size_t dim, size_t k) override {
    const double work = static_cast<double>(n) * static_cast<double>(k) * static_cast<double>(dim);
    if (work < kMinWorkToHold || !nearest_has_kernel(dim) || !enter()) return nullptr;
    auto held = std::make_unique<Held>(*this);
    held->workspace = take();
    held->points = points;
    held->n = n;
    held->dim = dim;
    if (held->workspace == nullptr) return nullptr;
    return keep_trust(held->workspace->hold(points, n, dim, threads_)) ? std::move(held) : nullptr;
  }

 private:
  enum class State { kNew, kOpen, kFailed };

  struct Held : HeldPoints {
    explicit Held(DeviceNearest& from) : device(from) {}
    ~Held() override {
      if (workspace != nullptr) device.give_back(std::move(workspace));
    }
    DeviceNearest& device;
    std::unique_ptr<Workspace> workspace;
    const float* points = nullptr;
    size_t n = 0, dim = 0;
  };

  // Makes the device the calling thread's. One that has failed leaves this and all later work to
  // the host, which begins from the start.
  bool enter() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (state_ == State::kNew) state_ = use_device(device_).ok() ? State::kOpen : State::kFailed;
    return state_ == State::kOpen && cudaSetDevice(device_) == cudaSuccess;
  }

  bool keep_trust(const Status& status) {
    if (status.ok()) return true;
    const std::lock_guard<std::mutex> lock(mutex_);
    state_ = State::kFailed;
    return false;
  }

  // Null where all are busy. Those that come back are used again: memory of either kind is slow to
  // get.
  std::unique_ptr<Workspace> take() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (busy_ == kMostBusy) return nullptr;
    ++busy_;
    if (idle_.empty()) return std::make_unique<Workspace>();
    std::unique_ptr<Workspace> workspace = std::move(idle_.back());
    idle_.pop_back();
    return workspace;
  }

  void give_back(std::unique_ptr<Workspace> workspace) {
    const std::lock_guard<std::mutex> lock(mutex_);
    --busy_;
    if (workspace->sound()) idle_.push_back(std::move(workspace));
  }

  const int device_;
  const int threads_;
  std::mutex mutex_;
  State state_ = State::kNew;
  size_t busy_ = 0;
  std::vector<std::unique_ptr<Workspace>> idle_;
};

}  // namespace

std::unique_ptr<NearestDevice> make_device_nearest(int device, int threads) {
  return std::make_unique<DeviceNearest>(device, threads);
}

}  // namespace l4d::cuda
