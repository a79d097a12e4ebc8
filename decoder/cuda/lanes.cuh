// SPDX-License-Identifier: Apache-2.0
// The lanes of a rANS block on a warp (spec: "rANS blocks"): lane i of the stream is lane i of the
// warp, and all of them move together.
#pragma once

#include "decoder/cuda/device_types.h"
#include "decoder/cuda/memory.cuh"

namespace l4d::cuda {

constexpr uint32_t kAllLanes = 0xffffffffu;

// Symbols of a lane between two looks at whether words are there: what they take is within a chunk.
constexpr uint32_t kBatchGroups = 4;

// Words of a block on their way through shared memory: a ring of four chunks, of which the last one
// may be under way while others are read. The first chunk stands behind the last one once more, so
// that what a batch takes never wraps.
constexpr uint32_t kChunkWords = 256;
constexpr uint32_t kRingWords = 4 * kChunkWords;
constexpr uint32_t kRingBytes = (kRingWords + kChunkWords + 32) * 2;
static_assert(kBatchGroups * 2 * kRansLanes <= kChunkWords, "two words a lane and group");

// Tables of a layer in shared memory, and behind the last one a table that leaves a state as it is:
// what lanes without a symbol take.
struct SharedTables {
  const unsigned char* records;
  const uint8_t* tokens;
  uint32_t idle;
};

class Lanes {
 public:
  __device__ Lanes(const SharedTables& tables, unsigned char* ring)
      : tables_(tables), ring_(ring), lane_(threadIdx.x % 32), below_((1u << lane_) - 1) {}

  // block: at a multiple of 16 bytes. Its states were looked at when it was read.
  __device__ void open(const unsigned char* block, uint32_t bytes) {
    x_ = reinterpret_cast<const uint32_t*>(block)[lane_];
    words_ = block + kRansStateBytes;
    bytes_ = bytes - static_cast<uint32_t>(kRansStateBytes);
    position_ = 0;
    filled_ = 0;
    begin_ = next_ = ring_;
    wait_for_copies<0>();
    __syncwarp();
    for (int i = 0; i < 3; ++i) fetch();
    wait_for_copies<1>();
    __syncwarp();
  }

  // True if all words are used up and every lane is back where the encoder began.
  __device__ bool finished() const {
    const uint32_t taken = 2 * position_ + static_cast<uint32_t>(next_ - begin_);
    return __all_sync(kAllLanes, x_ == kRansLow) && taken == bytes_;
  }

  // Makes sure that a chunk of words is there: enough for a batch of hybrid integers, or for a
  // group of wide ones, which take five words a lane at most.
  __device__ void begin_batch() {
    position_ += static_cast<uint32_t>(next_ - begin_) / 2;
    if (filled_ - position_ <= 2 * kChunkWords) {
      __syncwarp();
      fetch();
      wait_for_copies<1>();
      __syncwarp();
    }
    begin_ = next_ = ring_ + 2 * (position_ % kRingWords);
  }

  // The next token of each lane, with its table; 0 with the idle one.
  __device__ uint32_t take_token(uint32_t table) {
    const uint2 record = *reinterpret_cast<const uint2*>(
        tables_.records + (table * kTableRecords * 8 | (x_ >> 2 & (kTableRecords - 1) * 8)));
    const uint32_t slot = x_ % kRecordSlots;
    const uint32_t high = x_ >> kRansScaleBits;
    // First slots of tokens up to this one, at the top, and behind this one, at the bottom.
    const uint32_t until = record.x << (31 - slot);
    const uint32_t behind = record.x >> slot >> 1;
    // How far the token of this slot reaches before it and from it on.
    const uint32_t before = until != 0 ? static_cast<uint32_t>(__clz(static_cast<int>(until)))
                                       : slot + (record.y & 0xfff);
    const uint32_t ahead = behind != 0 ? static_cast<uint32_t>(__ffs(static_cast<int>(behind)))
                                       : (record.y >> 12 & 0x1fff) - slot;
    const uint32_t rank = (record.y >> 25) + static_cast<uint32_t>(__popc(until));
    const uint32_t token = tables_.tokens[table * kTableRanks + rank];
    // (before + ahead) * high + before.
    x_ = ahead * high + before * (high + 1);
    renormalise();
    return token;
  }

  // The integer below 2^16 that a token begins.
  __device__ uint32_t finish_hybrid(uint32_t token) {
    // Most integers are small.
    if (__builtin_expect(__any_sync(kAllLanes, token >= 16) == 0, 1)) return token;
    const uint32_t bits = token < 16 ? 0 : token / 8 - 1;
    const uint32_t top = token < 16 ? token : 8 + token % 8;
    return top << bits | take_bits(bits);
  }

  // The next integer below 2^63.
  __device__ uint64_t wide(uint32_t table) {
    begin_batch();
    const uint32_t token = take_token(table);
    const uint32_t bits = token < 2 ? 0 : token / 2 - 1;
    uint64_t value = token < 2 ? token : static_cast<uint64_t>(2 + token % 2) << bits;
    for (uint32_t done = 0; __any_sync(kAllLanes, bits > done); done += 16) {
      const uint32_t rest = bits > done ? bits - done : 0;
      value |= static_cast<uint64_t>(take_bits(rest < 16 ? rest : 16)) << done;
    }
    return value;
  }

 private:
  // Starts the copy of the next chunk; words past the end of the block are zeros.
  __device__ void fetch() {
    const uint32_t at = 2 * filled_ + 16 * lane_;
    const uint32_t even = bytes_ & ~1u;
    const uint32_t left = at < even ? min(even - at, 16u) : 0;
    // A copy of zeros alone still names an address, which then is one inside.
    const unsigned char* from = words_ + (left != 0 ? at : 0);
    unsigned char* to = ring_ + (2 * filled_) % (2 * kRingWords) + 16 * lane_;
    start_copy(to, from, left);
    if (filled_ % kRingWords == 0) start_copy(to + 2 * kRingWords, from, left);
    end_copies();
    filled_ += kChunkWords;
  }

  __device__ void renormalise() {
    const bool low = x_ < kRansLow;
    const uint32_t lanes = __ballot_sync(kAllLanes, low);
    const uint32_t word = reinterpret_cast<const uint16_t*>(next_)[__popc(lanes & below_)];
    if (low) x_ = x_ << 16 | word;
    next_ += 2 * __popc(lanes);
  }

  // count: 0..16.
  __device__ uint32_t take_bits(uint32_t count) {
    const uint32_t bits = x_ & ((1u << count) - 1);
    x_ >>= count;
    renormalise();
    return bits;
  }

  const SharedTables tables_;
  unsigned char* const ring_;
  const uint32_t lane_;
  const uint32_t below_;  // mask of the lanes before this one
  uint32_t x_ = 0;
  const unsigned char* words_ = nullptr;
  uint32_t bytes_ = 0;
  uint32_t position_ = 0;                 // words taken before this batch
  uint32_t filled_ = 0;                   // words under way or there
  const unsigned char* begin_ = nullptr;  // of the batch in the ring
  const unsigned char* next_ = nullptr;   // word
};

}  // namespace l4d::cuda
