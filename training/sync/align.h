// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

// Clocks of cameras, by what changed in front of all of them.
namespace l4d::train {

// What a camera measured, `rate` values a second of its own clock: 0 or more each.
using Signal = std::vector<double>;

struct Offset {
  double seconds = 0;      // by which its clock is slow: its times plus this are the others'
  double correlation = 0;  // with the mean of the others, as these are placed without it, there
  double elsewhere = 0;    // the best one that is a fifth of a second or more away
  double chance = 1;       // what cameras that have nothing in common reach once in 20 times
  bool agrees = false;     // with all cameras it has the same place as with these
  // It agrees, and the correlation is higher than by chance and than anywhere else.
  bool is_sure() const;
};

// Offsets of clocks whose median is 0. most: s, that two clocks are apart; signals of less than
// twice a second, and those in which nothing changes, are not sure. The result is the same for any
// number of threads.
std::vector<Offset> align(const std::vector<Signal>& signals, double rate, double most,
                          uint32_t threads);

}  // namespace l4d::train
