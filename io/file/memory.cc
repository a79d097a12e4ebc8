// SPDX-License-Identifier: Apache-2.0
#include "io/file/memory.h"

#include <algorithm>
#include <cstdio>
#include <mutex>
#include <utility>

#include "io/scene/scene.h"

namespace l4d::io {

struct MemoryBudget::State {
  std::string name;
  uint64_t limit = 0;
  uint64_t held = 0;
  std::mutex mutex;
};

MemoryBudget::MemoryBudget(std::string name, uint64_t limit) : state_(std::make_shared<State>()) {
  state_->name = std::move(name);
  state_->limit = limit;
}

std::shared_ptr<void> MemoryBudget::take(uint64_t bytes, const std::string& what) const {
  State& state = *state_;
  if (state.limit == 0) return nullptr;
  {
    const std::lock_guard<std::mutex> lock(state.mutex);
    const uint64_t left = state.limit - std::min(state.limit, state.held);
    if (bytes > left) {
      throw Error(L4D_ERR_LIMIT_EXCEEDED, what + " needs " + text_of_bytes(bytes) + "; of " +
                                              state.name + ", " + text_of_bytes(state.limit) +
                                              ", " + text_of_bytes(left) + " are left");
    }
    state.held += bytes;
  }
  // The deleter is what is wanted of it; any address but null has it called.
  return std::shared_ptr<void>(state_.get(), [kept = state_, bytes](void*) {
    const std::lock_guard<std::mutex> lock(kept->mutex);
    kept->held -= bytes;
  });
}

uint64_t MemoryBudget::held() const {
  const std::lock_guard<std::mutex> lock(state_->mutex);
  return state_->held;
}

Hold MemoryBudget::holder() const {
  return [budget = *this](uint64_t bytes, const std::string& what) {
    return budget.take(bytes, what);
  };
}

std::string text_of_bytes(uint64_t bytes) {
  if (bytes < 1000) return std::to_string(bytes) + " bytes";
  const char* const units[] = {"kB", "MB", "GB", "TB", "PB", "EB"};
  double value = static_cast<double>(bytes) / 1000;
  size_t unit = 0;
  // 999.95 would print as "1000.0".
  for (; value >= 999.95 && unit < 5; ++unit) value /= 1000;
  char text[32];
  std::snprintf(text, sizeof(text), value < 9.995 ? "%.2f %s" : "%.1f %s", value, units[unit]);
  return text;
}

uint64_t json_bytes(const char* text, size_t size, uint64_t of_object) {
  // Of the library: a value with the growth of its list, a list, and a node of an object with its
  // key, each with what the allocator adds.
  constexpr uint64_t kValue = 48, kList = 64, kNode = 128;
  uint64_t bytes = 2 * uint64_t{size};
  for (size_t k = 0; k < size; ++k) {
    const char c = text[k];
    if (c == ',') bytes += kValue;
    if (c == '[') bytes += kList + kValue;
    if (c == '{') bytes += kList + kValue + of_object;
    if (c == ':') bytes += kNode;
  }
  return bytes;
}

}  // namespace l4d::io
