// SPDX-License-Identifier: Apache-2.0
// The writing side of the rANS coder (spec: "rANS blocks").
#pragma once

#include <cstdint>
#include <vector>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/base/span.h"
#include "libl4dcodec/entropy/rans.h"

namespace l4d {

// An integer as a token, whose probability a table has, and raw bits.
struct RansToken {
  uint32_t token = 0;
  uint32_t bits = 0;  // number of raw bits
  uint64_t raw = 0;
};
RansToken hybrid_token(uint16_t value);
RansToken wide_token(uint64_t value);  // value < 2^63

// The frequencies of one context.
class RansTable {
 public:
  // From how often each token occurs; at most kRansMaxTokens. Of all tables in which each token
  // that occurs has a frequency, this one codes the counted tokens in the fewest bits.
  explicit RansTable(Span<const uint64_t> counts);

  size_t tokens() const { return codes_.size(); }  // after the last one with a frequency: none
  uint32_t frequency(size_t token) const {
    return token < codes_.size() ? codes_[token].frequency : 0;
  }
  // Appends the form that read_rans_table reads.
  void append_to(Bytes& out) const;
  // The table as kernels take it, entries [kRansSlots].
  void expand(uint32_t* entries) const;

 private:
  friend class RansBlockWriter;
  struct Code {
    uint64_t reciprocal;  // ceil(2^(32 + kRansScaleBits) / frequency)
    uint32_t frequency;
    uint32_t start;  // sum of the frequencies before
  };
  std::vector<Code> codes_;
};

// Collects the channels of a block in the order of decoding. rANS codes backwards, so that all work
// is done at the end: tables, contexts and values must live until then.
class RansBlockWriter {
 public:
  // Symbol i is coded by tables[contexts[i]], or by tables[0] where contexts is null. Every token
  // that occurs has a frequency there.
  void add_hybrid(const RansTable* tables, const uint8_t* contexts, Span<const uint16_t> values);
  void add_wide(const RansTable* tables, const uint8_t* contexts, Span<const uint64_t> values);
  // Appends the block and forgets the channels.
  void finish(Bytes& out);

 private:
  struct Channel {
    const RansTable* tables;
    const uint8_t* contexts;
    const uint16_t* hybrid;  // this or wide
    const uint64_t* wide;
    size_t n;
  };
  template <typename T>
  unsigned char* encode(const Channel& channel, const T* values, uint32_t* x,
                        unsigned char* at) const;

  std::vector<Channel> channels_;
  Bytes words_;  // scratch
};

}  // namespace l4d
