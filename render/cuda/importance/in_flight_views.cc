// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/importance/in_flight_views.h"

#include <algorithm>

#include "libl4dcodec/base/checked.h"

namespace l4d::render {
namespace {

// The first capacity for pairs of tile and Gaussian, before anything is known.
constexpr uint64_t kFirstInstances = 1u << 20;
constexpr uint64_t kMostFirstInstances = 1u << 24;

}  // namespace

FrameCapacity first_capacity(const SceneStore& store, const l4d_camera& camera, bool backward) {
  const uint64_t slots = store.slots();
  FrameCapacity capacity;
  capacity.width = static_cast<int>(camera.width);
  capacity.height = static_cast<int>(camera.height);
  capacity.visible = saturate32(slots);
  capacity.instances =
      saturate32(std::min(std::max(kFirstInstances, 4 * slots), kMostFirstInstances));
  capacity.backward = backward;
  return capacity;
}

FrameCapacity more_capacity(FrameCapacity capacity, const FrameStats& stats) {
  capacity.instances =
      saturate32(uint64_t{stats.required_instances} + stats.required_instances / 4);
  return capacity;
}

Status launch_view_sums(const SceneStore& store, const l4d_gaussians& gaussians,
                        const ImportanceView& view, cudaEvent_t after, cudaStream_t stream,
                        DeviceFrame* frame, BackwardPass* back) {
  const auto await = [&]() -> Status {
    if (after != nullptr) L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(stream, after));
    return {};
  };
  const ImportanceSums& sums = view.sums->sums();
  if (view.visibility_only) {
    L4D_RETURN_IF_ERROR(back->cover(frame, stream));
    L4D_RETURN_IF_ERROR(await());
    launch_visible_only(store.resident(), frame->memory(), back->coverage(), sums, stream);
  } else {
    const Upstream upstream = view.squared ? Upstream::kSigns : Upstream::kOnes;
    const BackwardTask task{upstream, nullptr, view.signs, back->scratch_image()};
    L4D_RETURN_IF_ERROR(back->run(frame, task, stream));
    L4D_RETURN_IF_ERROR(await());
    launch_importance(gradient_input(store, gaussians, view.time, view.camera), task, view.squared,
                      store.resident(), frame->memory(), back->memory(), sums, stream);
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  return {};
}

Status InFlightViews::create(const SceneStore& store, const l4d_gaussians& gaussians) {
  store_ = &store;
  gaussians_ = gaussians;
  for (InFlight& pending : views_) {
    L4D_RETURN_IF_ERROR(pending.frame.create());
    L4D_RETURN_IF_ERROR(pending.frame.reserve_slices(store));
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamCreateWithFlags(&pending.stream, cudaStreamNonBlocking));
    L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(&pending.added, cudaEventDisableTiming));
  }
  // Streams of views do not wait for what made the scene.
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  return {};
}

InFlightViews::~InFlightViews() {
  for (InFlight& pending : views_) {
    if (pending.stream == nullptr) continue;
    cudaStreamSynchronize(pending.stream);
    cudaStreamDestroy(pending.stream);
    if (pending.added != nullptr) cudaEventDestroy(pending.added);
  }
}

Status InFlightViews::launch(size_t which) {
  InFlight& pending = views_[which];
  L4D_RETURN_IF_ERROR(pending.back.reserve(pending.capacity, &pending.frame));
  ImageTarget target{};
  if (!pending.view.visibility_only) target.rgb = pending.back.scratch_image();
  const float black[3] = {0, 0, 0};
  L4D_RETURN_IF_ERROR(pending.frame.draw(*store_, pending.view.time, pending.view.camera, black,
                                         !pending.view.visibility_only, target, pending.stream));
  // Sums are changed by one view at a time.
  const InFlight& other = views_[(which + 1) % kInFlight];
  L4D_RETURN_IF_ERROR(launch_view_sums(*store_, gaussians_, pending.view, other.added,
                                       pending.stream, &pending.frame, &pending.back));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(pending.added, pending.stream));
  return {};
}

Status InFlightViews::finish(size_t which) {
  InFlight& pending = views_[which];
  while (pending.busy) {
    // Whatever comes of it, the view is not tried for ever.
    pending.busy = false;
    FrameStats stats{};
    L4D_RETURN_IF_ERROR(pending.frame.stats(pending.stream, &stats));
    if (!stats.overflow) break;
    // Without room for all it has added nothing.
    pending.capacity = more_capacity(pending.capacity, stats);
    L4D_RETURN_IF_ERROR(launch(which));
    pending.busy = true;
  }
  return {};
}

Status InFlightViews::add(const ImportanceView& view) {
  const size_t which = turn_;
  turn_ = (turn_ + 1) % kInFlight;
  L4D_RETURN_IF_ERROR(finish(which));
  InFlight& pending = views_[which];
  const uint32_t needed_before = pending.capacity.instances;
  pending.capacity = first_capacity(*store_, view.camera, true);
  pending.capacity.instances = std::max(pending.capacity.instances, needed_before);
  pending.view = view;
  L4D_RETURN_IF_ERROR(launch(which));
  pending.busy = true;
  return {};
}

Status InFlightViews::finish() {
  // Both, whatever becomes of the first.
  const Status first = finish(turn_);
  const Status second = finish((turn_ + 1) % kInFlight);
  return first.ok() ? second : first;
}

}  // namespace l4d::render
