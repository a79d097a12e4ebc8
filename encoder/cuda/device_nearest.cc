// SPDX-License-Identifier: Apache-2.0
#include "encoder/cuda/device_nearest.h"

#include <algorithm>
#include <cstring>
#include <mutex>

#include "encoder/cuda/nearest_kernels.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/cuda/device.h"

namespace l4d::cuda {
namespace {

// Below this many differences of numbers, the way to the device and back takes longer than the search.
constexpr double kLeastWork = 2e7;
// Points go up in slices: one is copied while another is searched.
constexpr size_t kSliceBytes = size_t{8} << 20;
constexpr int kSlots = 3;
constexpr size_t kCopyGrain = size_t{256} << 10;

class Stream {
 public:
  ~Stream() {
    if (stream_ != nullptr) cudaStreamDestroy(stream_);
  }
  Status create() {
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking));
    return {};
  }
  cudaStream_t get() const { return stream_; }

 private:
  cudaStream_t stream_ = nullptr;
};

class DeviceNearest : public NearestDevice {
 public:
  DeviceNearest(int device, int threads) : device_(device), threads_(threads) {}


  bool search(const Job& job) override {
    const double work =
        static_cast<double>(job.n) * static_cast<double>(job.k) * static_cast<double>(job.dim);
    if (work < kLeastWork || !nearest_has_kernel(job.dim)) return false;
    // One caller at a time; the others have the host's cores.
    std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (!lock.owns_lock()) return false;
    if (state_ == State::kNew) state_ = open().ok() ? State::kOpen : State::kFailed;
    if (state_ == State::kFailed) return false;
    // A device that fails leaves this and all later work to the host, which begins from the start.
    if (run(job).ok()) return true;
    state_ = State::kFailed;
    return false;
  }

 private:
  enum class State { kNew, kOpen, kFailed };
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

  Status open() {
    L4D_RETURN_IF_ERROR(use_device(device_));
    for (Slot& slot : slots_) L4D_RETURN_IF_ERROR(slot.stream.create());
    return {};
  }

  Status run(const Job& job) {
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(device_));
    const size_t book_bytes = job.k * job.dim * sizeof(float);
    const size_t rows = std::min(
        job.n, std::max<size_t>(1, kSliceBytes / (job.dim * sizeof(float))));
    const Layout layout(rows, job.dim);
    L4D_RETURN_IF_ERROR(codebook_.reserve(book_bytes));
    for (Slot& slot : slots_) {
      L4D_RETURN_IF_ERROR(slot.host.reserve(layout.bytes));
      L4D_RETURN_IF_ERROR(slot.memory.reserve(layout.bytes));
      slot.count = 0;
    }
    L4D_RETURN_IF_CUDA_ERROR(
        cudaMemcpy(codebook_.data(), job.codebook, book_bytes, cudaMemcpyHostToDevice));
    size_t turn = 0;
    for (size_t first = 0; first < job.n; first += rows, ++turn) {
      Slot& slot = slots_[turn % kSlots];
      L4D_RETURN_IF_ERROR(collect(job, layout, slot));
      slot.first = first;
      slot.count = std::min(rows, job.n - first);
      L4D_RETURN_IF_ERROR(start(job, layout, slot));
    }
    for (size_t s = 0; s < kSlots; ++s) {
      L4D_RETURN_IF_ERROR(collect(job, layout, slots_[(turn + s) % kSlots]));
    }
    return {};
  }

  Status start(const Job& job, const Layout& layout, Slot& slot) {
    char* host = slot.host.as<char>();
    char* device = slot.memory.as<char>();
    copy(host, job.points + slot.first * job.dim, slot.count * job.dim * sizeof(float));
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

  Status collect(const Job& job, const Layout& layout, Slot& slot) {
    if (slot.count == 0) return {};
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(slot.stream.get()));
    const char* host = slot.host.as<char>();
    std::memcpy(job.labels + slot.first, host + layout.labels, slot.count * sizeof(uint32_t));
    std::memcpy(job.sq_dist + slot.first, host + layout.distances, slot.count * sizeof(float));
    slot.count = 0;
    return {};
  }

  void copy(void* to, const void* from, size_t bytes) const {
    parallel_for(threads_, bytes, kCopyGrain, [&](size_t begin, size_t end) {
      std::memcpy(static_cast<char*>(to) + begin, static_cast<const char*>(from) + begin, end - begin);
    });
  }

  const int device_;
  const int threads_;
  std::mutex mutex_;
  State state_ = State::kNew;
  DeviceMemory codebook_;
  Slot slots_[kSlots];
};

}  // namespace

std::unique_ptr<NearestDevice> make_device_nearest(int device, int threads) {
  return std::make_unique<DeviceNearest>(device, threads);
}

}  // namespace l4d::cuda
