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
  l4d_cuda_gaussian_buffers arrays{};
  struct Part {
    float* host;
    float** device;
    size_t numbers;
    uint32_t attribute;
  };
  std::vector<Part> parts;
  for_each_decoded(
      [&](const AttributeInfo& a, float* host, float*& device) {
        parts.push_back({host, &device, a.dim != 0 ? a.dim : sh_dim_, a.flag});
      },
      *out, arrays);
  l4d_cuda_job job{};
  job.struct_size = sizeof(job);
  job.forms = L4D_CUDA_FORM_EXPANDED;
  for (const Part& part : parts) job.attributes |= part.host != nullptr ? part.attribute : 0;
  L4D_RETURN_IF_ERROR(device_.prepare(query, &job));
  const uint64_t n = job.num_gaussians;
  if (out->capacity < n || (out->ranges != nullptr && out->range_capacity < job.num_ranges)) {
    out->count = n;
    out->num_ranges = job.num_ranges;
    return Status(L4D_ERR_BUFFER_TOO_SMALL, "the selection has " + std::to_string(n) +
                                                " Gaussians in " + std::to_string(job.num_ranges) +
                                                " ranges, more than there is room for");
  }
  uint64_t bytes = aligned(job.workspace_bytes);
  for (const Part& part : parts) {
    if (part.host != nullptr) bytes += aligned(n * part.numbers * sizeof(float));
  }
  L4D_RETURN_IF_ERROR(memory_.reserve(std::max<uint64_t>(bytes, kAlignment)));
  unsigned char* at = memory_.as<unsigned char>() + aligned(job.workspace_bytes);
  for (const Part& part : parts) {
    if (part.host == nullptr) continue;
    *part.device = reinterpret_cast<float*>(at);
    at += aligned(n * part.numbers * sizeof(float));
  }
  arrays.struct_size = sizeof(arrays);
  arrays.capacity = n;
  L4D_RETURN_IF_ERROR(device_.decode(arrays, memory_.data(), job.workspace_bytes, nullptr));
  L4D_RETURN_IF_ERROR(device_.finish());
  for (const Part& part : parts) {
    if (part.host == nullptr) continue;
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpy(part.host, *part.device, n * part.numbers * sizeof(float),
                                        cudaMemcpyDeviceToHost));
  }
  if (out->id != nullptr) write_ids(*device_.plan(), out->id);
  const std::vector<l4d_range>& ranges = device_.plan()->ranges;
  out->count = n;
  if (out->ranges != nullptr) {
    std::copy(ranges.begin(), ranges.end(), out->ranges);
    out->num_ranges = ranges.size();
  }
  return {};
}

}  // namespace l4d::cuda
