// SPDX-License-Identifier: Apache-2.0
// The calls of a decoder that do work, each with room for its results made before, so that what a
// fault test counts and fails is the library's alone.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"

namespace l4d::test {

enum class Call { kOpen, kSelect, kDecode, kSlice, kPacked, kSections, kCodebooks, kStreamDemand };
constexpr std::array<Call, 8> kCalls = {Call::kOpen,      Call::kSelect,      Call::kDecode,
                                        Call::kSlice,     Call::kPacked,      Call::kSections,
                                        Call::kCodebooks, Call::kStreamDemand};
const char* name_of(Call call);

class DecoderCalls {
 public:
  // What the results must be, and how large: from an undisturbed decoder.
  explicit DecoderCalls(const Bytes& file);

  // A decoder on which all calls but kOpen can be made.
  DecoderHandle opened(const l4d_reader& reader, uint32_t threads) const;
  l4d_status make(Call call, l4d_decoder* decoder, const l4d_reader& reader);
  // Whether the last call, which succeeded, gave what an undisturbed decoder gives.
  bool right(Call call) const;

  const Bytes& file() const { return file_; }

 private:
  struct Results {
    l4d_info info{};
    l4d_selection selection{};
    std::vector<float> position, log_scale, rotor, sh;  // decoded
    std::vector<float> splats, opacity;                 // sliced
    uint64_t visible = 0;
    std::vector<uint16_t> packed, index;
    uint64_t packed_count = 0;
    std::array<uint64_t, L4D_SECTION_COUNT> sections{};
    std::vector<float> codebook;
    l4d_stream_demand demand{};
  };

  const Bytes& file_;
  uint32_t num_layers_ = 0;
  Results want_, got_;
};

}  // namespace l4d::test
