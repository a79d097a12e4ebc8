// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace l4d::train {

// How long work will take, by the newest half to three quarters of the time so far: the steps of a
// training take longer the more Gaussians there are. Times are in seconds from any origin.
class Pace {
 public:
  void begin(double now, uint64_t done) { begin_ = older_ = newer_ = {now, done}; }
  void note(double now, uint64_t done) {
    if (now - begin_.time < 2 * (newer_.time - begin_.time) || now - begin_.time < kLeast) return;
    older_ = newer_;
    newer_ = {now, done};
  }
  // Seconds until `total`; below 0: nothing tells yet.
  double left(double now, uint64_t done, uint64_t total) const {
    if (done <= older_.done || now - begin_.time < kLeast) return -1;
    const double left = static_cast<double>(total - (done < total ? done : total));
    return (now - older_.time) * left / static_cast<double>(done - older_.done);
  }

 private:
  struct Mark {
    double time = 0;
    uint64_t done = 0;
  };
  static constexpr double kLeast = 1;  // s
  Mark begin_, older_, newer_;
};

}  // namespace l4d::train
