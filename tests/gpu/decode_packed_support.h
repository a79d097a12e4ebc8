// SPDX-License-Identifier: Apache-2.0
// The packed form of a query from the host and from the device, in arrays that were poisoned alike.
#pragma once

#include <array>
#include <string>

#include "tests/gpu/decode_support.h"

namespace l4d::test {

// Arrays of the packed form; those of component c are kPackedDepth + 3 c and the two behind it.
enum PackedArray : unsigned {
  kPackedPosition,
  kPackedMeanT,
  kPackedOpacity,
  kPackedScaleFactor,
  kPackedWindow,
  kPackedDepth,
  kPackedIndex,
  kPackedEscape,
  kNumPackedArrays = kPackedDepth + 3 * L4D_COMPONENT_COUNT
};
constexpr uint32_t kAllPackedArrays = (1u << kNumPackedArrays) - 1;

struct PackedRequest {
  uint32_t arrays = kAllPackedArrays;     // bit k: array k is wanted
  uint64_t spare = 3;                     // capacity beyond the Gaussians
  uint64_t escape_capacity = UINT64_MAX;  // if less than there may be
  uint32_t forms = L4D_CUDA_FORM_PACKED;
};

struct PackedResult {
  Verdict verdict;
  std::string detail;
  std::array<Bytes, kNumPackedArrays> arrays;  // empty where not wanted
  std::array<uint64_t, L4D_COMPONENT_COUNT> num_escapes{};
};

PackedResult pack_on_host(DecoderHandle& decoder, const l4d_query& query,
                          const PackedRequest& request);
// device: of the same decoder.
PackedResult pack_on_device(DecoderHandle& decoder, DeviceDecoding& device, const l4d_query& query,
                            const PackedRequest& request);

// Both of fresh decoders of a file.
struct PackedPair {
  PackedResult host, device;
};
PackedPair pack_on_both(const Bytes& file, const l4d_query& query,
                        const PackedRequest& request = {});
// Equal verdicts, and equal bytes where there are any.
testing::AssertionResult same_packed(const PackedPair& pair);

}  // namespace l4d::test
