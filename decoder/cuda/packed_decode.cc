// SPDX-License-Identifier: Apache-2.0
// The packed form: what DeviceDecoder hands out undequantised, and the codebooks that go with it.
#include <iterator>
#include <string>
#include <vector>

#include "decoder/cuda/device_decoder.h"
#include "decoder/read/find_codebook.h"
#include "l4d/experimental/cuda_packed.h"

namespace l4d::cuda {
namespace {

PackedArrays packed_arrays(const l4d_cuda_packed_buffers& from) {
  PackedArrays to{};
  to.position = from.position;
  to.mean_t = from.mean_t;
  to.opacity = from.opacity;
  to.scale_factor = from.scale_factor;
  to.window = from.window;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const l4d_cuda_packed_component& component = from.component[c];
    to.component[c] = {component.depth, component.index, component.escape,
                       component.escape_capacity};
  }
  to.capacity = from.capacity;
  return to;
}

}  // namespace

Status DeviceDecoder::decode_packed(const l4d_cuda_packed_buffers& out, void* workspace,
                                    uint64_t workspace_size, cudaStream_t stream) {
  L4D_RETURN_IF_ERROR(check_has_packed_form());
  L4D_RETURN_IF_ERROR(check_workspace(workspace, workspace_size));
  std::vector<GivenArray> given = {{out.position, L4D_CUDA_POSITION},
                                   {out.mean_t, L4D_CUDA_MEAN_T},
                                   {out.opacity, L4D_CUDA_OPACITY},
                                   {out.scale_factor, L4D_CUDA_LOG_SCALE},
                                   {out.window, L4D_CUDA_MEAN_T}};
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const l4d_cuda_packed_component& component = out.component[c];
    for (const void* array :
         {static_cast<const void*>(component.depth), static_cast<const void*>(component.index),
          static_cast<const void*>(component.escape)}) {
      given.push_back({array, component_attribute(c)});
    }
  }
  L4D_RETURN_IF_ERROR(check_arrays(L4D_CUDA_FORM_PACKED, out.capacity, given.data(), given.size()));
  const PackedArrays arrays = packed_arrays(out);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    escape_capacity_[c] =
        out.component[c].escape != nullptr ? out.component[c].escape_capacity : UINT64_MAX;
  }
  L4D_RETURN_IF_ERROR(begin_decode(workspace, workspace_size, stream));
  if (request_->staging_bytes() > 0) {
    const DeviceRequest request = request_->device_request(static_cast<unsigned char*>(workspace));
    L4D_RETURN_IF_CUDA_ERROR(launch_pack(request, arrays, stream));
  }
  L4D_RETURN_IF_ERROR(copy_packed_host_rows(arrays, stream));
  return end_decode(workspace, L4D_CUDA_FORM_PACKED, stream);
}

Status DeviceDecoder::copy_packed_host_rows(const PackedArrays& out, cudaStream_t stream) const {
  const l4d_packed_buffers& from = request_->host().packed();
  const SceneHeader& header = decoder_.file().header();
  for (const HostRun& run : request_->host().runs()) {
    const auto copy = [&](const auto* source, auto* target, uint64_t numbers) -> Status {
      if (target == nullptr) return {};
      L4D_RETURN_IF_CUDA_ERROR(
          cudaMemcpyAsync(target + numbers * run.first, source + numbers * run.first,
                          static_cast<size_t>(numbers * run.count) * sizeof(*target),
                          cudaMemcpyHostToDevice, stream));
      return {};
    };
    L4D_RETURN_IF_ERROR(copy(from.position, out.position, 3));
    L4D_RETURN_IF_ERROR(copy(from.mean_t, out.mean_t, 1));
    L4D_RETURN_IF_ERROR(copy(from.opacity, out.opacity, 1));
    L4D_RETURN_IF_ERROR(copy(from.scale_factor, out.scale_factor, 1));
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      L4D_RETURN_IF_ERROR(copy(from.component[c].depth, out.component[c].depth, 1));
      if (out.component[c].index == nullptr) continue;
      const size_t stages = header.component(header.layers[run.layer], c).stages.size();
      for (size_t s = 0; s < stages; ++s) {
        L4D_RETURN_IF_ERROR(copy(from.component[c].index + s * from.capacity,
                                 out.component[c].index + s * out.capacity, 1));
      }
    }
  }
  return copy_host_windows(from.window, out.window, stream);
}

Status DeviceDecoder::check_escapes() const {
  const uint64_t* counts = request_->num_escapes(results_.data());
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (counts[c] <= escape_capacity_[c]) continue;
    return Status(L4D_ERR_BUFFER_TOO_SMALL, "escape_capacity of component " + std::to_string(c) +
                                                " is " + std::to_string(escape_capacity_[c]) +
                                                ", the request has " + std::to_string(counts[c]) +
                                                " escapes");
  }
  return {};
}

Status DeviceDecoder::num_escapes(uint64_t* counts) const {
  if (!finished_ || decoded_ != L4D_CUDA_FORM_PACKED) {
    return Status(L4D_ERR_INVALID_STATE, "no packed decode has finished");
  }
  std::copy_n(request_->num_escapes(results_.data()), L4D_COMPONENT_COUNT, counts);
  return {};
}

Status DeviceDecoder::codebook(uint32_t layer, uint32_t component, uint32_t stage, uint32_t block,
                               l4d_codebook* out) {
  l4d_codebook of_layer{}, host{};
  L4D_RETURN_IF_ERROR(
      find_codebook(decoder_.file(), layer, component, stage, L4D_NO_BLOCK, &of_layer));
  L4D_RETURN_IF_ERROR(find_codebook(decoder_.file(), layer, component, stage, block, &host));
  *out = host;
  if (host.entries == nullptr) return {};
  if (host.entries == of_layer.entries) {
    L4D_RETURN_IF_ERROR(tables_->load_codebooks(layer, component));
    out->entries = tables_->layers()[layer].component[component].codebook[stage];
    return {};
  }
  DeviceMemory& memory = block_codebooks_[{layer, component, block}];
  if (memory.data() == nullptr) {
    const size_t bytes = size_t{host.num_entries} * host.dim * sizeof(float);
    DeviceMemory fresh;
    L4D_RETURN_IF_ERROR(fresh.reserve(bytes));
    L4D_RETURN_IF_ERROR(copy_to_device(host.entries, bytes, fresh.data()));
    memory = std::move(fresh);
  }
  out->entries = memory.as<const float>();
  return {};
}

}  // namespace l4d::cuda
