// SPDX-License-Identifier: Apache-2.0
// A player of a stream on a CUDA device: what the functions of l4d/experimental/cuda_player.h call.
#pragma once

#include <optional>

#include "render/cuda/frame/device_frame.h"
#include "render/cuda/player/bucket_loader.h"

namespace l4d::render {

// The caller's thread renders; that of the feed loads. Frames are launched under the feed's lock:
// slots do not move to a larger store in the middle of one.
class Player final : private BucketStore {
 public:
  // Options have been checked.
  explicit Player(const l4d_cuda_player_options& options)
      : options_(options), feed_(this, kChunkSlots), loader_(options) {}
  ~Player();
  // Before all else. Fails with L4D_ERR_DEVICE if this build cannot use the device.
  Status create();

  Status reserve(uint32_t width, uint32_t height, uint64_t instances);
  Status seek(double time);
  Status render(double time, const l4d_camera& camera, const float* background,
                const ImageTarget& image, void* stream);
  Status stats(void* stream, l4d_cuda_frame_stats* out);
  l4d_cuda_player_counters counters();
  // For the calls of a link.
  BucketFeed& feed() { return feed_; }

 private:
  Status use() const {
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(static_cast<int>(options_.device)));
    return {};
  }
  Status show(double time, cudaStream_t stream);
  // Of the feed's thread.
  Status open(l4d_decoder* decoder) override;
  Status prepare(l4d_decoder* decoder, const l4d_query& query, uint64_t gaussians) override;
  Status decode() override { return loader_.decode(); }
  Status reserve(uint32_t chunks) override;
  Status place(const std::vector<BucketPlace>& batch, bool shown) override;
  Status finish() override { return loader_.finish(); }

  const l4d_cuda_player_options options_;
  BucketFeed feed_;  // outlives what borrows its decoders
  BucketLoader loader_;
  SceneStore store_;
  DeviceFrame frame_;
  Sequence sequence_{};
  uint32_t sh_degree_ = 0;
  std::optional<l4d_timeline> windows_;  // of Gaussians, if the stream has them
  cudaEvent_t passed_ = nullptr;         // all frames so far
  cudaEvent_t placed_ = nullptr;         // what was put over chunks that frames show
  cudaEvent_t listed_ = nullptr;         // the list of chunks has been uploaded
  bool has_placed_ = false;
  // What is listed.
  uint64_t revision_ = 0;
  double list_begin_ = 1, list_end_ = 0;
  cuda::PinnedMemory list_;
  uint64_t frames_ = 0;
};

}  // namespace l4d::render
