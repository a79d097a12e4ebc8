// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

namespace l4d::fuzz {

// For LLVMFuzzerCustomMutator: `control_bytes`, then a file.
size_t mutate_input(uint8_t* data, size_t size, size_t max_size, size_t control_bytes,
                    unsigned seed);
// `control_bytes`, then a scene header or a directory page.
size_t mutate_flat_input(uint8_t* data, size_t size, size_t max_size, size_t control_bytes,
                         bool is_directory_page, unsigned seed);

}  // namespace l4d::fuzz
