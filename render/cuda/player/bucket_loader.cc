// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/player/bucket_loader.h"

#include <algorithm>

#include "l4d/cuda.h"

namespace l4d::render {
namespace {

constexpr size_t kAlignment = 256;
size_t aligned(size_t bytes) { return (bytes + kAlignment - 1) / kAlignment * kAlignment; }
// So that memory is not made anew for each bucket that is a little larger.
size_t with_slack(size_t bytes) { return bytes + bytes / 4; }

}  // namespace

BucketLoader::~BucketLoader() {
  l4d_cuda_decoder_destroy(cuda_);
  if (stream_ != nullptr) cudaStreamDestroy(stream_);
}

Status BucketLoader::told(l4d_status status) const {
  if (status == L4D_OK) return {};
  const char* detail = l4d_cuda_decoder_error_message(cuda_);
  return Status(status, *detail != 0 ? detail : l4d_status_name(status));
}

Status BucketLoader::create() {
  l4d_info info;
  l4d_info_init(&info);
  if (l4d_decoder_get_info(decoder_, &info) != L4D_OK) {
    return Status(L4D_ERR_INVALID_STATE, "no stream is open");
  }
  sh_degree_ = info.sh_degree;
  flags_ = info.flags;
  const l4d_status made = l4d_cuda_decoder_create(decoder_, options_.device, &cuda_);
  if (made != L4D_OK) return Status(made, l4d_decoder_error_message(decoder_));
  int lowest = 0, highest = 0;
  L4D_RETURN_IF_CUDA_ERROR(cudaDeviceGetStreamPriorityRange(&lowest, &highest));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamCreateWithPriority(&stream_, cudaStreamNonBlocking, lowest));
  return {};
}

Status BucketLoader::plan(double begin, double end, std::vector<BucketPlace>* out) {
  l4d_query query;
  l4d_query_init(&query);
  query.kind = L4D_QUERY_RANGE;
  query.time_begin = begin;
  query.time_end = end;
  query.max_level = options_.max_level;
  query.max_tier = options_.max_tier;
  query.whole_buckets = 1;
  std::vector<l4d_bucket_span> spans(64);
  uint64_t count = 0;
  for (;;) {
    const l4d_status status =
        l4d_decoder_get_spans(decoder_, &query, spans.data(), spans.size(), &count);
    if (status != L4D_OK) return Status(status, l4d_decoder_error_message(decoder_));
    if (count <= spans.size()) break;
    spans.resize(static_cast<size_t>(count));
  }
  out->clear();
  for (size_t i = 0; i < static_cast<size_t>(count); ++i) {
    const l4d_bucket_span& r = spans[i];
    if (r.count == 0) continue;
    if (r.count > kSlotMask)
      return Status(L4D_ERR_LIMIT_EXCEEDED, "a bucket of more than 2^30 - 1 slots");
    out->push_back({{r.layer, r.bucket}, static_cast<uint32_t>(r.count), r.center, {}});
  }
  return {};
}

Status BucketLoader::wait_for(cudaEvent_t passed) {
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamWaitEvent(stream_, passed, 0));
  return {};
}

uint64_t BucketLoader::scratch_bytes() const {
  return gaussians_.size() + workspace_.size() + chunk_list_.size();
}

Status BucketLoader::reserve_arrays(uint64_t gaussians, uint64_t workspace) {
  const size_t n = static_cast<size_t>(gaussians);
  const auto bytes_of = [&](const AttributeInfo& a) {
    return aligned(n * a.numbers(sh_degree_) * sizeof(float));
  };
  size_t bytes = 0;
  for (const AttributeInfo& a : kAttributes) bytes += bytes_of(a);
  if (bytes > gaussians_.size()) L4D_RETURN_IF_ERROR(gaussians_.reserve(with_slack(bytes)));
  if (workspace > workspace_.size()) {
    L4D_RETURN_IF_ERROR(workspace_.reserve(with_slack(static_cast<size_t>(workspace))));
  }
  l4d_cuda_gaussian_buffers_init(&arrays_);
  arrays_.capacity = gaussians;
  slots_ = {};
  slots_.struct_size = sizeof slots_;
  slots_.sh_degree = sh_degree_;
  slots_.flags = flags_;
  auto* at = gaussians_.as<unsigned char>();
  for_each_attribute(
      [&](const AttributeInfo& a, float*& to, const float*& from) {
        from = to = reinterpret_cast<float*>(at);
        at += bytes_of(a);
      },
      arrays_, slots_);
  // Each bucket has its own clock.
  std::swap(arrays_.mean_t, arrays_.mean_t_local);
  return {};
}

Status BucketLoader::load(const std::vector<BucketPlace>& buckets, const Sequence& sequence,
                          bool half_sh, const ResidentGaussians& slots) {
  std::vector<l4d_bucket> list;
  size_t chunks = 0;
  for (const BucketPlace& b : buckets) {
    list.push_back(b.bucket);
    chunks += b.chunks.size();
  }
  l4d_query query;
  l4d_query_init(&query);
  query.kind = L4D_QUERY_BUCKETS;
  query.buckets = list.data();
  query.num_buckets = list.size();
  query.detail = options_.detail;
  l4d_cuda_request request;
  l4d_cuda_request_init(&request);
  L4D_RETURN_IF_ERROR(told(l4d_cuda_decoder_prepare(cuda_, &query, &request)));
  uint64_t wanted = 0;
  for (const BucketPlace& b : buckets) wanted += b.slots;
  if (request.num_gaussians != wanted) {
    return Status(L4D_ERR_IO, "the stream's directory changed while it was played");
  }
  L4D_RETURN_IF_ERROR(reserve_arrays(request.num_gaussians, request.workspace_bytes));
  L4D_RETURN_IF_ERROR(chunk_staging_.reserve(with_slack(chunks * sizeof(uint32_t))));
  L4D_RETURN_IF_ERROR(chunk_list_.reserve(with_slack(chunks * sizeof(uint32_t))));
  uint32_t* to = chunk_staging_.as<uint32_t>();
  for (const BucketPlace& b : buckets) to = std::copy(b.chunks.begin(), b.chunks.end(), to);
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(chunk_list_.data(), chunk_staging_.data(),
                                           chunks * sizeof(uint32_t), cudaMemcpyHostToDevice,
                                           stream_));
  L4D_RETURN_IF_ERROR(told(
      l4d_cuda_decoder_decode(cuda_, &arrays_, workspace_.data(), workspace_.size(), stream_)));
  uint64_t first = 0;
  StorePlace place;
  place.chunks = chunk_list_.as<uint32_t>();
  for (const BucketPlace& b : buckets) {
    place.count = b.slots;
    place.chunk_origin = b.center - sequence.center();
    // The bucket's own clock, in which its mean times lose nothing.
    const Sequence local{sequence.begin - b.center, sequence.end - b.center};
    launch_store(rows_of(slots_, first, b.slots), local, place, half_sh, slots, stream_);
    place.chunks += b.chunks.size();
    first += b.slots;
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
  uploaded_ += request.upload_bytes;
  L4D_RETURN_IF_ERROR(told(l4d_cuda_decoder_finish(cuda_)));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(stream_));
  return {};
}

}  // namespace l4d::render
