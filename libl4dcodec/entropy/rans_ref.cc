// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "libl4dcodec/base/bytes.h"
#include "libl4dcodec/entropy/rans_kernels.h"

namespace l4d {
namespace {

// The words not yet taken: a copy of what RansLanes says, which a compiler can keep in registers.
struct Words {
  const unsigned char* next;
  const unsigned char* end;
  bool failed;
};

// Whether a state needs a word cannot be predicted, so that the word is read in any case and no
// branch depends on it.
uint32_t renormalise(uint32_t x, Words& words) {
  if (words.end - words.next < 2) {
    if (x >= kRansLow) return x;
    words.failed = true;
    return x << 16;
  }
  const uint32_t need = x < kRansLow ? 1 : 0;
  const uint32_t word = load_le<uint16_t>(words.next) & (0 - need);
  words.next += 2 * need;
  return x << (16 * need) | word;
}

uint32_t take_token(uint32_t& x, Words& words, const uint32_t* table) {
  const uint32_t entry = table[x & (kRansSlots - 1)];
  const uint32_t frequency = (entry >> 20) + 1;
  const uint32_t bias = (entry >> 8) & (kRansSlots - 1);
  x = renormalise(frequency * (x >> kRansScaleBits) + bias, words);
  return entry & 0xff;
}

// count: 0..16. With 0 the state stays, as it is not below kRansLow.
uint32_t take_bits(uint32_t& x, Words& words, unsigned count) {
  const uint32_t bits = x & ((uint32_t{1} << count) - 1);
  x = renormalise(x >> count, words);
  return bits;
}

// The tokens of one group: up to a symbol for each lane.
void take_tokens(uint32_t* x, Words& words, const uint32_t* tables, const uint8_t* contexts,
                 size_t count, uint32_t* tokens) {
  for (size_t lane = 0; lane < count; ++lane) {
    const size_t context = contexts != nullptr ? contexts[lane] : 0;
    tokens[lane] = take_token(x[lane], words, tables + context * kRansSlots);
  }
}

void hybrid(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts, size_t n,
            uint16_t* dst) {
  Words words{lanes.next, lanes.end, lanes.failed};
  uint32_t tokens[kRansLanes];
  for (size_t begin = 0; begin < n; begin += kRansLanes) {
    const size_t count = std::min(kRansLanes, n - begin);
    take_tokens(lanes.x, words, tables, contexts != nullptr ? contexts + begin : nullptr, count,
                tokens);
    for (size_t lane = 0; lane < count; ++lane) {
      const uint32_t token = tokens[lane];
      const unsigned bits = token < 16 ? 0 : token / 8 - 1;
      const uint32_t top = token < 16 ? token : 8 + token % 8;
      const uint32_t raw = take_bits(lanes.x[lane], words, bits);
      dst[begin + lane] = static_cast<uint16_t>(top << bits | raw);
    }
  }
  lanes.next = words.next;
  lanes.failed = words.failed;
}

void wide(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts, size_t n,
          uint64_t* dst) {
  Words words{lanes.next, lanes.end, lanes.failed};
  uint32_t tokens[kRansLanes];
  for (size_t begin = 0; begin < n; begin += kRansLanes) {
    const size_t count = std::min(kRansLanes, n - begin);
    take_tokens(lanes.x, words, tables, contexts != nullptr ? contexts + begin : nullptr, count,
                tokens);
    unsigned most_bits = 0;
    for (size_t lane = 0; lane < count; ++lane) {
      const uint32_t token = tokens[lane];
      const unsigned bits = token < 2 ? 0 : token / 2 - 1;
      dst[begin + lane] = token < 2 ? token : uint64_t{2 + token % 2} << bits;
      most_bits = std::max(most_bits, bits);
    }
    for (unsigned done = 0; done < most_bits; done += 16) {
      for (size_t lane = 0; lane < count; ++lane) {
        const unsigned bits = tokens[lane] < 2 ? 0 : tokens[lane] / 2 - 1;
        if (bits <= done) continue;
        const uint64_t piece = take_bits(lanes.x[lane], words, std::min(16u, bits - done));
        dst[begin + lane] |= piece << done;
      }
    }
  }
  lanes.next = words.next;
  lanes.failed = words.failed;
}

}  // namespace

const RansKernels& rans_kernels_reference() {
  static constexpr RansKernels kKernels = {hybrid, wide, nullptr};
  return kKernels;
}

}  // namespace l4d
