// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/target_cache.h"

namespace l4d::train {
namespace {

Status upload(const uint8_t* from, size_t bytes, cudaStream_t stream, cuda::DeviceMemory* to) {
  L4D_RETURN_IF_ERROR(to->reserve(bytes));
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpyAsync(to->data(), from, bytes, cudaMemcpyHostToDevice, stream));
  return {};
}

}  // namespace

// Drops targets that other steps used, the oldest first.
Status TargetCache::make_room(uint64_t bytes, uint64_t step, cudaStream_t stream) {
  bool waited = false;
  while (bytes_ + bytes > budget_) {
    auto oldest = targets_.end();
    for (auto t = targets_.begin(); t != targets_.end(); ++t) {
      if (t->second.used == step) continue;
      if (oldest == targets_.end() || t->second.used < oldest->second.used) oldest = t;
    }
    if (oldest == targets_.end()) break;
    if (!waited) L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
    waited = true;
    bytes_ -= oldest->second.bytes;
    targets_.erase(oldest);
  }
  return {};
}

Status TargetCache::take(const StepView& view, uint64_t step, cudaStream_t stream,
                         const Target** out) {
  const Key key{view.image, view.camera.width, view.camera.height};
  const auto found = targets_.find(key);
  if (found != targets_.end()) {
    found->second.used = step;
    *out = &found->second;
    return {};
  }
  const size_t pixels = size_t{view.camera.width} * view.camera.height;
  const size_t numbers = size_t{3} + (view.alpha != nullptr) + (view.mask != nullptr);
  L4D_RETURN_IF_ERROR(make_room(numbers * pixels, step, stream));
  Target& target = targets_[key];
  target.used = step;
  target.bytes = numbers * pixels;
  bytes_ += target.bytes;
  L4D_RETURN_IF_ERROR(upload(view.target, 3 * pixels, stream, &target.rgb));
  if (view.alpha != nullptr) {
    L4D_RETURN_IF_ERROR(upload(view.alpha, pixels, stream, &target.alpha));
    target.alpha_or_null = target.alpha.as<uint8_t>();
  }
  if (view.mask != nullptr) {
    L4D_RETURN_IF_ERROR(upload(view.mask, pixels, stream, &target.mask));
    target.mask_or_null = target.mask.as<uint8_t>();
  }
  *out = &target;
  return {};
}

}  // namespace l4d::train
