// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/bucket_loader.h"

#include <algorithm>
#include <utility>

#include "render/cuda/player/player_status.h"

namespace l4d::render {
namespace {

constexpr size_t kAlignment = 256;
size_t aligned(size_t bytes) { return (bytes + kAlignment - 1) / kAlignment * kAlignment; }
// So that memory is not made anew for each bucket that is a little larger.
size_t with_slack(size_t bytes) { return bytes + bytes / 4; }

}  // namespace

BucketLoader::~BucketLoader() {
  sources_.clear();
  if (stream_ != nullptr) cudaStreamDestroy(stream_);
}

Status BucketLoader::create() {
  int lowest = 0, highest = 0;
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceGetStreamPriorityRange(&lowest, &highest));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamCreateWithPriority(&stream_, cudaStreamNonBlocking, lowest));
  return {};
}

Status BucketLoader::find_source(l4d_decoder* decoder) {
  const auto known = sources_.find(decoder);
  if (known != sources_.end()) {
    source_ = &known->second;
    return {};
  }
  Source source;
  source.info = L4D_INIT(l4d_info);
  L4D_RETURN_IF_ERROR(told(l4d_decoder_get_info(decoder, &source.info)));
  l4d_cuda_decoder* cuda = nullptr;
  L4D_RETURN_IF_ERROR(told(l4d_cuda_decoder_create(decoder, options_.device, &cuda)));
  source.cuda.reset(cuda);
  source_ = &(sources_[decoder] = std::move(source));
  return {};
}

Status BucketLoader::reserve_arrays(uint64_t gaussians, uint64_t workspace) {
  const uint32_t sh_degree = source_->info.sh_degree;
  const size_t n = static_cast<size_t>(gaussians);
  const auto bytes_of = [&](const AttributeInfo& a) {
    return aligned(n * a.numbers(sh_degree) * sizeof(float));
  };
  const bool windows = (source_->info.tools & L4D_TOOL_FLAT_WINDOWS) != 0;
  size_t bytes = 0;
  for (const AttributeInfo& a : kAttributes) bytes += bytes_of(a);
  if (windows) bytes += n * sizeof(FrameWindow);
  if (bytes > gaussians_.size()) L4D_RETURN_IF_ERROR(gaussians_.reserve(with_slack(bytes)));
  if (workspace > workspace_.size()) {
    L4D_RETURN_IF_ERROR(workspace_.reserve(with_slack(static_cast<size_t>(workspace))));
  }
  arrays_ = L4D_INIT(l4d_cuda_gaussian_buffers);
  arrays_.capacity = gaussians;
  slots_ = {};
  slots_.struct_size = sizeof slots_;
  slots_.sh_degree = sh_degree;
  slots_.flags = source_->info.flags;
  auto* at = gaussians_.as<unsigned char>();
  for_each_attribute(
      [&](const AttributeInfo& a, float*& to, const float*& from) {
        from = to = reinterpret_cast<float*>(at);
        at += bytes_of(a);
      },
      arrays_, slots_);
  if (windows) slots_.window = arrays_.window = reinterpret_cast<uint32_t*>(at);
  // Each bucket has its own clock.
  std::swap(arrays_.mean_t, arrays_.mean_t_local);
  return {};
}

Status BucketLoader::prepare(l4d_decoder* decoder, const l4d_query& query, uint64_t gaussians) {
  L4D_RETURN_IF_ERROR(find_source(decoder));
  request_ = L4D_INIT(l4d_cuda_request);
  L4D_RETURN_IF_ERROR(told(l4d_cuda_decoder_prepare(source_->cuda.get(), &query, &request_)));
  if (request_.num_gaussians == gaussians) return {};
  return Status(L4D_ERR_INTERNAL, "the stream's directory changed while it was played");
}

Status BucketLoader::decode() {
  L4D_RETURN_IF_ERROR(reserve_arrays(request_.num_gaussians, request_.workspace_bytes));
  L4D_RETURN_IF_ERROR(told(l4d_cuda_decoder_decode(source_->cuda.get(), &arrays_, workspace_.data(),
                                                   workspace_.size(), stream_)));
  uploaded_ += request_.upload_bytes;
  scratch_ = gaussians_.size() + workspace_.size() + chunk_list_.size();
  return told(l4d_cuda_decoder_finish(source_->cuda.get()));
}

Status BucketLoader::place(const std::vector<BucketPlace>& batch, const Sequence& sequence,
                           const ResidentGaussians& slots, cudaEvent_t passed) {
  size_t chunks = 0;
  for (const BucketPlace& b : batch) chunks += b.chunks.size();
  L4D_RETURN_IF_ERROR(chunk_staging_.reserve(with_slack(chunks * sizeof(uint32_t))));
  L4D_RETURN_IF_ERROR(chunk_list_.reserve(with_slack(chunks * sizeof(uint32_t))));
  uint32_t* to = chunk_staging_.as<uint32_t>();
  for (const BucketPlace& b : batch) to = std::copy(b.chunks.begin(), b.chunks.end(), to);
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(chunk_list_.data(), chunk_staging_.data(),
                                           chunks * sizeof(uint32_t), cudaMemcpyHostToDevice,
                                           stream_));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(stream_, passed, 0));
  uint64_t first = 0;
  StorePlace place;
  place.chunks = chunk_list_.as<uint32_t>();
  for (const BucketPlace& b : batch) {
    place.count = b.slots;
    place.chunk_origin = b.center - sequence.center();
    // The bucket's own clock, in which its mean times lose nothing.
    const Sequence local{sequence.begin - b.center, sequence.end - b.center};
    launch_store(rows_of(slots_, first, b.slots), local, place, options_.sh_float32 == 0, slots,
                 stream_);
    place.chunks += b.chunks.size();
    first += b.slots;
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  return {};
}

Status BucketLoader::finish() {
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream_));
  return {};
}

}  // namespace l4d::render
