// SPDX-License-Identifier: Apache-2.0
// A reader that returns less than asked for, fails now and then, lies about its size, or hands out
// other bytes the second time: a network is no file.
#include <algorithm>
#include <cstdlib>

#include "tests/fuzz/stream_mutator.h"
#include "tests/hostile/session.h"

namespace {

// Options, largest read, size error; then what happens at each of the first calls.
constexpr size_t kCalls = 29;
constexpr size_t kControlBytes = 3 + kCalls;

struct Reader {
  const uint8_t* control;
  l4d::Bytes file;
  size_t calls = 0;

  static int64_t read_at(void* user, void* dst, size_t n, uint64_t offset) {
    auto& self = *static_cast<Reader*>(user);
    const uint8_t event = self.calls < kCalls ? self.control[3 + self.calls] : 0;
    ++self.calls;
    if (event == 1) return -1;
    if (event == 2) return 0;
    if (event == 3) return static_cast<int64_t>(n) + 1;  // more than fits
    if (offset >= self.file.size()) return 0;
    n = std::min({n, size_t{1} + self.control[1] * size_t{self.control[1]},
                  self.file.size() - static_cast<size_t>(offset)});
    auto* to = static_cast<unsigned char*>(dst);
    std::copy_n(self.file.data() + offset, n, to);
    // The bytes differ from what a checked read before has seen.
    if (event > 240) to[event % n] = static_cast<unsigned char>(to[event % n] ^ event);
    return static_cast<int64_t>(n);
  }
  static int64_t size(void* user) {
    const auto& self = *static_cast<Reader*>(user);
    return static_cast<int64_t>(self.file.size()) + static_cast<int8_t>(self.control[2]);
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using l4d::test::Session;
  if (size < kControlBytes) return 0;
  static Session& session = *new Session;
  Reader state{data, l4d::Bytes(data + kControlBytes, data + size)};
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = &state;
  reader.read_at = Reader::read_at;
  reader.size = Reader::size;
  const l4d_decoder_options options = l4d::test::session_options();
  if ((data[0] & 1) != 0) {
    uint64_t violations = 0;
    if (l4d_validate(&reader, &options, nullptr, nullptr, &violations) == L4D_ERR_INTERNAL) {
      std::abort();
    }
    return 0;
  }
  l4d_decoder* decoder = nullptr;
  if (l4d_decoder_create(&options, &decoder) != L4D_OK) std::abort();
  if (l4d_decoder_open(decoder, &reader) == L4D_OK) {
    for (const auto step : {Session::Step::kSlice, Session::Step::kDecode, Session::Step::kPacked,
                            Session::Step::kCodebook, Session::Step::kSections}) {
      if (session.step(decoder, step, (data[0] >> 1) * 13u) == L4D_ERR_INTERNAL) std::abort();
    }
  }
  l4d_decoder_destroy(decoder);
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_input(data, size, max_size, kControlBytes, seed);
}
