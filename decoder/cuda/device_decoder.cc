// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/device_decoder.h"

#include <algorithm>

namespace l4d::cuda {
namespace {

constexpr uintptr_t kWorkspaceAlignment = 256;
constexpr uintptr_t kArrayAlignment = 16;

bool is_aligned(const void* address, uintptr_t alignment) {
  return reinterpret_cast<uintptr_t>(address) % alignment == 0;
}

}  // namespace

DeviceDecoder::~DeviceDecoder() {
  if (done_ == nullptr) return;
  // Copies of the last job may still read what goes now.
  if (in_flight_) static_cast<void>(cudaEventSynchronize(done_));
  static_cast<void>(cudaEventDestroy(done_));
}

Status DeviceDecoder::open(int device) {
  device_ = device;
  int multiprocessors = 0;
  L4D_RETURN_IF_CUDA_ERROR(
      cudaDeviceGetAttribute(&multiprocessors, cudaDevAttrMultiProcessorCount, device));
  multiprocessors_ = static_cast<uint32_t>(std::max(1, multiprocessors));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventCreateWithFlags(&done_, cudaEventDisableTiming));
  tables_ = std::make_unique<LayerTables>(decoder_.file());
  job_ = std::make_unique<Job>(decoder_.file(), *tables_, multiprocessors_);
  return {};
}

Status DeviceDecoder::prepare(const l4d_query& query, l4d_cuda_job* job) {
  if ((job->attributes & ~uint32_t{L4D_CUDA_ALL_ATTRIBUTES}) != 0) {
    return invalid_argument("unknown attributes");
  }
  // The job at hand goes, so that its copies must have ended.
  if (in_flight_) L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(done_));
  in_flight_ = false;
  prepared_ = false;
  decoded_ = false;
  uploaded_to_ = nullptr;
  attributes_ = job->attributes;
  L4D_RETURN_IF_ERROR(job_->prepare(query, attributes_));
  L4D_RETURN_IF_ERROR(
      faults_.reserve(std::max<size_t>(1, 2 * job_->num_pages() * sizeof(uint32_t))));
  prepared_ = true;
  job->num_gaussians = job_->plan().num_gaussians;
  job->num_ranges = job_->plan().ranges.size();
  job->num_chunks = job_->plan().tasks.size();
  job->upload_bytes = job_->upload_bytes();
  job->workspace_bytes = job_->workspace_bytes();
  return {};
}

Status DeviceDecoder::check_workspace(const void* workspace, uint64_t size) const {
  if (!prepared_) return Status(L4D_ERR_INVALID_STATE, "nothing is prepared");
  if (job_->workspace_bytes() == 0) return {};
  if (size < job_->workspace_bytes()) {
    return invalid_argument("the workspace has " + std::to_string(size) + " bytes, the job needs " +
                            std::to_string(job_->workspace_bytes()));
  }
  if (workspace == nullptr || !is_aligned(workspace, kWorkspaceAlignment)) {
    return invalid_argument("the workspace is not at a multiple of " +
                            std::to_string(kWorkspaceAlignment) + " bytes");
  }
  return {};
}

Status DeviceDecoder::upload(void* workspace, uint64_t workspace_size, cudaStream_t stream) {
  L4D_RETURN_IF_ERROR(check_workspace(workspace, workspace_size));
  if (job_->staging_bytes() == 0) return {};
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(workspace, job_->staging(),
                                           static_cast<size_t>(job_->staging_bytes()),
                                           cudaMemcpyHostToDevice, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(done_, stream));
  in_flight_ = true;
  uploaded_to_ = workspace;
  return {};
}

Status DeviceDecoder::copy_host_rows(const DeviceArrays& out, cudaStream_t stream) const {
  const l4d_gaussian_buffers& from = job_->host_arrays();
  const uint64_t sh_dim = decoder_.file().header().sh_dim();
  const struct {
    const float* from;
    float* to;
    uint64_t numbers;
  } arrays[] = {
      {from.position, out.position, 3},   {from.mean_t, out.mean_t, 1},
      {from.mean_t_local, out.mean_t_local, 1}, {from.log_scale, out.log_scale, 4},
      {from.rotor, out.rotor, 8},         {from.opacity, out.opacity, 1},
      {from.sh, out.sh, sh_dim},
  };
  for (const HostRun& run : job_->host_runs()) {
    for (const auto& a : arrays) {
      if (a.to == nullptr) continue;
      L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(
          a.to + a.numbers * run.first, a.from + a.numbers * run.first,
          static_cast<size_t>(a.numbers * run.count) * sizeof(float), cudaMemcpyHostToDevice,
          stream));
    }
  }
  return {};
}

Status DeviceDecoder::decode(const l4d_cuda_gaussian_buffers& out, void* workspace,
                             uint64_t workspace_size, cudaStream_t stream) {
  L4D_RETURN_IF_ERROR(check_workspace(workspace, workspace_size));
  if (job_->plan().num_gaussians > out.capacity) {
    return invalid_argument("capacity is " + std::to_string(out.capacity) + ", the job has " +
                            std::to_string(job_->plan().num_gaussians) + " Gaussians");
  }
  const DeviceArrays arrays = {out.position, out.mean_t,  out.mean_t_local, out.log_scale,
                               out.rotor,    out.opacity, out.sh};
  const struct {
    const float* array;
    uint32_t attribute;
  } given[] = {
      {out.position, L4D_CUDA_POSITION}, {out.mean_t, L4D_CUDA_MEAN_T},
      {out.mean_t_local, L4D_CUDA_MEAN_T}, {out.log_scale, L4D_CUDA_LOG_SCALE},
      {out.rotor, L4D_CUDA_ROTOR},       {out.opacity, L4D_CUDA_OPACITY},
      {out.sh, L4D_CUDA_SH},
  };
  for (const auto& g : given) {
    if (g.array == nullptr) continue;
    if ((attributes_ & g.attribute) == 0) {
      return invalid_argument("an array is given for an attribute that was not prepared");
    }
    if (!is_aligned(g.array, kArrayAlignment)) {
      return invalid_argument("an array is not at a multiple of " +
                              std::to_string(kArrayAlignment) + " bytes");
    }
  }
  if (uploaded_to_ != workspace || workspace == nullptr) {
    L4D_RETURN_IF_ERROR(upload(workspace, workspace_size, stream));
  }
  uploaded_to_ = nullptr;
  if (job_->num_pages() > 0) {
    unsigned char* at = static_cast<unsigned char*>(workspace);
    const DeviceJob job = job_->device_job(at);
    L4D_RETURN_IF_CUDA_ERROR(launch_planes(job, job_->planes_launch(), stream));
    L4D_RETURN_IF_CUDA_ERROR(launch_expand(job, job_->expand_launch(), arrays, stream));
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(faults_.data(), at + job_->faults_at(),
                                             2 * job_->num_pages() * sizeof(uint32_t),
                                             cudaMemcpyDeviceToHost, stream));
  }
  L4D_RETURN_IF_ERROR(copy_host_rows(arrays, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(done_, stream));
  in_flight_ = true;
  decoded_ = true;
  return {};
}

Status DeviceDecoder::finish() {
  if (!decoded_) return Status(L4D_ERR_INVALID_STATE, "nothing was decoded");
  L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(done_));
  in_flight_ = false;
  return job_->check(faults_.as<const uint32_t>());
}

}  // namespace l4d::cuda
