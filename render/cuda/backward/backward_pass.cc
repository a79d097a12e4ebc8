// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/backward/backward_pass.h"

#include <algorithm>

#include "render/cuda/kernel/launched.h"

namespace l4d::render {
namespace {

// Tiles of an image that the backward pass cuts in halves: a device has capacity for more blocks.
constexpr size_t kFewTiles = 1024;

}  // namespace

GradientInput gradient_input(const SceneStore& store, const l4d_gaussians& gaussians, double time,
                             const l4d_camera& camera) {
  const Sequence& s = store.sequence();
  return {gaussians, make_view<double>(camera), s, std::min(std::max(time, s.begin), s.end),
          3 * sh_terms(gaussians.sh_degree)};
}

Status BackwardPass::reserve(const FrameCapacity& wanted_capacity, DeviceFrame* frame) {
  L4D_RETURN_IF_ERROR(frame->reserve(wanted_capacity));
  const FrameCapacity& capacity = frame->capacity();
  if (!capacity.backward) return {};
  const size_t v = capacity.visible, n = capacity.instances;
  const size_t pixels = static_cast<size_t>(capacity.width) * static_cast<size_t>(capacity.height);
  memory_.parts = image_tiles(capacity.width, capacity.height) < kFewTiles ? 2 : 1;
  struct {
    cuda::DeviceMemory* memory;
    size_t bytes;
  } const wanted[] = {{&image_, 3 * pixels * sizeof(float)},
                      {&instances_, n * memory_.parts * sizeof(SplatSums)},
                      {&splats_, v * sizeof(SplatSums)},
                      {&shown_, v * sizeof(uint32_t)},
                      {&coverage_, v * sizeof(unsigned long long)},
                      {&by_view_, view_parts_bytes()}};
  bool fits = true;
  for (const auto& w : wanted) fits = fits && w.bytes <= w.memory->size();
  if (!fits) L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  for (const auto& w : wanted) L4D_RETURN_IF_ERROR(w.memory->reserve(w.bytes));
  memory_.instances = instances_.as<SplatSums>();
  memory_.splats = splats_.as<SplatSums>();
  memory_.shown = shown_.as<uint32_t>();
  memory_.by_view = by_view_.as<long long>();
  return {};
}

Status BackwardPass::run(DeviceFrame* frame, const BackwardTask& task, cudaStream_t stream) {
  const FrameMemory& of_frame = frame->memory();
  L4D_RETURN_IF_ERROR(frame->mark(5, stream));
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemsetAsync(&of_frame.counts->shown, 0, sizeof of_frame.counts->shown, stream));
  launch_backward(frame->input(), task, frame->values(), of_frame, memory_, stream);
  launch_sum_instances(frame->input(), task, frame->order(), of_frame, memory_, stream);
  L4D_RETURN_IF_ERROR(frame->mark(6, stream));
  return launched("the backward pass");
}

Status BackwardPass::cover(DeviceFrame* frame, cudaStream_t stream) {
  const FrameMemory& of_frame = frame->memory();
  L4D_RETURN_IF_ERROR(frame->mark(5, stream));
  const size_t bytes = of_frame.max_visible * sizeof(unsigned long long);
  L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(coverage_.data(), 0, bytes, stream));
  launch_coverage(frame->input(), frame->values(), of_frame, coverage_.as<unsigned long long>(),
                  stream);
  L4D_RETURN_IF_ERROR(frame->mark(6, stream));
  return launched("coverage");
}

}  // namespace l4d::render
