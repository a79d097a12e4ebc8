// SPDX-License-Identifier: Apache-2.0
#include "tests/gpu/decode_packed_support.h"

#include <algorithm>
#include <memory>

#include "l4d/experimental/cuda_packed.h"
#include "tests/common/codec.h"

namespace l4d::test {
namespace {

// Sizes of the arrays that a request asks for.
struct PackedSizes {
  uint64_t capacity = 0, escape_capacity = 0;
  std::array<size_t, kNumPackedArrays> bytes{};

  PackedSizes(DecoderHandle& decoder, uint64_t n, const PackedRequest& request) {
    capacity = n + request.spare;
    escape_capacity = std::min(request.escape_capacity, capacity);
    uint64_t stages[L4D_COMPONENT_COUNT] = {};
    const l4d_info info = decoder.info();
    for (uint32_t l = 0; l < info.num_layers; ++l) {
      const l4d_layer_info layer = decoder.layer_info(l);
      for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
        stages[c] = std::max<uint64_t>(stages[c], layer.num_stages[c]);
      }
    }
    const auto set = [&](unsigned k, uint64_t size) {
      if ((request.arrays >> k & 1) != 0) bytes[k] = static_cast<size_t>(size);
    };
    set(kPackedPosition, 6 * capacity);
    for (const unsigned k : {kPackedMeanT, kPackedOpacity, kPackedScaleFactor}) {
      set(k, 2 * capacity);
    }
    set(kPackedWindow, 8 * capacity);
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      const uint64_t dim =
          c == L4D_COMPONENT_SH ? 3 * (info.sh_degree + 1) * (info.sh_degree + 1) : 4;
      set(kPackedDepth + 3 * c, capacity);
      set(kPackedIndex + 3 * c, 2 * capacity * stages[c]);
      set(kPackedEscape + 3 * c, 2 * escape_capacity * dim);
    }
  }
};

// Array k of buffers of the host's or the device's kind.
template <typename Buffers>
void set_array(unsigned k, void* at, Buffers* buffers) {
  uint16_t* const halves = static_cast<uint16_t*>(at);
  switch (k) {
    case kPackedPosition:
      buffers->position = halves;
      return;
    case kPackedMeanT:
      buffers->mean_t = halves;
      return;
    case kPackedOpacity:
      buffers->opacity = halves;
      return;
    case kPackedScaleFactor:
      buffers->scale_factor = halves;
      return;
    case kPackedWindow:
      buffers->window = static_cast<uint32_t*>(at);
      return;
    default:
      break;
  }
  auto& component = buffers->component[(k - kPackedDepth) / 3];
  switch ((k - kPackedDepth) % 3 + kPackedDepth) {
    case kPackedDepth:
      component.depth = static_cast<uint8_t*>(at);
      return;
    case kPackedIndex:
      component.index = halves;
      return;
    default:
      component.escape = halves;
      return;
  }
}

Verdict verdict_of(l4d_status status) { return verdict(status, l4d_last_error_message()); }

}  // namespace

PackedResult pack_on_host(DecoderHandle& decoder, const l4d_query& query,
                          const PackedRequest& request) {
  PackedResult result;
  const PackedSizes sizes(decoder, decoder.select(query).num_gaussians, request);
  l4d_packed_buffers buffers = L4D_INIT(l4d_packed_buffers);
  buffers.capacity = sizes.capacity;
  for (unsigned k = 0; k < kNumPackedArrays; ++k) {
    if ((request.arrays >> k & 1) == 0) continue;
    // An array of nothing is wanted, too.
    result.arrays[k].resize(std::max<size_t>(sizes.bytes[k], 1), PoisonedMemory::kPoison);
    set_array(k, result.arrays[k].data(), &buffers);
  }
  for (l4d_packed_component& c : buffers.component) c.escape_capacity = sizes.escape_capacity;
  const l4d_status status = l4d_decoder_decode_packed(decoder.get(), &query, &buffers);
  result.verdict = verdict_of(status);
  result.detail = l4d_last_error_message();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    result.num_escapes[c] = buffers.component[c].num_escapes;
  }
  return result;
}

PackedResult pack_on_device(DecoderHandle& decoder, DeviceDecoding& device, const l4d_query& query,
                            const PackedRequest& request) {
  PackedResult result;
  const auto failed = [&](l4d_status status) {
    result.detail = l4d_last_error_message();
    result.verdict = verdict(status, result.detail);
    return status != L4D_OK;
  };
  l4d_cuda_request prepared = L4D_INIT(l4d_cuda_request);
  prepared.forms = request.forms;
  if (failed(l4d_cuda_decoder_prepare(device.get(), &query, &prepared))) return result;
  const PackedSizes sizes(decoder, prepared.num_gaussians, request);
  l4d_cuda_packed_buffers buffers = L4D_INIT(l4d_cuda_packed_buffers);
  buffers.capacity = sizes.capacity;
  std::array<std::unique_ptr<PoisonedMemory>, kNumPackedArrays> memory;
  for (unsigned k = 0; k < kNumPackedArrays; ++k) {
    if ((request.arrays >> k & 1) == 0) continue;
    memory[k] = std::make_unique<PoisonedMemory>(std::max<size_t>(sizes.bytes[k], 1));
    set_array(k, memory[k]->data(), &buffers);
  }
  for (l4d_cuda_packed_component& c : buffers.component) {
    c.escape_capacity = sizes.escape_capacity;
  }
  const PoisonedMemory workspace(static_cast<size_t>(prepared.workspace_bytes));
  cudaStream_t stream = nullptr;
  cuda_check(cudaStreamCreate(&stream));
  if (!failed(l4d_cuda_decoder_decode_packed(device.get(), &buffers, workspace.data(),
                                             prepared.workspace_bytes, stream))) {
    failed(l4d_cuda_decoder_finish(device.get()));
    const Verdict of_decode = result.verdict;
    const std::string detail = result.detail;
    for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      EXPECT_FALSE(
          failed(l4d_cuda_decoder_get_num_escapes(device.get(), c, &result.num_escapes[c])));
    }
    result.verdict = of_decode;
    result.detail = detail;
  }
  cuda_check(cudaStreamSynchronize(stream));
  cuda_check(cudaStreamDestroy(stream));
  EXPECT_TRUE(workspace.is_intact_behind());
  for (unsigned k = 0; k < kNumPackedArrays; ++k) {
    if (memory[k] == nullptr) continue;
    EXPECT_TRUE(memory[k]->is_intact_behind()) << "array " << k;
    result.arrays[k].resize(memory[k]->bytes());
    cuda_check(cudaMemcpy(result.arrays[k].data(), memory[k]->data(), memory[k]->bytes(),
                          cudaMemcpyDeviceToHost));
  }
  return result;
}

PackedPair pack_on_both(const Bytes& file, const l4d_query& query, const PackedRequest& request) {
  PackedPair pair;
  const l4d_decoder_options options = decoder_options(L4D_BACKEND_REFERENCE, 1);
  DecoderHandle host(&options), of_device;
  try {
    host.open_memory(file.data(), file.size());
    pair.host = pack_on_host(host, query, request);
  } catch (const Error& e) {
    pair.host.verdict = verdict_of(e.status());
  }
  try {
    of_device.open_memory(file.data(), file.size());
    DeviceDecoding device(of_device);
    pair.device = pack_on_device(of_device, device, query, request);
  } catch (const Error& e) {
    pair.device.verdict = verdict_of(e.status());
  }
  return pair;
}

testing::AssertionResult same_packed(const PackedPair& pair) {
  if (!(pair.host.verdict == pair.device.verdict)) {
    return testing::AssertionFailure() << "host " << pair.host.verdict << ", device "
                                       << pair.device.verdict << ": " << pair.device.detail;
  }
  if (pair.host.verdict.status != L4D_OK) return testing::AssertionSuccess();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (pair.host.num_escapes[c] == pair.device.num_escapes[c]) continue;
    return testing::AssertionFailure() << "component " << c << " has " << pair.host.num_escapes[c]
                                       << " escapes, not " << pair.device.num_escapes[c];
  }
  for (unsigned k = 0; k < kNumPackedArrays; ++k) {
    const Bytes& host = pair.host.arrays[k];
    const Bytes& device = pair.device.arrays[k];
    if (host.size() != device.size()) return testing::AssertionFailure() << "size of array " << k;
    const auto differs = std::mismatch(host.begin(), host.end(), device.begin());
    if (differs.first == host.end()) continue;
    return testing::AssertionFailure()
           << "array " << k << " differs at byte " << differs.first - host.begin();
  }
  return testing::AssertionSuccess();
}

}  // namespace l4d::test
