// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <future>
#include <system_error>

namespace l4d {

// Starts `work` on a thread of its own, or does it at once where `concurrent` is not set or the
// system gives no thread. What the future gives, and throws, is the work's. Its end waits for the
// work.
template <typename Work>
auto start_async(bool concurrent, const Work& work) -> std::future<decltype(work())> {
  if (concurrent) {
    try {
      return std::async(std::launch::async, work);
    } catch (const std::system_error&) {
      // Then here.
    }
  }
  std::packaged_task<decltype(work())()> task(work);
  std::future<decltype(work())> done = task.get_future();
  task();
  return done;
}

}  // namespace l4d
