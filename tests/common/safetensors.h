// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace l4d::test {

// A .safetensors file: the length of the header, the header, and what follows.
inline std::vector<uint8_t> safetensors_file(const std::string& header,
                                             const std::vector<float>& values) {
  std::vector<uint8_t> bytes;
  for (int k = 0; k < 8; ++k) {
    bytes.push_back(static_cast<uint8_t>(uint64_t{header.size()} >> (8 * k)));
  }
  bytes.insert(bytes.end(), header.begin(), header.end());
  for (const float value : values) {
    uint32_t bits = 0;
    std::memcpy(&bits, &value, sizeof(bits));
    for (int k = 0; k < 4; ++k) bytes.push_back(static_cast<uint8_t>(bits >> (8 * k)));
  }
  return bytes;
}

}  // namespace l4d::test
