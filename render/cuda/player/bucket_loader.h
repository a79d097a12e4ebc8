// SPDX-License-Identifier: Apache-2.0
// From stored bytes to slots of a store: reads and decodes lists of buckets on a stream of its own.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <vector>

#include "libl4dcodec/cuda/device.h"
#include "render/cuda/player/bucket_feed.h"
#include "render/cuda/store/store.h"

namespace l4d::render {

// Its functions are those of BucketStore. Of one thread, but for the counts.
class BucketLoader {
 public:
  explicit BucketLoader(const l4d_cuda_player_options& options) : options_(options) {}
  ~BucketLoader();
  BucketLoader(const BucketLoader&) = delete;
  BucketLoader& operator=(const BucketLoader&) = delete;

  // Of the calling thread's device.
  Status create();
  // The decoder, which has an open stream, stays as it is until this object goes.
  Status prepare(l4d_decoder* decoder, const l4d_query& query, uint64_t gaussians);
  Status decode();
  // passed: of frames that still show what the buckets are put over.
  Status place(const std::vector<BucketPlace>& batch, const Sequence& sequence,
               const ResidentGaussians& slots, cudaEvent_t passed);
  Status finish();
  cudaStream_t stream() const { return stream_; }

  uint64_t uploaded_bytes() const { return uploaded_; }
  uint64_t scratch_bytes() const { return scratch_; }

 private:
  struct Destroy {
    void operator()(l4d_cuda_decoder* d) const { l4d_cuda_decoder_destroy(d); }
  };
  // A stream, and what decodes it.
  struct Source {
    l4d_info info{};
    std::unique_ptr<l4d_cuda_decoder, Destroy> cuda;
  };

  Status find_source(l4d_decoder* decoder);
  Status reserve_arrays(uint64_t gaussians, uint64_t workspace);

  const l4d_cuda_player_options options_;
  std::map<l4d_decoder*, Source> sources_;
  Source* source_ = nullptr;    // of what is prepared
  l4d_cuda_request request_{};  // what is prepared
  cudaStream_t stream_ = nullptr;
  l4d_cuda_gaussian_buffers arrays_{};  // what is decoded goes here
  l4d_gaussians slots_{};               // the same arrays
  cuda::DeviceMemory gaussians_, workspace_, chunk_list_;
  cuda::PinnedMemory chunk_staging_;
  std::atomic<uint64_t> uploaded_{0}, scratch_{0};
};

}  // namespace l4d::render
