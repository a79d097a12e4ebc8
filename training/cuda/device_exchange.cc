// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/device_exchange.h"

#include <algorithm>
#include <string>

#include "l4d/cuda.h"
#include "l4d/l4d.hpp"
#include "libl4dcodec/cuda/device.h"
#include "training/cuda/add_members.h"

namespace l4d::train {
namespace {

constexpr uint64_t kAlignedRows = 64;  // so that parts begin at words of 16 bytes

size_t bytes_of(SumArray::Kind kind) { return kind == SumArray::kFlag ? 1 : 4; }
size_t row_bytes(const SumArray& a) { return a.width * bytes_of(a.kind); }
uint8_t* row(const SumArray& a, uint64_t i) {
  return static_cast<uint8_t*>(a.data) + static_cast<size_t>(i) * row_bytes(a);
}
size_t aligned(size_t bytes) { return (bytes + 255) / 256 * 256; }
cudaStream_t stream_of(const StepSums& sums) { return static_cast<cudaStream_t>(sums.stream); }

struct RowRange {
  uint64_t begin, end;
  size_t count() const { return static_cast<size_t>(end - begin); }
};

// The rows that a member adds up.
RowRange part_of(uint64_t rows, size_t member, size_t members) {
  const auto border = [&](size_t k) {
    return k == members ? rows : rows * k / members / kAlignedRows * kAlignedRows;
  };
  return {border(member), border(member + 1)};
}

class DeviceExchange final : public Exchange {
 public:
  // Members are destroyed after it: by then none may be in the memory of another.
  ~DeviceExchange() override {
    for (size_t k = 0; k < members_.size(); ++k) {
      cudaSetDevice(members_[k].device);
      cudaDeviceSynchronize();
      for (cudaEvent_t event : {members_[k].ready, members_[k].added, members_[k].done}) {
        if (event != nullptr) cudaEventDestroy(event);
      }
    }
  }
  Status init(const std::vector<uint32_t>& devices, Transport transport);
  void add_up(const std::vector<StepSums>& sums) override {
    const Status status = try_add_up(sums);
    if (!status.ok()) throw Error(status.code(), status.detail());
  }

 private:
  struct Member {
    int device = 0;
    // Its sums are complete; its part is added up; it has all parts.
    cudaEvent_t ready = nullptr, added = nullptr, done = nullptr;
    cuda::DeviceMemory scratch;
  };

  Status enable_access(size_t from, size_t to);
  // Whether kernels of `member` reach the memory of `other`.
  bool reaches(size_t member, size_t other) const {
    return reaches_[member * members_.size() + other] != 0;
  }
  Status try_add_up(const std::vector<StepSums>& sums);
  Status add_part(const std::vector<StepSums>& sums, size_t k);
  Status take_parts(const std::vector<StepSums>& sums, size_t k);
  Status wait_for(cudaEvent_t Member::*event, const std::vector<StepSums>& sums, size_t k);
  // Copies to memory of `to` in its stream.
  Status copy(size_t to, void* target, size_t from, const void* source, size_t bytes,
              const StepSums& sums) const;
  Status fetch(const std::vector<StepSums>& sums, size_t k, size_t other, uint8_t** scratch,
               MemberArrays* arrays);

  std::vector<Member> members_;
  std::vector<uint8_t> reaches_;  // [members, members]
};

Status DeviceExchange::enable_access(size_t from, size_t to) {
  const int device = members_[from].device, other = members_[to].device;
  uint8_t& reaches = reaches_[from * members_.size() + to];
  int can = 1;
  if (device != other) {
    L4D_RETURN_IF_CUDA_ERROR(cudaDeviceCanAccessPeer(&can, device, other));
    if (can == 0) return {};
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(device));
    const cudaError_t error = cudaDeviceEnablePeerAccess(other, 0);
    if (error == cudaErrorPeerAccessAlreadyEnabled) {
      static_cast<void>(cudaGetLastError());
    } else {
      L4D_RETURN_IF_CUDA_ERROR(error);
    }
  }
  reaches = 1;
  return {};
}

Status DeviceExchange::init(const std::vector<uint32_t>& devices, Transport transport) {
  members_.resize(devices.size());
  reaches_.assign(devices.size() * devices.size(), 0);
  for (size_t k = 0; k < devices.size(); ++k) {
    Member& m = members_[k];
    m.device = static_cast<int>(devices[k]);
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(m.device));
    for (cudaEvent_t* event : {&m.ready, &m.added, &m.done}) {
      L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(event, cudaEventDisableTiming));
    }
  }
  for (size_t k = 0; k < devices.size() && transport == Transport::kDirect; ++k) {
    for (size_t j = 0; j < devices.size(); ++j) {
      if (j != k) L4D_RETURN_IF_ERROR(enable_access(k, j));
    }
  }
  return {};
}

Status DeviceExchange::wait_for(cudaEvent_t Member::*event, const std::vector<StepSums>& sums,
                                size_t k) {
  for (size_t j = 0; j < members_.size(); ++j) {
    if (j == k) continue;
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(stream_of(sums[k]), members_[j].*event, 0));
  }
  return {};
}

Status DeviceExchange::copy(size_t to, void* target, size_t from, const void* source, size_t bytes,
                            const StepSums& sums) const {
  if (bytes == 0) return {};
  const int device = members_[to].device, other = members_[from].device;
  if (device == other) {
    L4D_RETURN_IF_CUDA_ERROR(
        cudaMemcpyAsync(target, source, bytes, cudaMemcpyDeviceToDevice, stream_of(sums)));
  } else {
    L4D_RETURN_IF_CUDA_ERROR(
        cudaMemcpyPeerAsync(target, device, source, other, bytes, stream_of(sums)));
  }
  return {};
}

// Part k of a member whose memory kernels of member k do not reach.
Status DeviceExchange::fetch(const std::vector<StepSums>& sums, size_t k, size_t other,
                             uint8_t** scratch, MemberArrays* arrays) {
  const RowRange part = part_of(sums[k].rows, k, members_.size());
  for (uint32_t a = 0; a < arrays->arrays; ++a) {
    const SumArray& array = sums[other].arrays[a];
    const size_t bytes = part.count() * row_bytes(array);
    L4D_RETURN_IF_ERROR(copy(k, *scratch, other, row(array, part.begin), bytes, sums[k]));
    arrays->array[a].from[other] = *scratch;
    *scratch += aligned(bytes);
  }
  L4D_RETURN_IF_ERROR(copy(k, *scratch, other, sums[other].stop, sizeof(uint32_t), sums[k]));
  arrays->stop[other] = reinterpret_cast<const uint32_t*>(*scratch);
  *scratch += aligned(sizeof(uint32_t));
  return {};
}

// Member k adds its part up, for itself and for those whose memory it reaches.
Status DeviceExchange::add_part(const std::vector<StepSums>& sums, size_t k) {
  Member& m = members_[k];
  const StepSums& own = sums[k];
  L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(m.device));
  L4D_RETURN_IF_ERROR(wait_for(&Member::ready, sums, k));
  const RowRange part = part_of(own.rows, k, members_.size());
  MemberArrays arrays{};
  arrays.members = static_cast<uint32_t>(members_.size());
  arrays.arrays = static_cast<uint32_t>(own.arrays.size());
  arrays.stop_any = own.stop_any;
  size_t wanted = aligned(sizeof(uint32_t));
  for (const SumArray& a : own.arrays) wanted += aligned(part.count() * row_bytes(a));
  size_t others = 0;
  for (size_t j = 0; j < members_.size(); ++j) others += j != k && !reaches(k, j) ? 1U : 0U;
  L4D_RETURN_IF_ERROR(m.scratch.reserve(wanted * others));
  auto* scratch = m.scratch.as<uint8_t>();
  for (size_t j = 0; j < members_.size(); ++j) {
    if (j != k && !reaches(k, j)) {
      L4D_RETURN_IF_ERROR(fetch(sums, k, j, &scratch, &arrays));
      continue;
    }
    for (uint32_t a = 0; a < arrays.arrays; ++a) {
      void* const there = row(sums[j].arrays[a], part.begin);
      arrays.array[a].from[j] = there;
      arrays.array[a].to[arrays.targets] = there;
    }
    arrays.stop[j] = sums[j].stop;
    ++arrays.targets;
  }
  for (uint32_t a = 0; a < arrays.arrays; ++a) {
    MemberArray& array = arrays.array[a];
    array.kind = own.arrays[a].kind;
    array.numbers = part.count() * own.arrays[a].width;
    const auto is_aligned = [](const void* p) { return reinterpret_cast<uintptr_t>(p) % 16 == 0; };
    array.in_words = array.kind == SumArray::kFloat &&
                     std::all_of(array.from, array.from + arrays.members, is_aligned) &&
                     std::all_of(array.to, array.to + arrays.targets, is_aligned);
  }
  launch_add_members(arrays, stream_of(own));
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(m.added, stream_of(own)));
  return {};
}

// Member k gets the parts of those that do not reach its memory.
Status DeviceExchange::take_parts(const std::vector<StepSums>& sums, size_t k) {
  L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(members_[k].device));
  L4D_RETURN_IF_ERROR(wait_for(&Member::added, sums, k));
  for (size_t j = 0; j < members_.size(); ++j) {
    if (j == k || reaches(j, k)) continue;
    const RowRange part = part_of(sums[j].rows, j, members_.size());
    for (size_t a = 0; a < sums[k].arrays.size(); ++a) {
      const SumArray& array = sums[k].arrays[a];
      L4D_RETURN_IF_ERROR(copy(k, row(array, part.begin), j, row(sums[j].arrays[a], part.begin),
                               part.count() * row_bytes(array), sums[k]));
    }
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(members_[k].done, stream_of(sums[k])));
  return {};
}

Status DeviceExchange::try_add_up(const std::vector<StepSums>& sums) {
  for (size_t k = 0; k < members_.size(); ++k) {
    if (sums[k].arrays.size() > kMaxSumArrays || sums[k].rows != sums[0].rows) {
      return {L4D_ERR_INTERNAL, "members have other sums than the first"};
    }
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(members_[k].device));
    L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(members_[k].ready, stream_of(sums[k])));
  }
  for (size_t k = 0; k < members_.size(); ++k) L4D_RETURN_IF_ERROR(add_part(sums, k));
  for (size_t k = 0; k < members_.size(); ++k) L4D_RETURN_IF_ERROR(take_parts(sums, k));
  // The update sets sums to 0, which others may still be copying.
  if (std::count(reaches_.begin(), reaches_.end(), 0) == static_cast<ptrdiff_t>(members_.size())) {
    return {};  // nobody copies
  }
  for (size_t k = 0; k < members_.size(); ++k) {
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(members_[k].device));
    L4D_RETURN_IF_ERROR(wait_for(&Member::done, sums, k));
  }
  return {};
}

}  // namespace

Status check_devices(const std::vector<uint32_t>& devices) {
  if (devices.empty() || devices.size() > kMaxMembers) {
    return {L4D_ERR_INVALID_ARGUMENT, "a training takes 1 to 8 devices"};
  }
  l4d_cuda_device_info first = L4D_INIT(l4d_cuda_device_info);
  for (const uint32_t device : devices) {
    l4d_cuda_device_info info = L4D_INIT(l4d_cuda_device_info);
    if (l4d_cuda_get_device_info(device, &info) != L4D_OK) {
      return {L4D_ERR_DEVICE, "there is no device " + std::to_string(device)};
    }
    if (device == devices[0]) first = info;
    if (std::string(info.name) != first.name || info.compute_major != first.compute_major ||
        info.compute_minor != first.compute_minor) {
      return {L4D_ERR_INVALID_ARGUMENT, "the devices of a training must be of one kind: " +
                                            std::string(first.name) + " and " + info.name};
    }
  }
  return {};
}

Status make_device_exchange(const std::vector<uint32_t>& devices, Transport transport,
                            std::unique_ptr<Exchange>* out) {
  auto exchange = std::make_unique<DeviceExchange>();
  L4D_RETURN_IF_ERROR(exchange->init(devices, transport));
  *out = std::move(exchange);
  return {};
}

}  // namespace l4d::train
