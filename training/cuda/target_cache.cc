// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/target_cache.h"

#include <iterator>
#include <utility>

namespace l4d::train {
namespace {

Status upload(const uint8_t* from, size_t bytes, cudaStream_t stream, cuda::DeviceMemory* to) {
  L4D_RETURN_IF_ERROR(to->reserve(bytes));
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpyAsync(to->data(), from, bytes, cudaMemcpyHostToDevice, stream));
  return {};
}

}  // namespace

// Drops targets that other steps used, the oldest first. A long training meets new images all the
// time: most have the size of those that go, and get their memory. What was read from it, was read
// on the same stream before.
Status TargetCache::make_room(const uint64_t (&size)[3], uint64_t step, cudaStream_t stream,
                              Target* free) {
  bool waited = false, found = false;
  while (bytes_ + size[0] + size[1] + size[2] > budget_ && !order_.empty()) {
    const auto oldest = targets_.find(order_.front());
    Target& target = oldest->second.target;
    if (target.used == step) break;
    const bool fits = target.rgb.size() == size[0] && target.alpha.size() == size[1] &&
                      target.mask.size() == size[2];
    bytes_ -= target.bytes;
    if (fits && !found) {
      *free = std::move(target);
      found = true;
    } else {
      if (!waited) L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream));
      waited = true;
    }
    targets_.erase(oldest);
    order_.pop_front();
  }
  return {};
}

Status TargetCache::take(const StepView& view, uint64_t step, cudaStream_t stream,
                         const Target** out) {
  const Key key{view.image, view.camera.width, view.camera.height};
  const auto found = targets_.find(key);
  if (found != targets_.end()) {
    order_.splice(order_.end(), order_, found->second.place);
    found->second.target.used = step;
    *out = &found->second.target;
    return {};
  }
  const uint64_t pixels = uint64_t{view.camera.width} * view.camera.height;
  const uint64_t size[3] = {3 * pixels, view.alpha != nullptr ? pixels : 0,
                            view.mask != nullptr ? pixels : 0};
  Target target;
  L4D_RETURN_IF_ERROR(make_room(size, step, stream, &target));
  target.alpha_or_null = target.mask_or_null = nullptr;
  target.used = step;
  target.bytes = size[0] + size[1] + size[2];
  L4D_RETURN_IF_ERROR(upload(view.target, size[0], stream, &target.rgb));
  if (view.alpha != nullptr) {
    L4D_RETURN_IF_ERROR(upload(view.alpha, pixels, stream, &target.alpha));
    target.alpha_or_null = target.alpha.as<uint8_t>();
  }
  if (view.mask != nullptr) {
    L4D_RETURN_IF_ERROR(upload(view.mask, pixels, stream, &target.mask));
    target.mask_or_null = target.mask.as<uint8_t>();
  }
  order_.push_back(key);
  Entry& entry = targets_[key];
  entry.target = std::move(target);
  entry.place = std::prev(order_.end());
  bytes_ += entry.target.bytes;
  *out = &entry.target;
  return {};
}

}  // namespace l4d::train
