// SPDX-License-Identifier: Apache-2.0
// A scene that changes in every step on a CUDA device: what the functions of
// l4d/experimental/cuda_train.h call. Each view of a forward has a frame and a stream of its own,
// so that kernels that do not fill the device share it; events order them after what was launched
// before, and what is launched after behind them.
#pragma once

#include <memory>
#include <vector>

#include "l4d/experimental/cuda_train.h"
#include "render/cuda/scene/refresh.h"
#include "render/cuda/store/scene_store.h"
#include "render/view/view.h"

namespace l4d::render {

class TrainableScene {
 public:
  TrainableScene();
  ~TrainableScene();
  TrainableScene(const TrainableScene&) = delete;
  TrainableScene& operator=(const TrainableScene&) = delete;

  // Before all else. Fails with L4D_ERR_DEVICE if this build cannot use the device.
  Status create(int device);
  Status set_scene(const l4d_gaussians& gaussians, const l4d_timeline& timeline,
                   const l4d_cuda_trainable_rows& rows);
  Status set_sh_degree(uint32_t degree);
  Status refresh(void* stream);
  Status reserve(const l4d_cuda_frame_capacity& capacity, uint32_t views);
  Status forward(const std::vector<TrainableView>& views, void* stream);
  Status backward(const std::vector<l4d_cuda_trainable_loss>& losses,
                  const l4d_gradients& gradients, const l4d_cuda_trainable_statistics& statistics,
                  void* stream);
  Status copy_report(void* stream);
  Status get_report(bool wait, l4d_cuda_trainable_report* out);
  Status time_passes();

 private:
  struct Lane;
  // What the calls so far allow.
  enum State { kNothing, kRefreshed, kWentForward, kWentBack };

  Status use() const;
  TrainableCounts* counts() const { return counts_.as<TrainableCounts>(); }
  Status show_scene();
  cudaStream_t stream_of(size_t lane, void* callers) const;
  Status fork(size_t lanes, void* stream);
  Status render(size_t lane, size_t leader, cudaStream_t stream);

  int device_ = 0;
  SceneStore store_;
  std::vector<std::unique_ptr<Lane>> lanes_;
  cuda::DeviceMemory counts_;
  cuda::PinnedMemory report_;
  cudaEvent_t begin_ = nullptr, copied_ = nullptr;
  bool has_copy_ = false, has_scene_ = false, timed_ = false;
  l4d_gaussians gaussians_{};  // device arrays of the caller's
  l4d_cuda_trainable_rows rows_{};
  uint32_t degree_ = 0;
  State state_ = kNothing;
  size_t num_views_ = 0;  // of the last forward
};

}  // namespace l4d::render
