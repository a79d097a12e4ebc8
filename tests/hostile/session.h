// SPDX-License-Identifier: Apache-2.0
// Everything a player does with a stream from a stranger, under tight limits, in arrays that are
// made once, so that a test sees which allocations are the library's.
#pragma once

#include <cstdint>
#include <vector>

#include "l4d/decode.h"
#include "libl4dcodec/base/bytes.h"

namespace l4d::test {

constexpr uint64_t kSessionMemory = uint64_t{16} << 20;
constexpr uint64_t kSessionGaussians = 4096;

l4d_decoder_options session_options();

class Session {
 public:
  Session();

  // Opens and decodes all. `digest` is of every decoded attribute, where the status is OK.
  l4d_status decode_all(const Bytes& file, uint64_t* digest);
  // Then slices, the packed form, sections, codebooks and a part of the time too. The status is
  // that of opening and decoding.
  l4d_status use(const Bytes& file);

  // The steps of use(), in any order, on an open decoder.
  enum class Step {
    kSelect,
    kDecode,
    kPacked,
    kSlice,
    kSections,
    kCodebook,
    kInfo,
    kBuckets,
    kCount
  };
  l4d_status step(l4d_decoder* decoder, Step step, uint32_t choice);

 private:
  l4d_status decode(l4d_decoder* decoder, const l4d_query& query, bool some_arrays,
                    uint64_t* digest);
  l4d_status decode_buckets(l4d_decoder* decoder, l4d_query query, uint32_t choice);

  std::vector<float> floats_;
  std::vector<uint16_t> halves_;
  std::vector<uint8_t> bytes_;
  std::vector<l4d_bucket_span> ranges_;
};

}  // namespace l4d::test
