// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/device_decoder.h"

#include <algorithm>
#include <iterator>

#include "l4d/attributes.hpp"
#include "libl4dcodec/container/levels.h"

namespace l4d::cuda {

static_assert(info_of(Attribute::kPosition).flag == L4D_CUDA_POSITION &&
              info_of(Attribute::kMeanTime).flag == L4D_CUDA_MEAN_T &&
              info_of(Attribute::kLogScale).flag == L4D_CUDA_LOG_SCALE &&
              info_of(Attribute::kRotor).flag == L4D_CUDA_ROTOR &&
              info_of(Attribute::kOpacity).flag == L4D_CUDA_OPACITY &&
              info_of(Attribute::kSh).flag == L4D_CUDA_SH);
namespace {

constexpr uintptr_t kWorkspaceAlignment = 256;
constexpr uintptr_t kArrayAlignment = 16;

bool is_aligned(const void* address, uintptr_t alignment) {
  return reinterpret_cast<uintptr_t>(address) % alignment == 0;
}

}  // namespace

DeviceDecoder::~DeviceDecoder() {
  if (done_ == nullptr) return;
  // Copies of the last request may still read what goes now.
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
  request_ = std::make_unique<PreparedRequest>(decoder_.file(), *tables_, multiprocessors_,
                                               decoder_.threads());
  return {};
}

Status DeviceDecoder::prepare(const l4d_query& query, l4d_cuda_request* request) {
  if ((request->attributes & ~uint32_t{L4D_CUDA_ALL_ATTRIBUTES}) != 0) {
    return invalid_argument("unknown attributes");
  }
  const uint32_t all_forms = L4D_CUDA_FORM_EXPANDED | L4D_CUDA_FORM_PACKED;
  if (request->forms == 0 || (request->forms & ~all_forms) != 0)
    return invalid_argument("unknown forms");
  // The request at hand goes, so that its copies must have ended.
  if (in_flight_) L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(done_));
  in_flight_ = false;
  prepared_ = false;
  decoded_ = 0;
  finished_ = false;
  uploaded_to_ = nullptr;
  block_codebooks_.clear();
  attributes_ = request->attributes;
  forms_ = request->forms;
  if ((forms_ & L4D_CUDA_FORM_PACKED) != 0) L4D_RETURN_IF_ERROR(check_has_packed_form());
  L4D_RETURN_IF_ERROR(request_->prepare(query, attributes_, forms_));
  const size_t result_bytes = static_cast<size_t>(request_->results_bytes());
  L4D_RETURN_IF_ERROR(results_.reserve(result_bytes));
  // What it stays where nothing runs on the device.
  std::fill_n(results_.as<unsigned char>(), result_bytes, static_cast<unsigned char>(0));
  prepared_ = true;
  request->num_gaussians = request_->plan().num_gaussians;
  request->num_spans = request_->plan().spans.size();
  request->num_pages = request_->plan().tasks.size();
  request->upload_bytes = request_->upload_bytes();
  request->workspace_bytes = request_->workspace_bytes();
  return {};
}

Status DeviceDecoder::check_workspace(const void* workspace, uint64_t size) const {
  if (!prepared_) return Status(L4D_ERR_INVALID_STATE, "nothing is prepared");
  if (request_->workspace_bytes() == 0) return {};
  if (size < request_->workspace_bytes()) {
    return invalid_argument("the workspace has " + std::to_string(size) +
                            " bytes, the request needs " +
                            std::to_string(request_->workspace_bytes()));
  }
  if (workspace == nullptr || !is_aligned(workspace, kWorkspaceAlignment)) {
    return invalid_argument("the workspace is not at a multiple of " +
                            std::to_string(kWorkspaceAlignment) + " bytes");
  }
  return {};
}

Status DeviceDecoder::upload(void* workspace, uint64_t workspace_size, cudaStream_t stream) {
  L4D_RETURN_IF_ERROR(check_workspace(workspace, workspace_size));
  if (request_->staging_bytes() == 0) return {};
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(workspace, request_->staging(),
                                           static_cast<size_t>(request_->staging_bytes()),
                                           cudaMemcpyHostToDevice, stream));
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(done_, stream));
  in_flight_ = true;
  uploaded_to_ = workspace;
  return {};
}

Status DeviceDecoder::copy_host_rows(const DeviceArrays& out, cudaStream_t stream) const {
  const uint32_t degree = decoder_.file().header().sh_degree;
  cudaError_t error = cudaSuccess;
  for_each_decoded(
      [&](const AttributeInfo& a, const float* from, float* to) {
        const uint64_t numbers = a.numbers(degree);
        for (const HostRun& run : request_->host().runs()) {
          if (to == nullptr || error != cudaSuccess) return;
          error = cudaMemcpyAsync(to + numbers * run.first, from + numbers * run.first,
                                  static_cast<size_t>(numbers * run.count) * sizeof(float),
                                  cudaMemcpyHostToDevice, stream);
        }
      },
      request_->host().expanded(), out);
  L4D_RETURN_IF_CUDA_ERROR(error);
  return copy_host_windows(request_->host().expanded().window, out.window, stream);
}

// Streams without windows have no rows of them.
Status DeviceDecoder::copy_host_windows(const uint32_t* from, uint32_t* to,
                                        cudaStream_t stream) const {
  if (to == nullptr) return {};
  for (const HostRun& run : request_->host().runs()) {
    const size_t bytes = static_cast<size_t>(run.count) * 2 * sizeof(uint32_t);
    uint32_t* const rows = to + 2 * run.first;
    if (from == nullptr) {
      L4D_RETURN_IF_CUDA_ERROR(cudaMemsetAsync(rows, 0, bytes, stream));
    } else {
      L4D_RETURN_IF_CUDA_ERROR(
          cudaMemcpyAsync(rows, from + 2 * run.first, bytes, cudaMemcpyHostToDevice, stream));
    }
  }
  return {};
}

Status DeviceDecoder::check_has_packed_form() const {
  if (has_packed_form(decoder_.file().header())) return {};
  return Status(L4D_ERR_FEATURE_UNSUPPORTED, "only streams of codebook indices have a packed form");
}

Status DeviceDecoder::check_arrays(uint32_t form, uint64_t capacity, const GivenArray* arrays,
                                   size_t count) const {
  if ((forms_ & form) == 0) return invalid_argument("the request was not prepared in this form");
  if (request_->plan().num_gaussians > capacity) {
    return Status(L4D_ERR_BUFFER_TOO_SMALL,
                  "capacity is " + std::to_string(capacity) + ", the request has " +
                      std::to_string(request_->plan().num_gaussians) + " Gaussians");
  }
  for (size_t i = 0; i < count; ++i) {
    if (arrays[i].array == nullptr) continue;
    if ((attributes_ & arrays[i].attribute) == 0) {
      return invalid_argument("an array is given for an attribute that was not prepared");
    }
    if (!is_aligned(arrays[i].array, kArrayAlignment)) {
      return invalid_argument("an array is not at a multiple of " +
                              std::to_string(kArrayAlignment) + " bytes");
    }
  }
  return {};
}

Status DeviceDecoder::begin_decode(void* workspace, uint64_t workspace_size, cudaStream_t stream) {
  if (uploaded_to_ != workspace || workspace == nullptr) {
    L4D_RETURN_IF_ERROR(upload(workspace, workspace_size, stream));
  }
  uploaded_to_ = nullptr;
  if (request_->num_pages() == 0) return {};
  const DeviceRequest request = request_->device_request(static_cast<unsigned char*>(workspace));
  L4D_RETURN_IF_CUDA_ERROR(launch_channels(request, request_->channels_launch(), stream));
  return {};
}

Status DeviceDecoder::end_decode(const void* workspace, uint32_t form, cudaStream_t stream) {
  if (request_->staging_bytes() > 0) {
    const unsigned char* from =
        static_cast<const unsigned char*>(workspace) + request_->faults_at();
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpyAsync(results_.data(), from,
                                             static_cast<size_t>(request_->results_bytes()),
                                             cudaMemcpyDeviceToHost, stream));
  }
  L4D_RETURN_IF_CUDA_ERROR(cudaEventRecord(done_, stream));
  in_flight_ = true;
  decoded_ = form;
  finished_ = false;
  return {};
}

Status DeviceDecoder::decode(const l4d_cuda_gaussian_buffers& out, void* workspace,
                             uint64_t workspace_size, cudaStream_t stream) {
  L4D_RETURN_IF_ERROR(check_workspace(workspace, workspace_size));
  std::vector<GivenArray> given;
  for_each_decoded(
      [&](const AttributeInfo& a, const float* array) {
        given.push_back({array, a.flag});
      },
      out);
  given.push_back({out.window, L4D_CUDA_MEAN_T});
  L4D_RETURN_IF_ERROR(
      check_arrays(L4D_CUDA_FORM_EXPANDED, out.capacity, given.data(), given.size()));
  L4D_RETURN_IF_ERROR(begin_decode(workspace, workspace_size, stream));
  if (request_->num_pages() > 0) {
    const DeviceRequest request = request_->device_request(static_cast<unsigned char*>(workspace));
    L4D_RETURN_IF_CUDA_ERROR(launch_expand(request, request_->expand_launch(), out, stream));
  }
  L4D_RETURN_IF_ERROR(copy_host_rows(out, stream));
  return end_decode(workspace, L4D_CUDA_FORM_EXPANDED, stream);
}

Status DeviceDecoder::finish() {
  if (decoded_ == 0) return Status(L4D_ERR_INVALID_STATE, "nothing was decoded");
  L4D_RETURN_IF_CUDA_ERROR(cudaEventSynchronize(done_));
  in_flight_ = false;
  finished_ = true;
  L4D_RETURN_IF_ERROR(request_->check(results_.as<const uint32_t>()));
  return decoded_ == L4D_CUDA_FORM_PACKED ? check_escapes() : Status();
}

}  // namespace l4d::cuda
