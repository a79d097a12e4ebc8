// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>

#include "training/step/exchange.h"

namespace l4d::train::test {

// The exchange of members on the host, which stand for devices here. threads: 0 = one per core;
// never changes the result.
std::unique_ptr<Exchange> make_host_exchange(uint32_t threads);

}  // namespace l4d::train::test
