// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/host_decode.h"

#include <algorithm>
#include <string>
#include <vector>

#include "l4d/attributes.hpp"

namespace l4d::cuda {
namespace {

constexpr uint64_t kAlignment = 256;

uint64_t aligned(uint64_t bytes) { return (bytes + kAlignment - 1) / kAlignment * kAlignment; }

}  // namespace

Status HostDecode::decode(const l4d_query& query, l4d_gaussian_buffers* out) {
  struct Part {
    void* host;
    size_t bytes;  // of a Gaussian
    uint32_t attribute;
    void* device;
  };
  std::vector<Part> parts;
  for_each_decoded(
      [&](const AttributeInfo& a, float* host) {
        parts.push_back({host, (a.dim != 0 ? a.dim : sh_dim_) * sizeof(float), a.flag, nullptr});
      },
      *out);
  parts.push_back({out->window, 2 * sizeof(uint32_t), L4D_CUDA_MEAN_T, nullptr});
  l4d_cuda_request request{};
  request.struct_size = sizeof(request);
  request.forms = L4D_CUDA_FORM_EXPANDED;
  for (const Part& part : parts) request.attributes |= part.host != nullptr ? part.attribute : 0;
  L4D_RETURN_IF_ERROR(device_.prepare(query, &request));
  const uint64_t n = request.num_gaussians;
  if (out->capacity < n || (out->spans != nullptr && out->span_capacity < request.num_spans)) {
    out->count = n;
    out->num_spans = request.num_spans;
    return Status(L4D_ERR_BUFFER_TOO_SMALL,
                  "the selection has " + std::to_string(n) + " Gaussians in " +
                      std::to_string(request.num_spans) + " ranges, more than there is room for");
  }
  uint64_t bytes = aligned(request.workspace_bytes);
  for (const Part& part : parts) {
    if (part.host != nullptr) bytes += aligned(n * part.bytes);
  }
  L4D_RETURN_IF_ERROR(memory_.reserve(std::max<uint64_t>(bytes, kAlignment)));
  unsigned char* at = memory_.as<unsigned char>() + aligned(request.workspace_bytes);
  for (Part& part : parts) {
    if (part.host == nullptr) continue;
    part.device = at;
    at += aligned(n * part.bytes);
  }
  l4d_cuda_gaussian_buffers arrays{};
  auto next = parts.begin();
  for_each_decoded(
      [&](const AttributeInfo&, float*& array) { array = static_cast<float*>(next++->device); },
      arrays);
  arrays.window = static_cast<uint32_t*>(next->device);
  arrays.struct_size = sizeof(arrays);
  arrays.capacity = n;
  L4D_RETURN_IF_ERROR(device_.decode(arrays, memory_.data(), request.workspace_bytes, nullptr));
  L4D_RETURN_IF_ERROR(device_.finish());
  for (const Part& part : parts) {
    if (part.host == nullptr) continue;
    L4D_RETURN_IF_CUDA_ERROR(
        cudaMemcpy(part.host, part.device, n * part.bytes, cudaMemcpyDeviceToHost));
  }
  if (out->id != nullptr) write_ids(*device_.plan(), out->id);
  const std::vector<l4d_bucket_span>& spans = device_.plan()->spans;
  out->count = n;
  if (out->spans != nullptr) {
    std::copy(spans.begin(), spans.end(), out->spans);
    out->num_spans = spans.size();
  }
  return {};
}

}  // namespace l4d::cuda
