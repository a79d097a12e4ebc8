// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/entropy/rans_encoder.h"

#include <hwy/base.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

namespace l4d {
namespace {

// What one more slot for a token with this many slots saves, in bits.
double saving(uint64_t count, uint32_t frequency) {
  return static_cast<double>(count) * std::log2(1.0 + 1.0 / frequency);
}

// Frequencies of the fewest total bits. The total is a sum of convex functions, one per token, so
// that an assignment which no exchange of one slot improves is the best of all.
std::vector<uint32_t> best_frequencies(Span<const uint64_t> counts) {
  const size_t n = counts.size();
  double total = 0;
  for (const uint64_t count : counts) total += static_cast<double>(count);
  std::vector<uint32_t> frequencies(n, 0);
  uint32_t sum = 0;
  for (size_t i = 0; i < n; ++i) {
    if (counts[i] == 0) continue;
    const double share = static_cast<double>(counts[i]) / total * kRansSlots;
    frequencies[i] = std::max(1u, static_cast<uint32_t>(share));
    sum += frequencies[i];
  }
  std::vector<double> gain(n, 0), loss(n, std::numeric_limits<double>::infinity());
  const auto change = [&](size_t i, uint32_t frequency) {
    frequencies[i] = frequency;
    gain[i] = saving(counts[i], frequency);
    loss[i] =
        frequency > 1 ? saving(counts[i], frequency - 1) : std::numeric_limits<double>::infinity();
  };
  for (size_t i = 0; i < n; ++i) {
    if (counts[i] != 0) change(i, frequencies[i]);
  }
  for (;;) {
    const size_t up =
        static_cast<size_t>(std::max_element(gain.begin(), gain.end()) - gain.begin());
    const size_t down =
        static_cast<size_t>(std::min_element(loss.begin(), loss.end()) - loss.begin());
    if (sum < kRansSlots) {
      change(up, frequencies[up] + 1);
      ++sum;
    } else if (sum > kRansSlots) {
      change(down, frequencies[down] - 1);
      --sum;
    } else if (gain[up] > loss[down]) {
      change(up, frequencies[up] + 1);
      change(down, frequencies[down] - 1);
    } else {
      return frequencies;
    }
  }
}

unsigned floor_log2(uint64_t value) {
  return 63 - static_cast<unsigned>(hwy::Num0BitsAboveMS1Bit_Nonzero64(value));
}

// Both without a branch on the value: the leading bits that remain beside the raw ones are 8..15
// from the value 8 on, and 2 or 3 from the value 2 on, so that a token of its own begins with each
// length.
RansToken token_of(uint16_t value) {
  const unsigned bits = floor_log2(value | 8u) - 3;
  return {(bits << 3) + (uint32_t{value} >> bits), bits, value & ((uint32_t{1} << bits) - 1)};
}

RansToken token_of(uint64_t value) {
  const unsigned bits = floor_log2(value | 2) - 1;
  return {(bits << 1) + static_cast<uint32_t>(value >> bits), bits,
          value & ((uint64_t{1} << bits) - 1)};
}

// Most words that a symbol takes: one for its token and one for each 16 raw bits.
constexpr size_t most_words(uint16_t) { return 2; }
constexpr size_t most_words(uint64_t) { return 5; }

// Moves the low half of the state to the words if `full`. Without a branch, as no predictor would
// know its way.
inline unsigned char* emit(bool full, uint32_t& x, unsigned char* at) {
  store_le(static_cast<uint16_t>(x), at - 2);
  const unsigned words = full ? 1 : 0;
  x >>= 16 * words;
  return at - 2 * words;
}

}  // namespace

RansToken hybrid_token(uint16_t value) { return token_of(value); }
RansToken wide_token(uint64_t value) { return token_of(value); }

RansTable::RansTable(Span<const uint64_t> counts) {
  assert(counts.size() <= kRansMaxTokens);
  size_t tokens = counts.size();
  while (tokens > 0 && counts[tokens - 1] == 0) --tokens;
  // A table of nothing still has to be one.
  const std::vector<uint32_t> frequencies =
      tokens == 0 ? std::vector<uint32_t>{kRansSlots} : best_frequencies(counts.subspan(0, tokens));
  uint32_t start = 0;
  for (const uint32_t frequency : frequencies) {
    const uint64_t reciprocal =
        frequency == 0 ? 0 : ((uint64_t{1} << (32 + kRansScaleBits)) + frequency - 1) / frequency;
    codes_.push_back({reciprocal, frequency, start});
    start += frequency;
  }
}

void RansTable::append_to(Bytes& out) const {
  append_vlq(codes_.size(), out);
  for (size_t i = 0; i < codes_.size(); ++i) {
    append_vlq(codes_[i].frequency, out);
    if (codes_[i].frequency != 0) continue;
    const size_t first = i;
    while (codes_[i + 1].frequency == 0) ++i;  // the last one is not 0
    append_vlq(i - first, out);
  }
}

void RansTable::expand(uint32_t* entries) const {
  uint32_t frequencies[kRansMaxTokens];
  for (size_t i = 0; i < codes_.size(); ++i) frequencies[i] = codes_[i].frequency;
  expand_rans_table(frequencies, codes_.size(), entries);
}

void RansBlockWriter::add_hybrid(const RansTable* tables, const uint8_t* contexts,
                                 Span<const uint16_t> values) {
  channels_.push_back({tables, contexts, values.data(), nullptr, values.size()});
}

void RansBlockWriter::add_wide(const RansTable* tables, const uint8_t* contexts,
                               Span<const uint64_t> values) {
  channels_.push_back({tables, contexts, nullptr, values.data(), values.size()});
}

// The steps of the decoder, each undone, from the last to the first. Words are written downwards
// from `at`; the result is where they begin.
template <typename T>
unsigned char* RansBlockWriter::encode(const Channel& channel, const T* values, uint32_t* x,
                                       unsigned char* at) const {
  RansToken tokens[kRansLanes];
  const RansTable::Code* codes[kRansLanes];
  for (size_t groups = (channel.n + kRansLanes - 1) / kRansLanes; groups-- > 0;) {
    const size_t begin = groups * kRansLanes;
    const size_t count = std::min(kRansLanes, channel.n - begin);
    uint32_t most_bits = 0;
    for (size_t lane = 0; lane < count; ++lane) {
      const size_t context = channel.contexts != nullptr ? channel.contexts[begin + lane] : 0;
      tokens[lane] = token_of(values[begin + lane]);
      most_bits = std::max(most_bits, tokens[lane].bits);
      assert(channel.tables[context].frequency(tokens[lane].token) > 0);
      codes[lane] = &channel.tables[context].codes_[tokens[lane].token];
    }
    for (uint32_t step = (most_bits + 15) / 16; step-- > 0;) {
      const uint32_t done = step * 16;
      for (size_t lane = count; lane-- > 0;) {
        const RansToken& token = tokens[lane];
        const uint32_t bits = token.bits <= done ? 0 : std::min(16u, token.bits - done);
        const uint32_t piece =
            static_cast<uint32_t>(token.raw >> done) & ((uint32_t{1} << bits) - 1);
        uint32_t state = x[lane];
        at = emit((uint64_t{state} >> (32 - bits)) != 0, state, at);
        x[lane] = state << bits | piece;
      }
    }
    for (size_t lane = count; lane-- > 0;) {
      const RansTable::Code& code = *codes[lane];
      uint32_t state = x[lane];
      at = emit((state >> (32 - kRansScaleBits)) >= code.frequency, state, at);
      // Exact, as state < frequency * 2^(32 - kRansScaleBits) here.
      const uint32_t quotient =
          static_cast<uint32_t>(state * code.reciprocal >> (32 + kRansScaleBits));
      x[lane] = state + quotient * (kRansSlots - code.frequency) + code.start;
    }
  }
  return at;
}

void RansBlockWriter::finish(Bytes& out) {
  size_t most = 0;
  for (const Channel& channel : channels_) {
    most += channel.n * (channel.wide != nullptr ? most_words(uint64_t{}) : most_words(uint16_t{}));
  }
  // emit() stores a word below the last one even where it is not kept.
  if (words_.size() < 2 * most + 2) words_.resize(2 * most + 2);
  uint32_t x[kRansLanes];
  std::fill(x, x + kRansLanes, kRansLow);
  unsigned char* const end = words_.data() + words_.size();
  unsigned char* at = end;
  for (size_t i = channels_.size(); i-- > 0;) {
    const Channel& channel = channels_[i];
    at = channel.wide != nullptr ? encode(channel, channel.wide, x, at)
                                 : encode(channel, channel.hybrid, x, at);
  }
  for (const uint32_t state : x) append_le(state, out);
  out.insert(out.end(), at, end);
  channels_.clear();
}

}  // namespace l4d
