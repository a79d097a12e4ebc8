// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>

#include "libl4dcodec/math/hd.h"

// Random numbers that depend on (seed, step, id, use) alone: not on the order of calls, the number
// of threads or what was drawn before. A run that resumes needs no state of a generator.
namespace l4d::train {

// What numbers are for. Each use has numbers of its own.
enum class Use : uint32_t {
  kNoise = 1,
  kTarget = 2,
  kChild = 3,
  kInstants = 4,
  kCameras = 5,
  kBackground = 6,
  kStart = 7,
  kWindows = 8,
  kSplit = 9,
  kPoints = 10
};

struct Random4 {
  uint32_t v[4];
};

// Philox 4x32 with 10 rounds (Salmon et al. 2011).
L4D_HOST_DEVICE inline Random4 philox(uint64_t seed, uint64_t step, uint64_t id, Use use) {
  const auto low = [](uint64_t x) { return static_cast<uint32_t>(x); };
  const auto high = [](uint64_t x) { return static_cast<uint32_t>(x >> 32); };
  // 36 bits of the step, 52 bits of the id and 8 bits of the use fill the counter but for 32 bits.
  uint32_t c[4] = {low(step), low(id), high(id), static_cast<uint32_t>(use) << 24 ^ high(step)};
  uint32_t k[2] = {low(seed), high(seed)};
  for (int round = 0; round < 10; ++round) {
    const uint64_t p = uint64_t{0xD2511F53u} * c[0];
    const uint64_t q = uint64_t{0xCD9E8D57u} * c[2];
    const uint32_t next[4] = {high(q) ^ c[1] ^ k[0], low(q), high(p) ^ c[3] ^ k[1], low(p)};
    for (int i = 0; i < 4; ++i) c[i] = next[i];
    k[0] += 0x9E3779B9u;
    k[1] += 0xBB67AE85u;
  }
  return {{c[0], c[1], c[2], c[3]}};
}

// In (0, 1), 24 bits.
L4D_HOST_DEVICE inline float uniform(uint32_t bits) {
  return (static_cast<float>(bits >> 8) + 0.5f) * 0x1p-24f;
}

// Four independent standard normal numbers (Box and Muller).
L4D_HOST_DEVICE inline void normal4(const Random4& r, float* out /* [4] */) {
  for (int i = 0; i < 4; i += 2) {
    const float radius = std::sqrt(-2.0f * std::log(uniform(r.v[i])));
    const float angle = 6.28318531f * uniform(r.v[i + 1]);
    out[i] = radius * std::cos(angle);
    out[i + 1] = radius * std::sin(angle);
  }
}

}  // namespace l4d::train
