// SPDX-License-Identifier: Apache-2.0
// Channels of random integers, coded and decoded.
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "libl4dcodec/entropy/rans_encoder.h"
#include "tests/common/random.h"

namespace l4d::test {

enum class Shape { kConstant, kSmall, kUniform, kGeometric, kEnds };
constexpr Shape kShapes[] = {Shape::kConstant, Shape::kSmall, Shape::kUniform, Shape::kGeometric,
                             Shape::kEnds};

// T: uint16_t for a hybrid channel, uint64_t for a wide one.
template <typename T>
struct RansChannel {
  std::vector<T> values;
  std::vector<uint8_t> contexts;  // empty = none
  std::vector<RansTable> tables;
  std::vector<uint32_t> entries;  // the tables as kernels take them

  const uint8_t* context_pointer() const { return contexts.empty() ? nullptr : contexts.data(); }
};

inline RansToken token_of(uint16_t value) { return hybrid_token(value); }
inline RansToken token_of(uint64_t value) { return wide_token(value); }

template <typename T>
T random_value(Shape shape, Random& random) {
  constexpr T kLargest = sizeof(T) == 2 ? static_cast<T>(~T{0}) : static_cast<T>(~T{0} >> 1);
  switch (shape) {
    case Shape::kConstant:
      return static_cast<T>(kLargest / 3);
    case Shape::kSmall:
      return static_cast<T>(random.below(2) + random.below(sizeof(T) == 2 ? 15 : 1));
    case Shape::kUniform:  // in the exponent, so that all tokens occur
      return static_cast<T>((random.bits() & kLargest) >> random.below(8 * sizeof(T)));
    case Shape::kGeometric:
      return static_cast<T>(std::fmin(-700 * std::log(1 - random.uniform()), 4095));
    case Shape::kEnds:
      break;
  }
  return random.below(2) == 0 ? T{0} : kLargest;
}

template <typename T>
RansChannel<T> channel_of(std::vector<T> values, std::vector<uint8_t> contexts = {}) {
  RansChannel<T> channel;
  size_t tables = 1;
  for (const uint8_t c : contexts) tables = std::max<size_t>(tables, size_t{c} + 1);
  std::vector<std::vector<uint64_t>> counts(tables, std::vector<uint64_t>(kRansMaxTokens, 0));
  for (size_t i = 0; i < values.size(); ++i) {
    ++counts[contexts.empty() ? 0 : contexts[i]][token_of(values[i]).token];
  }
  channel.entries.resize(tables * kRansSlots);
  for (size_t t = 0; t < tables; ++t) {
    channel.tables.emplace_back(counts[t]);
    channel.tables[t].expand(channel.entries.data() + t * kRansSlots);
  }
  channel.values = std::move(values);
  channel.contexts = std::move(contexts);
  return channel;
}

// contexts: 0 = no array of contexts.
template <typename T>
RansChannel<T> random_channel(size_t n, Shape shape, size_t contexts, uint64_t seed) {
  Random random(seed);
  std::vector<T> values(n);
  std::vector<uint8_t> chosen(contexts == 0 ? 0 : n);
  for (uint8_t& c : chosen) c = static_cast<uint8_t>(random.below(static_cast<uint32_t>(contexts)));
  for (size_t i = 0; i < n; ++i) {
    // Contexts differ in their distribution.
    const size_t c = contexts == 0 ? 0 : chosen[i];
    values[i] = random_value<T>(kShapes[(static_cast<size_t>(shape) + c) % 5], random);
  }
  return channel_of(std::move(values), std::move(chosen));
}

// A block of some channels of both kinds, in this order: hybrid, wide, hybrid, wide, ...
struct RansCase {
  std::vector<RansChannel<uint16_t>> hybrid;
  std::vector<RansChannel<uint64_t>> wide;

  Bytes block() const {
    RansBlockWriter writer;
    for (size_t i = 0; i < std::max(hybrid.size(), wide.size()); ++i) {
      if (i < hybrid.size()) {
        const auto& p = hybrid[i];
        writer.add_hybrid(p.tables.data(), p.context_pointer(), p.values);
      }
      if (i < wide.size()) {
        const auto& p = wide[i];
        writer.add_wide(p.tables.data(), p.context_pointer(), p.values);
      }
    }
    Bytes out;
    writer.finish(out);
    return out;
  }
};

// All that a decoder leaves behind. What was not written keeps its canary.
struct RansResult {
  std::vector<std::vector<uint16_t>> hybrid;
  std::vector<std::vector<uint64_t>> wide;
  std::vector<uint32_t> states;
  size_t position = 0;
  bool failed = false;
  bool finished = false;

  bool operator==(const RansResult& o) const {
    return hybrid == o.hybrid && wide == o.wide && states == o.states && position == o.position &&
           failed == o.failed && finished == o.finished;
  }
};

inline RansResult decode(const RansKernels& kernels, const RansCase& c, ByteSpan block) {
  RansResult result;
  RansLanes lanes;
  if (!open_rans_block(block, 0, &lanes).ok()) return result;
  for (size_t i = 0; i < std::max(c.hybrid.size(), c.wide.size()); ++i) {
    if (i < c.hybrid.size()) {
      const auto& p = c.hybrid[i];
      std::vector<uint16_t> dst(p.values.size() + 40, 0xa5a5);
      kernels.hybrid(lanes, p.entries.data(), p.context_pointer(), p.values.size(), dst.data());
      result.hybrid.push_back(std::move(dst));
    }
    if (i < c.wide.size()) {
      const auto& p = c.wide[i];
      std::vector<uint64_t> dst(p.values.size() + 40, 0xa5a5a5a5a5a5a5a5u);
      kernels.wide(lanes, p.entries.data(), p.context_pointer(), p.values.size(), dst.data());
      result.wide.push_back(std::move(dst));
    }
  }
  result.states.assign(lanes.x, lanes.x + kRansLanes);
  result.position = static_cast<size_t>(lanes.next - block.data());
  result.failed = lanes.failed;
  result.finished = rans_block_finished(lanes);
  return result;
}

// What decoding must leave behind.
inline RansResult expected(const RansCase& c, size_t block_bytes) {
  RansResult result;
  for (const auto& p : c.hybrid) {
    result.hybrid.push_back(p.values);
    result.hybrid.back().resize(p.values.size() + 40, 0xa5a5);
  }
  for (const auto& p : c.wide) {
    result.wide.push_back(p.values);
    result.wide.back().resize(p.values.size() + 40, 0xa5a5a5a5a5a5a5a5u);
  }
  result.states.assign(kRansLanes, kRansLow);
  result.position = block_bytes;
  result.finished = true;
  return result;
}

}  // namespace l4d::test
