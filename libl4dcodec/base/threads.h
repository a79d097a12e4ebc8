// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <exception>
#include <mutex>

#ifdef _OPENMP
#include <omp.h>
#endif

namespace l4d {

// Number of workers for a `threads` option: 0 means one per core.
inline int resolve_threads(int threads) {
#ifdef _OPENMP
  return threads > 0 ? threads : std::max(1, omp_get_num_procs());
#else
  (void)threads;
  return 1;
#endif
}

// Runs body(begin, end) over [0, count) cut into pieces of `grain`. The cut depends on count and grain
// alone, never on the number of threads, so a caller that keeps one result per piece and combines
// them in order gets the same bits for any thread count. The first exception thrown by a piece is
// rethrown on the calling thread after all pieces have ended.
template <typename Body>
void parallel_for(int threads, size_t count, size_t grain, const Body& body) {
  if (count == 0) return;
  grain = std::max<size_t>(grain, 1);
  const size_t pieces = (count + grain - 1) / grain;
  const int workers = static_cast<int>(
      std::min<size_t>(static_cast<size_t>(resolve_threads(threads)), pieces));
  if (workers <= 1) {
    for (size_t i = 0; i < pieces; ++i) body(i * grain, std::min(count, (i + 1) * grain));
    return;
  }
#ifdef _OPENMP
  std::exception_ptr error;
  std::mutex error_mutex;
#pragma omp parallel for schedule(dynamic, 1) num_threads(workers)
  for (std::ptrdiff_t i = 0; i < static_cast<std::ptrdiff_t>(pieces); ++i) {
    try {
      const size_t begin = static_cast<size_t>(i) * grain;
      body(begin, std::min(count, begin + grain));
    } catch (...) {
      std::lock_guard<std::mutex> lock(error_mutex);
      if (!error) error = std::current_exception();
    }
  }
  if (error) std::rethrow_exception(error);
#endif
}

}  // namespace l4d
