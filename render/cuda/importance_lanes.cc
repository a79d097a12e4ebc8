// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/importance_lanes.h"

#include <algorithm>

#include "libl4dcodec/base/checked.h"

namespace l4d::render {
namespace {

// Pairs of tile and Gaussian that there is room for before anything is known.
constexpr uint64_t kFirstInstances = 1u << 20;
constexpr uint64_t kMostFirstInstances = 1u << 24;

}  // namespace

GradientInput gradient_input(const DevicePipeline& pipeline, const l4d_gaussians& gaussians,
                             double time, const l4d_camera& camera) {
  const Sequence& s = pipeline.sequence();
  return {gaussians, make_view<double>(camera), s, std::min(std::max(time, s.begin), s.end)};
}

FrameRoom first_room(const DevicePipeline& pipeline, const l4d_camera& camera, bool backward) {
  const uint64_t rows = pipeline.rows();
  FrameRoom room;
  room.width = static_cast<int>(camera.width);
  room.height = static_cast<int>(camera.height);
  room.visible = saturate32(rows);
  room.instances = saturate32(std::min(std::max(kFirstInstances, 4 * rows), kMostFirstInstances));
  room.backward = backward;
  return room;
}

FrameRoom more_room(FrameRoom room, const FrameFigures& figures) {
  room.instances = saturate32(uint64_t{figures.wanted_instances} + figures.wanted_instances / 4);
  return room;
}

Status launch_view_sums(DevicePipeline* pipeline, const l4d_gaussians& gaussians,
                        const ImportanceView& view, cudaEvent_t after, cudaStream_t stream) {
  const auto await = [&]() -> Status {
    if (after != nullptr) L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(stream, after));
    return {};
  };
  const ImportanceSums& sums = view.sums->sums();
  if (view.seen_only) {
    L4D_RETURN_IF_ERROR(pipeline->cover(stream));
    L4D_RETURN_IF_ERROR(await());
    launch_glimpse(pipeline->resident(), pipeline->memory(), pipeline->coverage(), sums, stream);
  } else {
    const Upstream upstream = view.squared ? Upstream::kSigns : Upstream::kOnes;
    const BackwardTask task{upstream, nullptr, view.signs, pipeline->scratch_image()};
    L4D_RETURN_IF_ERROR(pipeline->go_back(task, stream));
    L4D_RETURN_IF_ERROR(await());
    launch_importance(gradient_input(*pipeline, gaussians, view.time, view.camera), task,
                      view.squared, pipeline->resident(), pipeline->memory(),
                      pipeline->back_memory(), sums, stream);
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  return {};
}

Status ImportanceLanes::create(const DevicePipeline& scene, const l4d_gaussians& gaussians) {
  gaussians_ = gaussians;
  for (Lane& lane : lanes_) {
    L4D_RETURN_IF_ERROR(lane.pipeline.create());
    L4D_RETURN_IF_ERROR(lane.pipeline.share_rows(scene));
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamCreateWithFlags(&lane.stream, cudaStreamNonBlocking));
    L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(&lane.added, cudaEventDisableTiming));
  }
  // Streams of lanes do not wait for what made the scene.
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  return {};
}

ImportanceLanes::~ImportanceLanes() {
  for (Lane& lane : lanes_) {
    if (lane.stream == nullptr) continue;
    cudaStreamSynchronize(lane.stream);
    cudaStreamDestroy(lane.stream);
    if (lane.added != nullptr) cudaEventDestroy(lane.added);
  }
}

Status ImportanceLanes::launch(size_t which) {
  Lane& lane = lanes_[which];
  DevicePipeline& pipeline = lane.pipeline;
  L4D_RETURN_IF_ERROR(pipeline.reserve(lane.room));
  ImageTarget target{};
  if (!lane.view.seen_only) target.rgb = pipeline.scratch_image();
  const float black[3] = {0, 0, 0};
  L4D_RETURN_IF_ERROR(pipeline.render(lane.view.time, lane.view.camera, black, !lane.view.seen_only,
                                      target, lane.stream));
  // Sums are changed by one view at a time.
  const Lane& other = lanes_[(which + 1) % kLanes];
  L4D_RETURN_IF_ERROR(launch_view_sums(&pipeline, gaussians_, lane.view, other.added, lane.stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(lane.added, lane.stream));
  return {};
}

Status ImportanceLanes::finish(size_t which) {
  Lane& lane = lanes_[which];
  while (lane.busy) {
    // Whatever comes of it, the view is not tried for ever.
    lane.busy = false;
    FrameFigures figures{};
    L4D_RETURN_IF_ERROR(lane.pipeline.figures(lane.stream, &figures));
    if (!figures.overflow) break;
    // Without room for all it has added nothing.
    lane.room = more_room(lane.room, figures);
    L4D_RETURN_IF_ERROR(launch(which));
    lane.busy = true;
  }
  return {};
}

Status ImportanceLanes::add(const ImportanceView& view) {
  const size_t which = turn_;
  turn_ = (turn_ + 1) % kLanes;
  L4D_RETURN_IF_ERROR(finish(which));
  Lane& lane = lanes_[which];
  const uint32_t needed_before = lane.room.instances;
  lane.room = first_room(lane.pipeline, view.camera, true);
  lane.room.instances = std::max(lane.room.instances, needed_before);
  lane.view = view;
  L4D_RETURN_IF_ERROR(launch(which));
  lane.busy = true;
  return {};
}

Status ImportanceLanes::finish() {
  // Both, whatever becomes of the first.
  const Status first = finish(turn_);
  const Status second = finish((turn_ + 1) % kLanes);
  return first.ok() ? second : first;
}

}  // namespace l4d::render
