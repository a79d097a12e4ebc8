// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#ifdef L4D_OPENMP
#include <omp.h>
#endif

namespace l4d {

// Number of workers for a `threads` option: 0 means one per core.
inline int resolve_threads(int threads) {
  if (threads > 0) return threads;
#ifdef L4D_OPENMP
  return std::max(1, omp_get_num_procs());
#else
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
#endif
}

// Runs work() on `workers` threads, the caller's among them, and returns when all have ended. It
// must not throw. Threads are made for the call: that costs some 20 us each, asks for no state
// between calls, and no thread waits in a loop that takes the core from one that works
// (docs/decisions/0005).
template <typename Work>
void run_workers(int workers, const Work& work) {
#ifdef L4D_OPENMP
#pragma omp parallel num_threads(workers)
  work();
#else
  std::vector<std::thread> others;
  others.reserve(static_cast<size_t>(workers));
  try {
    for (int i = 1; i < workers; ++i) others.emplace_back(work);
  } catch (...) {
    // The system gives no more threads: those that there are do the work.
  }
  work();
  for (std::thread& thread : others) thread.join();
#endif
}

// Gaussians in a piece, where each costs little.
constexpr size_t kGrain = 4096;

// Runs body(begin, end) over [0, count) cut into pieces of `grain`. The cut depends on count and
// grain alone, never on the number of threads, so a caller that keeps one result per piece and
// combines them in order gets the same bits for any thread count. Of the exceptions that pieces
// throw, that of the first piece in their order is rethrown on the calling thread after all have
// ended, so that a caller names the same cause for any thread count.
template <typename Body>
void parallel_for(int threads, size_t count, size_t grain, const Body& body) {
  if (count == 0) return;
  grain = std::max<size_t>(grain, 1);
  const size_t pieces = (count + grain - 1) / grain;
  const int workers =
      static_cast<int>(std::min<size_t>(static_cast<size_t>(resolve_threads(threads)), pieces));
  if (workers <= 1) {
    for (size_t i = 0; i < pieces; ++i) body(i * grain, std::min(count, (i + 1) * grain));
    return;
  }
  std::atomic<size_t> next{0};
  std::exception_ptr error;
  size_t failed = pieces;
  std::mutex error_mutex;
  run_workers(workers, [&] {
    for (size_t i = next++; i < pieces; i = next++) {
      try {
        const size_t begin = i * grain;
        body(begin, std::min(count, begin + grain));
      } catch (...) {
        const std::lock_guard<std::mutex> lock(error_mutex);
        if (i < failed) {
          failed = i;
          error = std::current_exception();
        }
      }
    }
  });
  if (error) std::rethrow_exception(error);
}

}  // namespace l4d
