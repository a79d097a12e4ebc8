// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/entropy/rans.h"

#include <algorithm>

namespace l4d {

void expand_rans_table(const uint32_t* frequencies, size_t tokens, uint32_t* entries) {
  for (size_t token = 0; token < tokens; ++token) {
    for (uint32_t bias = 0; bias < frequencies[token]; ++bias) {
      *entries++ = pack_rans_entry(frequencies[token], bias, static_cast<uint32_t>(token));
    }
  }
}

Status read_rans_table(ByteReader& in, uint64_t base, size_t max_tokens, uint32_t* entries) {
  const uint64_t at = base + in.position();
  const auto ended = [&] { return corrupt("RANS-1", at, "rANS table past the end of its chunk"); };
  const uint64_t tokens = in.vlq();
  if (in.failed()) return ended();
  if (tokens == 0 || tokens > std::min(max_tokens, kRansMaxTokens)) {
    return corrupt("RANS-2", at, "rANS table of " + std::to_string(tokens) + " tokens");
  }
  uint32_t frequencies[kRansMaxTokens] = {};
  uint64_t sum = 0;
  for (uint64_t token = 0; token < tokens; ++token) {
    const uint64_t frequency = in.vlq();
    const uint64_t more = frequency == 0 ? in.vlq() : 0;
    if (in.failed()) return ended();
    if (frequency == 0) {
      // The last token has a frequency, so that no run of zeros reaches it.
      if (more >= tokens - token - 1) {
        return corrupt("RANS-2", at, "zeros up to the end of a rANS table");
      }
      token += more;
      continue;
    }
    if (frequency > kRansSlots - sum) {
      return corrupt("RANS-2", at, "frequencies of a rANS table exceed their sum");
    }
    frequencies[token] = static_cast<uint32_t>(frequency);
    sum += frequency;
  }
  if (sum != kRansSlots) {
    return corrupt("RANS-2", at, "frequencies of a rANS table sum to " + std::to_string(sum));
  }
  expand_rans_table(frequencies, static_cast<size_t>(tokens), entries);
  return {};
}

Status open_rans_block(ByteSpan block, uint64_t base, RansLanes* lanes) {
  if (block.size() < kRansStateBytes) {
    return corrupt("RANS-1", base, "rANS block shorter than its states");
  }
  for (size_t lane = 0; lane < kRansLanes; ++lane) {
    lanes->x[lane] = load_le<uint32_t>(block.data() + lane * sizeof(uint32_t));
    if (lanes->x[lane] < kRansLow) {
      return corrupt("RANS-3", base + lane * sizeof(uint32_t), "rANS state out of range");
    }
  }
  lanes->next = block.data() + kRansStateBytes;
  lanes->end = block.data() + block.size();
  lanes->failed = false;
  return {};
}

bool rans_block_finished(const RansLanes& lanes) {
  return !lanes.failed && lanes.next == lanes.end &&
         std::all_of(lanes.x, lanes.x + kRansLanes, [](uint32_t x) { return x == kRansLow; });
}

}  // namespace l4d
