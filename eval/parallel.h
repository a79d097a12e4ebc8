// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace l4d::eval {

// Items per block: sums that are made block by block, then over blocks in order, are the same for
// any number of threads.
constexpr size_t kBlockItems = 4096;

inline size_t num_blocks(size_t items) { return (items + kBlockItems - 1) / kBlockItems; }

// Calls body(block, begin, end) for each block of `items`, on `threads` threads (0 = one per core).
// Where blocks throw, the exception of the first of them comes out, for any number of threads.
template <typename Body>
void for_each_block(size_t items, uint32_t threads, const Body& body) {
  const size_t blocks = num_blocks(items);
  if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
  std::atomic<size_t> next{0};
  std::exception_ptr failure;
  size_t failed = blocks;
  std::mutex failure_mutex;
  const auto work = [&] {
    size_t block = 0;
    try {
      while ((block = next++) < blocks) {
        body(block, block * kBlockItems, std::min(items, (block + 1) * kBlockItems));
      }
    } catch (...) {
      const std::lock_guard<std::mutex> lock(failure_mutex);
      next = blocks;
      if (block >= failed) return;
      failed = block;
      failure = std::current_exception();
    }
  };
  std::vector<std::thread> workers;
  try {
    for (size_t i = 1; i < std::min<size_t>(threads, blocks); ++i) workers.emplace_back(work);
  } catch (...) {
    // The system gives no more threads: those that there are do the work.
  }
  work();
  for (std::thread& worker : workers) worker.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace l4d::eval
