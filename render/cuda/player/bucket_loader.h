// SPDX-License-Identifier: Apache-2.0
// From stored bytes to slots of a store: reads and decodes lists of buckets on a stream of its own.
#pragma once

#include <vector>

#include "l4d/cuda_player.h"
#include "libl4dcodec/cuda/device.h"
#include "render/cuda/store/store.h"

namespace l4d::render {

// A bucket and where it goes.
struct BucketPlace {
  l4d_bucket bucket;
  uint32_t slots;
  double center;  // of its time, seconds
  std::vector<uint32_t> chunks;
};

class BucketLoader {
 public:
  // decoder: an open stream, which only this object uses from now on.
  BucketLoader(l4d_decoder* decoder, const l4d_cuda_player_options& options)
      : decoder_(decoder), options_(options) {}
  ~BucketLoader();
  BucketLoader(const BucketLoader&) = delete;
  BucketLoader& operator=(const BucketLoader&) = delete;

  // Of the calling thread's device.
  Status create();

  // The whole buckets that instants in [begin, end] seconds need, in the order of the stream.
  Status plan(double begin, double end, std::vector<BucketPlace>* out);
  // Frames before this point of a stream still show what the next buckets are put over.
  Status wait_for(cudaEvent_t passed);
  // Decodes buckets in ascending order into their chunks and waits until they are there.
  Status load(const std::vector<BucketPlace>& buckets, const Sequence& sequence, bool half_sh,
              const ResidentGaussians& slots);

  uint64_t uploaded_bytes() const { return uploaded_; }
  uint64_t scratch_bytes() const;

 private:
  Status told(l4d_status status) const;
  Status reserve_arrays(uint64_t gaussians, uint64_t workspace);

  l4d_decoder* const decoder_;
  const l4d_cuda_player_options options_;
  uint32_t sh_degree_ = 0;
  uint32_t flags_ = 0;
  l4d_cuda_decoder* cuda_ = nullptr;
  cudaStream_t stream_ = nullptr;
  l4d_cuda_gaussian_buffers arrays_{};  // what is decoded goes here
  l4d_gaussians slots_{};               // the same arrays
  cuda::DeviceMemory gaussians_, workspace_, chunk_list_;
  cuda::PinnedMemory chunk_staging_;
  uint64_t uploaded_ = 0;
};

}  // namespace l4d::render
