// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/decode_support.h"

#include <algorithm>
#include <memory>

#include "tests/common/codec.h"

namespace l4d::test {

Bytes block_codebooks_file(bool rans) {
  SceneOptions s;
  s.count = 24000;
  s.sh_degree = 0;
  s.permanent = 0.05;
  EncodeOptions o = small_options();
  o.rans = rans;
  for (const Setting& setting :
       {Setting{L4D_ENC_RCQ, 2}, Setting{L4D_ENC_RCQ_SIZE, 32}, Setting{L4D_ENC_PAGE_SIZE, 4096}}) {
    o.settings.push_back(setting);
  }
  return encode(make_scene(s), o).bytes;
}

std::ostream& operator<<(std::ostream& out, const Verdict& v) {
  return out << v.status << " " << v.where;
}

Verdict verdict(l4d_status status, const std::string& detail) {
  if (status == L4D_OK) return {};
  // "spec RANS-7 at byte 1841: ..."
  return {status, detail.rfind("spec ", 0) == 0 ? detail.substr(0, detail.find(':')) : ""};
}

std::vector<float> PoisonedMemory::read() const {
  std::vector<float> out(bytes_ / sizeof(float));
  cuda_check(cudaMemcpy(out.data(), data_, bytes_, cudaMemcpyDeviceToHost));
  return out;
}

bool PoisonedMemory::is_intact_behind() const {
  std::vector<unsigned char> guard(kGuard);
  cuda_check(cudaMemcpy(guard.data(), static_cast<unsigned char*>(data_) + bytes_, kGuard,
                        cudaMemcpyDeviceToHost));
  return std::all_of(guard.begin(), guard.end(), [](unsigned char b) { return b == kPoison; });
}

DeviceDecoding::DeviceDecoding(DecoderHandle& decoder) : decoder_(decoder) {
  decoder.check(l4d_cuda_decoder_create(decoder.get(), 0, &cuda_));
  const uint32_t degree = decoder.info().sh_degree;
  sh_dim_ = 3 * (degree + 1) * (degree + 1);
}

DeviceResult DeviceDecoding::decode(const l4d_query& query, uint32_t attributes) {
  DeviceResult result;
  const auto failed = [&](l4d_status status) {
    result.status = status;
    result.detail = l4d_cuda_decoder_error_message(cuda_);
    return status != L4D_OK;
  };
  l4d_cuda_request_init(&result.request);
  result.request.attributes = attributes;
  if (failed(l4d_cuda_decoder_prepare(cuda_, &query, &result.request))) return result;
  const size_t n = static_cast<size_t>(result.request.num_gaussians);
  l4d_cuda_gaussian_buffers buffers;
  l4d_cuda_gaussian_buffers_init(&buffers);
  buffers.capacity = n;
  GaussianArrays& out = result.arrays;
  const struct {
    uint32_t attribute;
    size_t numbers;
    float** array;
    std::vector<float>* to;
  } wanted[] = {
      {L4D_CUDA_POSITION, 3, &buffers.position, &out.position},
      {L4D_CUDA_MEAN_T, 1, &buffers.mean_t, &out.mean_t},
      {L4D_CUDA_MEAN_T, 1, &buffers.mean_t_local, &out.mean_t_local},
      {L4D_CUDA_LOG_SCALE, 4, &buffers.log_scale, &out.log_scale},
      {L4D_CUDA_ROTOR, 8, &buffers.rotor, &out.rotor},
      {L4D_CUDA_OPACITY, 1, &buffers.opacity, &out.opacity},
      {L4D_CUDA_SH, sh_dim_, &buffers.sh, &out.sh},
  };
  std::vector<std::unique_ptr<PoisonedMemory>> memory;
  for (const auto& w : wanted) {
    if ((attributes & w.attribute) == 0) continue;
    memory.push_back(std::make_unique<PoisonedMemory>(n * w.numbers * sizeof(float)));
    *w.array = memory.back()->floats();
  }
  const PoisonedMemory workspace(static_cast<size_t>(result.request.workspace_bytes));
  cudaStream_t stream = nullptr;
  cuda_check(cudaStreamCreate(&stream));
  const l4d_status launched = l4d_cuda_decoder_decode(cuda_, &buffers, workspace.data(),
                                                      result.request.workspace_bytes, stream);
  const bool ok = !failed(launched) && !failed(l4d_cuda_decoder_finish(cuda_));
  cuda_check(cudaStreamSynchronize(stream));
  cuda_check(cudaStreamDestroy(stream));
  EXPECT_TRUE(workspace.is_intact_behind());
  size_t next = 0;
  for (const auto& w : wanted) {
    if ((attributes & w.attribute) == 0) continue;
    const PoisonedMemory& array = *memory[next++];
    EXPECT_TRUE(array.is_intact_behind());
    if (ok) *w.to = array.read();
  }
  uint64_t count = 0;
  out.spans.resize(static_cast<size_t>(result.request.num_spans));
  decoder_.check(
      l4d_decoder_get_spans(decoder_.get(), &query, out.spans.data(), out.spans.size(), &count));
  EXPECT_EQ(count, out.spans.size());
  if (!ok) {
    // The failure of the decode, not the success of what was asked afterwards.
    result.status = launched != L4D_OK ? launched : l4d_cuda_decoder_finish(cuda_);
    result.detail = l4d_cuda_decoder_error_message(cuda_);
  }
  return result;
}

DeviceResult decode_on_device(const Bytes& bytes, const l4d_query& query, uint32_t attributes) {
  DecoderHandle decoder;
  decoder.open_memory(bytes.data(), bytes.size());
  return DeviceDecoding(decoder).decode(query, attributes);
}

GaussianArrays only(GaussianArrays arrays, uint32_t attributes) {
  const auto drop = [&](uint32_t attribute, std::vector<float>* array) {
    if ((attributes & attribute) == 0) array->clear();
  };
  drop(L4D_CUDA_POSITION, &arrays.position);
  drop(L4D_CUDA_MEAN_T, &arrays.mean_t);
  drop(L4D_CUDA_MEAN_T, &arrays.mean_t_local);
  drop(L4D_CUDA_LOG_SCALE, &arrays.log_scale);
  drop(L4D_CUDA_ROTOR, &arrays.rotor);
  drop(L4D_CUDA_OPACITY, &arrays.opacity);
  drop(L4D_CUDA_SH, &arrays.sh);
  return arrays;
}

}  // namespace l4d::test
