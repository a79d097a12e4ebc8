// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/scene/trainable_scene.h"

#include <algorithm>

#include "render/cuda/backward/backward_pass.h"

namespace l4d::render {

// A view of a forward, and what its backward pass goes on from.
struct TrainableScene::Lane {
  DeviceFrame frame;
  BackwardPass back;
  cudaStream_t stream = nullptr;  // of lane 0: the caller's
  cudaEvent_t sliced = nullptr, rendered = nullptr, added = nullptr;
  TrainableView view{};

  Status create(bool own_stream) {
    L4D_RETURN_IF_ERROR(frame.create());
    if (own_stream) {
      L4D_RETURN_IF_CUDA_ERROR(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
    }
    for (cudaEvent_t* event : {&sliced, &rendered, &added}) {
      L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(event, cudaEventDisableTiming));
    }
    return {};
  }
  Lane() = default;
  Lane(const Lane&) = delete;
  Lane& operator=(const Lane&) = delete;
  ~Lane() {
    for (cudaEvent_t event : {sliced, rendered, added}) {
      if (event != nullptr) cudaEventDestroy(event);
    }
    if (stream != nullptr) cudaStreamDestroy(stream);
  }
};

TrainableScene::TrainableScene() = default;

Status TrainableScene::create(int device) {
  device_ = device;
  L4D_RETURN_IF_ERROR(l4d::cuda::use_device(device));
  L4D_RETURN_IF_ERROR(counts_.reserve(sizeof(TrainableCounts)));
  L4D_RETURN_IF_ERROR(report_.reserve(sizeof(TrainableCounts)));
  for (cudaEvent_t* event : {&begin_, &copied_}) {
    L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(event, cudaEventDisableTiming));
  }
  return {};
}

TrainableScene::~TrainableScene() {
  static_cast<void>(use());
  cudaDeviceSynchronize();
  for (cudaEvent_t event : {begin_, copied_}) {
    if (event != nullptr) cudaEventDestroy(event);
  }
}

Status TrainableScene::set_scene(const l4d_gaussians& gaussians, const l4d_timeline& timeline,
                                 const l4d_cuda_trainable_rows& rows) {
  L4D_RETURN_IF_ERROR(use());
  state_ = kNothing;
  has_copy_ = false;
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  StoreShape shape = shape_of(gaussians, timeline);
  shape.external_sh = true;
  L4D_RETURN_IF_ERROR(store_.reserve(shape));
  const Batch all{0, static_cast<uint32_t>(shape.slots), kMoving};
  L4D_RETURN_IF_ERROR(store_.set_batches(&all, shape.slots > 0 ? 1 : 0, nullptr));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemset(counts_.data(), 0, sizeof(TrainableCounts)));
  gaussians_ = gaussians;
  rows_ = rows;
  degree_ = gaussians.sh_degree;
  has_scene_ = true;
  L4D_RETURN_IF_ERROR(show_scene());
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  return {};
}

Status TrainableScene::set_sh_degree(uint32_t degree) {
  if (!has_scene_) return Status(L4D_ERR_INVALID_STATE, "there is no scene");
  if (degree > gaussians_.sh_degree) {
    return invalid_argument("degree is above that of the scene");
  }
  state_ = std::min(state_, kRefreshed);
  degree_ = degree;
  return show_scene();
}

Status TrainableScene::refresh(void* stream) {
  L4D_RETURN_IF_ERROR(use());
  if (!has_scene_) return Status(L4D_ERR_INVALID_STATE, "there is no scene");
  launch_refresh(gaussians_, rows_.count, store_.sequence(), store_.resident(), counts(),
                 static_cast<cudaStream_t>(stream));
  store_.touch();
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  state_ = kRefreshed;
  return {};
}

Status TrainableScene::reserve(const l4d_cuda_frame_capacity& wanted, uint32_t views) {
  L4D_RETURN_IF_ERROR(use());
  state_ = std::min(state_, kRefreshed);
  FrameCapacity capacity;
  capacity.width = static_cast<int>(wanted.width);
  capacity.height = static_cast<int>(wanted.height);
  capacity.visible = static_cast<uint32_t>(std::min<uint64_t>(wanted.visible, kSlotMask));
  capacity.instances = static_cast<uint32_t>(std::min<uint64_t>(wanted.instances, ~0u));
  capacity.backward = true;
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceSynchronize());
  while (lanes_.size() < views) {
    auto lane = std::make_unique<Lane>();
    L4D_RETURN_IF_ERROR(lane->create(!lanes_.empty()));
    if (!lanes_.empty()) {
      L4D_RETURN_IF_ERROR(lane->back.reserve(lanes_[0]->frame.capacity(), &lane->frame));
    }
    if (timed_) L4D_RETURN_IF_ERROR(lane->frame.time_passes());
    lanes_.push_back(std::move(lane));
  }
  for (const auto& lane : lanes_) {
    L4D_RETURN_IF_ERROR(lane->back.reserve(capacity, &lane->frame));
  }
  return has_scene_ ? show_scene() : Status();
}

Status TrainableScene::use() const {
  L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(device_));
  return {};
}

// The store, and what lanes need to slice it, so that forward() only launches.
Status TrainableScene::show_scene() {
  store_.set_external_sh(gaussians_.sh, rows_.sh_stride, degree_);
  for (const auto& lane : lanes_) L4D_RETURN_IF_ERROR(lane->frame.reserve_slices(store_));
  return {};
}

cudaStream_t TrainableScene::stream_of(size_t lane, void* callers) const {
  return lane == 0 ? static_cast<cudaStream_t>(callers) : lanes_[lane]->stream;
}

// The lanes from 1 on wait for the caller's stream.
Status TrainableScene::fork(size_t lanes, void* stream) {
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(begin_, static_cast<cudaStream_t>(stream)));
  for (size_t v = 1; v < lanes; ++v) {
    L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(lanes_[v]->stream, begin_));
  }
  return {};
}

// The frame of a lane, which shares the slice of `leader`, itself or a lane before it.
Status TrainableScene::render(size_t lane, size_t leader, cudaStream_t stream) {
  Lane& own = *lanes_[lane];
  const TrainableView& v = own.view;
  const SliceSharing sharing{leader == lane ? nullptr : &lanes_[leader]->frame,
                             lanes_[leader]->sliced};
  const ImageTarget target{v.rgb, v.alpha, nullptr};
  L4D_RETURN_IF_ERROR(
      own.frame.draw(store_, v.time, v.camera, v.background, true, target, stream, sharing));
  launch_note_view(own.frame.memory(), lane == 0, counts(), rows_.overflow, stream);
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  return {};
}

Status TrainableScene::forward(const std::vector<TrainableView>& views, void* stream) {
  L4D_RETURN_IF_ERROR(use());
  if (state_ == kNothing) return Status(L4D_ERR_INVALID_STATE, "nothing was refreshed");
  if (views.size() > lanes_.size()) {
    return Status(L4D_ERR_INVALID_STATE, "fewer views are reserved");
  }
  for (const TrainableView& v : views) {
    const FrameCapacity& room = lanes_[0]->frame.capacity();
    if (static_cast<int>(v.camera.width) > room.width ||
        static_cast<int>(v.camera.height) > room.height) {
      return Status(L4D_ERR_INVALID_STATE, "the reserved image size is too small for a view");
    }
  }
  state_ = kRefreshed;
  L4D_RETURN_IF_ERROR(fork(views.size(), stream));
  for (size_t v = 0; v < views.size(); ++v) {
    lanes_[v]->view = views[v];
    size_t leader = 0;
    while (views[leader].time != views[v].time) ++leader;
    const cudaStream_t on = stream_of(v, stream);
    L4D_RETURN_IF_ERROR(render(v, leader, on));
    if (v > 0) L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(lanes_[v]->rendered, on));
  }
  for (size_t v = 1; v < views.size(); ++v) {
    L4D_RETURN_IF_CUDA_ERROR(
        cudaStreamWaitEvent(static_cast<cudaStream_t>(stream), lanes_[v]->rendered));
  }
  num_views_ = views.size();
  state_ = kWentForward;
  return {};
}

Status TrainableScene::backward(const std::vector<l4d_cuda_trainable_loss>& losses,
                                const l4d_gradients& gradients,
                                const l4d_cuda_trainable_statistics& s, void* stream) {
  L4D_RETURN_IF_ERROR(use());
  if (state_ < kWentForward || losses.size() != num_views_) {
    return Status(L4D_ERR_INVALID_STATE, "the last forward was not of these views");
  }
  if (gradients.count != gaussians_.count) {
    return invalid_argument("gradients.count is not the scene's capacity");
  }
  if (gradients.view != nullptr) return invalid_argument("views have view gradients of their own");
  const ViewStatistics statistics{s.shown, s.views, s.coverage, s.error_coverage,
                                  s.screen_gradient};
  l4d_gaussians shown = gaussians_;
  shown.sh_degree = degree_;
  L4D_RETURN_IF_ERROR(fork(losses.size(), stream));
  for (size_t v = 0; v < losses.size(); ++v) {
    Lane& lane = *lanes_[v];
    const cudaStream_t on = stream_of(v, stream);
    BackwardTask task{Upstream::kGiven, losses[v].rgb_gradient, 0, lane.view.rgb};
    task.error = s.error_coverage == nullptr ? nullptr : losses[v].error;
    L4D_RETURN_IF_ERROR(lane.back.run(&lane.frame, task, on));
    // One view after the other adds to the caller's arrays.
    if (v > 0) L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(on, lanes_[v - 1]->added));
    GradientInput input = gradient_input(store_, shown, lane.view.time, lane.view.camera);
    input.sh_stride = rows_.sh_stride;
    l4d_gradients out = gradients;
    out.view = losses[v].view_gradient;
    launch_gradients(input, task, store_.resident(), lane.frame.memory(), lane.back.memory(), out,
                     statistics, on);
    L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
    L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(lane.added, on));
  }
  if (losses.size() > 1) {
    L4D_RETURN_IF_CUDA_ERROR(
        cudaStreamWaitEvent(static_cast<cudaStream_t>(stream), lanes_[losses.size() - 1]->added));
  }
  state_ = kWentBack;
  return {};
}

Status TrainableScene::copy_report(void* stream) {
  L4D_RETURN_IF_ERROR(use());
  const auto on = static_cast<cudaStream_t>(stream);
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(report_.data(), counts_.data(), sizeof(TrainableCounts),
                                           cudaMemcpyDeviceToHost, on));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(copied_, on));
  has_copy_ = true;
  return {};
}

Status TrainableScene::get_report(bool wait, l4d_cuda_trainable_report* out) {
  L4D_RETURN_IF_ERROR(use());
  if (!has_copy_) return Status(L4D_ERR_INVALID_STATE, "no report was copied");
  if (wait) {
    L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(copied_));
  } else {
    const cudaError_t error = cudaEventQuery(copied_);
    if (error == cudaErrorNotReady) {
      return Status(L4D_ERR_INVALID_STATE, "the copy of the report is not complete");
    }
    L4D_RETURN_IF_CUDA_ERROR(error);
  }
  const TrainableCounts& c = *report_.as<TrainableCounts>();
  out->views = c.views;
  out->skipped = c.skipped;
  out->rows = c.rows;
  out->required_visible = c.required_visible;
  out->required_instances = c.required_instances;
  out->visible = c.visible;
  out->projected = c.projected;
  out->instances = c.instances;
  // Times of passes are known once all of them have run.
  if (timed_ && state_ >= kWentForward) return lanes_[0]->frame.pass_seconds(out->seconds);
  return {};
}

Status TrainableScene::time_passes() {
  L4D_RETURN_IF_ERROR(use());
  timed_ = true;
  for (const auto& lane : lanes_) L4D_RETURN_IF_ERROR(lane->frame.time_passes());
  return {};
}

}  // namespace l4d::render
