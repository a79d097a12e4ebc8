// SPDX-License-Identifier: Apache-2.0
// The mutator of targets whose input is a file behind a few control bytes: half of the inputs get a
// structure-aware mutation, and half of those that libFuzzer mutates get right checksums.
#include "tests/fuzz/stream_mutator.h"

#include <algorithm>
#include <cstring>

#include "tests/hostile/chunk_walk.h"
#include "tests/hostile/mutate.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace l4d::fuzz {

size_t mutate_input(uint8_t* data, size_t size, size_t max_size, size_t control_bytes,
                    unsigned seed) {
  test::Random random(seed);
  if (size <= control_bytes || random.below(8) == 0) return LLVMFuzzerMutate(data, size, max_size);
  uint8_t* file = data + control_bytes;
  size_t bytes = size - control_bytes;
  const uint32_t choice = random.below(4);
  if (choice < 2) {
    Bytes copy(file, file + bytes);
    test::mutate_stream(copy, random);
    std::copy(copy.begin(), copy.end(), file);
    return size;
  }
  bytes = LLVMFuzzerMutate(file, bytes, max_size - control_bytes);
  if (choice == 2) {
    Bytes copy(file, file + bytes);
    test::repair_checksums(copy);
    std::copy(copy.begin(), copy.end(), file);
  }
  return control_bytes + bytes;
}

size_t mutate_flat_input(uint8_t* data, size_t size, size_t max_size, size_t control_bytes,
                         bool is_directory_page, unsigned seed) {
  test::Random random(seed);
  if (size > control_bytes && random.below(2) == 0) {
    Bytes copy(data + control_bytes, data + size);
    if (test::mutate_flat(copy, is_directory_page, random)) {
      std::copy(copy.begin(), copy.end(), data + control_bytes);
      return size;
    }
  }
  return LLVMFuzzerMutate(data, size, max_size);
}

}  // namespace l4d::fuzz
