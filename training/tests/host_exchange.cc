// SPDX-License-Identifier: Apache-2.0
#include "training/tests/host_exchange.h"

#include "libl4dcodec/base/threads.h"

namespace l4d::train::test {
namespace {

constexpr size_t kRowGrain = 4096;

// Numbers [begin, end) of an array that all members have. add(sum, number of a member).
template <typename T, typename Add>
void add_array(const std::vector<T*>& members, size_t begin, size_t end, const Add& add) {
  for (size_t i = begin; i < end; ++i) {
    T sum = members[0][i];
    for (size_t k = 1; k < members.size(); ++k) sum = add(sum, members[k][i]);
    for (T* member : members) member[i] = sum;
  }
}

template <typename T, typename Add>
void add_rows(const std::vector<StepSums>& members, size_t array, size_t begin, size_t end,
              const Add& add) {
  std::vector<T*> pointers;
  for (const StepSums& m : members) pointers.push_back(static_cast<T*>(m.arrays[array].data));
  const size_t width = members[0].arrays[array].width;
  add_array(pointers, begin * width, end * width, add);
}

class HostExchange final : public Exchange {
 public:
  explicit HostExchange(uint32_t threads) : threads_(resolve_threads(static_cast<int>(threads))) {}

  void add_up(const std::vector<StepSums>& members) override {
    uint32_t any = 0;
    for (const StepSums& m : members) any |= *m.stop;
    for (const StepSums& m : members) *m.stop_any = any;
    if (any != 0) return;  // nobody will use the sums
    const auto rows = static_cast<size_t>(members[0].rows);
    parallel_for(threads_, rows, kRowGrain, [&](size_t begin, size_t end) {
      for (size_t array = 0; array < members[0].arrays.size(); ++array) {
        add_kind(members, array, begin, end);
      }
    });
  }

 private:
  static void add_kind(const std::vector<StepSums>& members, size_t array, size_t begin,
                       size_t end) {
    const auto plus = [](auto a, auto b) { return a + b; };
    switch (members[0].arrays[array].kind) {
      case SumArray::kFloat:
        return add_rows<float>(members, array, begin, end, plus);
      case SumArray::kCount:
        return add_rows<uint32_t>(members, array, begin, end, plus);
      case SumArray::kFlag:
        return add_rows<uint8_t>(members, array, begin, end,
                                 [](uint8_t a, uint8_t b) { return static_cast<uint8_t>(a | b); });
    }
  }

  int threads_;
};

}  // namespace

std::unique_ptr<Exchange> make_host_exchange(uint32_t threads) {
  return std::make_unique<HostExchange>(threads);
}

}  // namespace l4d::train::test
