// SPDX-License-Identifier: Apache-2.0
// Selecting, decoding, slicing, codebooks and sections in random order and at random times on one
// handle, with streams opened and closed in between.
#include <cstdlib>

#include "tests/fuzz/stream_mutator.h"
#include "tests/hostile/session.h"

namespace {

constexpr size_t kSteps = 16;
constexpr size_t kControlBytes = 1 + 3 * kSteps;

}  // namespace

// Options, then steps of three bytes (which, and how), then a file.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using l4d::test::Session;
  if (size < kControlBytes) return 0;
  static Session& session = *new Session;
  const l4d::Bytes file(data + kControlBytes, data + size);
  l4d_decoder_options options = l4d::test::session_options();
  options.backend = (data[0] & 1) != 0 ? L4D_BACKEND_REFERENCE : L4D_BACKEND_CPU;
  options.cache_bytes = (data[0] & 2) != 0 ? 1 : options.cache_bytes;
  options.threads = 1u + ((data[0] & 4) != 0);
  l4d_decoder* decoder = nullptr;
  if (l4d_decoder_create(&options, &decoder) != L4D_OK) std::abort();
  bool open = l4d_decoder_open_memory(decoder, file.data(), file.size()) == L4D_OK;
  for (size_t i = 0; i < kSteps && open; ++i) {
    const uint8_t* step = data + 1 + 3 * i;
    const auto kinds = static_cast<unsigned>(Session::Step::kCount);
    if (step[0] == 255) {
      open = l4d_decoder_open_memory(decoder, file.data(), file.size()) == L4D_OK;
      continue;
    }
    const l4d_status status = session.step(decoder, static_cast<Session::Step>(step[0] % kinds),
                                           step[1] | uint32_t{step[2]} << 8);
    if (status == L4D_ERR_INTERNAL) std::abort();
    l4d_counters counters = L4D_INIT(l4d_counters);
    if (l4d_decoder_get_counters(decoder, &counters) != L4D_OK) std::abort();
    if (counters.memory_bytes > l4d::test::kSessionMemory) std::abort();
  }
  l4d_decoder_destroy(decoder);
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_input(data, size, max_size, kControlBytes, seed);
}
