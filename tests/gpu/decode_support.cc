// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/decode_support.h"

#include <algorithm>
#include <memory>

#include "tests/common/codec.h"
#include "tests/common/random.h"

namespace l4d::test {
namespace {

testing::AssertionResult same_ranges(const std::vector<l4d_bucket_span>& a,
                                     const std::vector<l4d_bucket_span>& b) {
  if (a.size() != b.size()) return testing::AssertionFailure() << a.size() << " and " << b.size();
  for (size_t i = 0; i < a.size(); ++i) {
    if (a[i].first != b[i].first || a[i].count != b[i].count || a[i].layer != b[i].layer ||
        a[i].bucket != b[i].bucket || a[i].block != b[i].block) {
      return testing::AssertionFailure() << "range " << i;
    }
  }
  return testing::AssertionSuccess();
}

}  // namespace

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

TestScene windowed_scene(const SceneOptions& options, uint32_t longest) {
  TestScene scene = make_scene(options);
  Random random(11);
  for (size_t i = 0; i < scene.count(); ++i) {
    const uint32_t begin = random.below(options.num_frames);
    const uint32_t end = std::min(begin + 1 + random.below(longest), options.num_frames);
    const bool flat = i % 3 != 0;
    scene.window.push_back(flat ? begin : 0);
    scene.window.push_back(flat ? end : 0);
  }
  return scene;
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

std::vector<uint32_t> PoisonedMemory::read_words() const {
  std::vector<uint32_t> out(bytes_ / sizeof(uint32_t));
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
    result.detail = l4d_last_error_message();
    return status != L4D_OK;
  };
  result.request = L4D_INIT(l4d_cuda_request);
  result.request.attributes = attributes;
  if (failed(l4d_cuda_decoder_prepare(cuda_, &query, &result.request))) return result;
  const size_t n = static_cast<size_t>(result.request.num_gaussians);
  l4d_cuda_gaussian_buffers buffers = L4D_INIT(l4d_cuda_gaussian_buffers);
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
  const bool times = (attributes & L4D_CUDA_MEAN_T) != 0;
  const PoisonedMemory window(times ? 2 * n * sizeof(uint32_t) : 0);
  if (times) buffers.window = window.words();
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
  EXPECT_TRUE(window.is_intact_behind());
  if (ok && times) out.window = window.read_words();
  uint64_t count = 0;
  out.spans.resize(static_cast<size_t>(result.request.num_spans));
  decoder_.check(
      l4d_decoder_get_spans(decoder_.get(), &query, out.spans.data(), out.spans.size(), &count));
  EXPECT_EQ(count, out.spans.size());
  if (!ok) {
    // The failure of the decode, not the success of what was asked afterwards.
    result.status = launched != L4D_OK ? launched : l4d_cuda_decoder_finish(cuda_);
    result.detail = l4d_last_error_message();
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
  if ((attributes & L4D_CUDA_MEAN_T) == 0) arrays.window.clear();
  return arrays;
}

void expect_as_on_host(const Bytes& bytes, const l4d_query& query, uint32_t attributes) {
  GaussianArrays expected = only(decode(bytes, query, L4D_BACKEND_REFERENCE), attributes);
  // Zeros where nothing has a window.
  expected.window.resize(2 * expected.mean_t.size());
  const DeviceResult found = decode_on_device(bytes, query, attributes);
  ASSERT_EQ(found.status, L4D_OK) << found.detail;
  EXPECT_TRUE(same_bits("position", found.arrays.position, expected.position));
  EXPECT_TRUE(same_bits("mean_t", found.arrays.mean_t, expected.mean_t));
  EXPECT_TRUE(same_bits("mean_t_local", found.arrays.mean_t_local, expected.mean_t_local));
  EXPECT_EQ(found.arrays.window, expected.window);
  EXPECT_TRUE(same_bits("log_scale", found.arrays.log_scale, expected.log_scale));
  EXPECT_TRUE(same_bits("rotor", found.arrays.rotor, expected.rotor));
  EXPECT_TRUE(same_bits("opacity", found.arrays.opacity, expected.opacity));
  EXPECT_TRUE(same_bits("sh", found.arrays.sh, expected.sh));
  EXPECT_TRUE(same_ranges(found.arrays.spans, expected.spans));
}

void expect_as_on_host_for_all_queries(const Bytes& bytes) {
  expect_as_on_host(bytes, all_query());
  for (const double time : {0.0, 0.7, 1.9}) expect_as_on_host(bytes, time_query(time));
  expect_as_on_host(bytes, range_query(0.4, 1.1));
  l4d_query coarse = time_query(0.7);
  coarse.point.levels = 2;
  expect_as_on_host(bytes, coarse);
  l4d_query base = all_query();
  base.point.detail = L4D_DETAIL_BASE_COLOR;
  expect_as_on_host(bytes, base);
}

}  // namespace l4d::test
