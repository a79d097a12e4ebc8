// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "eval/observer.h"
#include "eval/pair/pair_meter.h"
#include "eval/pair/pairing.h"
#include "l4d/experimental/inspect.h"

namespace l4d::eval {

// Looks for a Gaussian of A for each Gaussian of B, each once, such that no pair differs by more
// than `stated` says that B's do: position, shape, opacity, visible position and colours. Of those
// that are possible, pairs of the smallest distance come first. Returns false if it finds no such
// pairs; then B is not a coding of A, or A is seen with other minimum sizes. threads: 0 = one per
// core; the pairs are the same for any number.
bool pair_as_stated(const PairMeter& meter, const l4d_coding_errors& stated, uint32_t threads,
                    const Observer& observer, Pairing* pairing);

}  // namespace l4d::eval
