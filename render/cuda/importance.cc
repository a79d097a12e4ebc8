// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/importance.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "libl4dcodec/base/threads.h"

namespace l4d::render {
namespace {

Status read_fixed(const long long* sums, size_t count, int bits, std::vector<double>* out) {
  // In place: these are hundreds of megabytes, and fresh memory costs more than the copy.
  static_assert(sizeof(double) == sizeof(long long), "one in the other's place");
  out->resize(count);
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpy(out->data(), sums, count * sizeof(long long), cudaMemcpyDeviceToHost));
  const double unit = std::ldexp(1.0, -bits);
  parallel_for(0, count, size_t{1} << 18, [out, unit](size_t begin, size_t end) {
    for (double* v = out->data() + begin; v != out->data() + end; ++v) {
      long long fixed;
      std::memcpy(&fixed, v, sizeof fixed);
      *v = static_cast<double>(fixed) * unit;
    }
  });
  return {};
}

}  // namespace

Status ImportanceMemory::create(size_t count, uint32_t sh_degree, bool every_glimpse) {
  count_ = count;
  sh_degree_ = sh_degree;
  const size_t n = std::max<size_t>(count, 1), number = sizeof(long long);
  const size_t bytes[5] = {n * number, n * number, n, n * number * sh_terms(sh_degree),
                           n * number * ImportanceSums::kGeometry};
  for (int k = 0; k < 5; ++k) {
    L4D_RETURN_IF_ERROR(memory_[k].reserve(bytes[k]));
    L4D_RETURN_IF_CUDA_ERROR(cudaMemset(memory_[k].data(), 0, bytes[k]));
  }
  sums_ = {memory_[0].as<long long>(), memory_[1].as<long long>(), memory_[2].as<uint8_t>(),
           memory_[3].as<long long>(), memory_[4].as<long long>(), every_glimpse};
  return {};
}

Status ImportanceMemory::read(Values* out) const {
  const size_t terms = sh_terms(sh_degree_);
  using Sums = ImportanceSums;
  L4D_RETURN_IF_ERROR(read_fixed(sums_.coverage, count_, Sums::kCoverageBits, &out->coverage));
  L4D_RETURN_IF_ERROR(read_fixed(sums_.glimpsed, count_, Sums::kCoverageBits, &out->glimpsed));
  L4D_RETURN_IF_ERROR(read_fixed(sums_.sh, count_ * terms, Sums::kShBits, &out->sh));
  L4D_RETURN_IF_ERROR(
      read_fixed(sums_.geometry, count_ * Sums::kGeometry, Sums::kGeometryBits, &out->geometry));
  return read_seen(&out->seen);
}

Status ImportanceMemory::read_seen(std::vector<uint8_t>* out) const {
  out->resize(count_);
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpy(out->data(), sums_.seen, count_, cudaMemcpyDeviceToHost));
  return {};
}

Status ImportanceMemory::read_glimpsed(std::vector<int64_t>* out) const {
  static_assert(ImportanceSums::kCoverageBits == 24, "the unit that is promised");
  out->resize(count_);
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpy(out->data(), sums_.glimpsed, count_ * sizeof(int64_t), cudaMemcpyDeviceToHost));
  return {};
}

Status ImportanceMemory::clone(std::unique_ptr<DeviceImportance>* out) const {
  auto copy = std::make_unique<ImportanceMemory>();
  L4D_RETURN_IF_ERROR(copy->create(count_, sh_degree_, sums_.every_glimpse));
  L4D_RETURN_IF_ERROR(copy->add(*this));
  *out = std::move(copy);
  return {};
}

Status ImportanceMemory::add(const DeviceImportance& other) {
  const auto& from = static_cast<const ImportanceMemory&>(other);
  launch_add_sums(from.sums_, count_, sh_degree_, sums_, nullptr);
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  return {};
}

}  // namespace l4d::render
