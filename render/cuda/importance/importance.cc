// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/importance/importance.h"

#include <algorithm>

namespace l4d::render {
namespace {

template <typename From, typename To>
Status read_array(const From* from, size_t count, std::vector<To>* out) {
  static_assert(sizeof(From) == sizeof(To), "copied as they are");
  out->resize(count);
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpy(out->data(), from, count * sizeof(To), cudaMemcpyDeviceToHost));
  return {};
}

}  // namespace

Status ImportanceMemory::create(size_t count, const ImportanceRow& row, bool sum_visible_only) {
  count_ = count;
  const size_t n = std::max<size_t>(count, 1), number = sizeof(long long);
  const size_t bytes[3] = {n * row.width() * number, n * number, n};
  for (int k = 0; k < 3; ++k) {
    L4D_RETURN_IF_ERROR(memory_[k].reserve(bytes[k]));
    L4D_RETURN_IF_CUDA_ERROR(cudaMemset(memory_[k].data(), 0, bytes[k]));
  }
  // Views are added on streams that do not wait for this one.
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  sums_ = {memory_[0].as<long long>(), memory_[1].as<long long>(), memory_[2].as<uint8_t>(), row,
           sum_visible_only};
  return {};
}

Status ImportanceMemory::read(Values* out) const {
  L4D_RETURN_IF_ERROR(read_array(sums_.numbers, count_ * sums_.row.width(), &out->numbers));
  L4D_RETURN_IF_ERROR(read_visible_only(&out->visible_only));
  return read_seen(&out->seen);
}

Status ImportanceMemory::read_seen(std::vector<uint8_t>* out) const {
  return read_array(sums_.seen, count_, out);
}

Status ImportanceMemory::read_visible_only(std::vector<int64_t>* out) const {
  return read_array(sums_.visible_only, count_, out);
}

Status ImportanceMemory::clone(std::unique_ptr<DeviceImportance>* out) const {
  auto copy = std::make_unique<ImportanceMemory>();
  L4D_RETURN_IF_ERROR(copy->create(count_, sums_.row, sums_.sum_visible_only));
  L4D_RETURN_IF_ERROR(copy->add(*this));
  *out = std::move(copy);
  return {};
}

Status ImportanceMemory::add(const DeviceImportance& other) {
  const auto& from = static_cast<const ImportanceMemory&>(other);
  launch_add_sums(from.sums_, count_, sums_, nullptr);
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  return {};
}

}  // namespace l4d::render
