// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "training/sync/align.h"

// Where one signal is like another one.
namespace l4d::train {

// Changes of the logarithm, so that a camera that is near does not outweigh its own quiet times.
Signal detail_of(const Signal& signal, double rate);

struct Match {
  double lag = 0;                    // b[k + lag] looks like a[k]
  double peak = -1, elsewhere = -1;  // correlations there, and a fifth of a second away or more
  double tries = 0;                  // lags at which enough of both is there
};

// Of lags that are at most `most` from `first`. has: the values of `a` that count; empty: all. No
// lag has enough of both, or nothing in common: peak is -1.
Match match(const Signal& a, const std::vector<uint8_t>& has, const Signal& b, std::ptrdiff_t first,
            std::ptrdiff_t most, double rate);

// The peak that such a match has once in 20 times where the signals have nothing in common, by how
// many values of these say something of their own. has: [a.size()] flags.
double chance(const Match& found, const Signal& a, const std::vector<uint8_t>& has, const Signal& b,
              double rate);

}  // namespace l4d::train
