// SPDX-License-Identifier: Apache-2.0
// The validator, and its agreement with the decoder: what has no violation decodes.
#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "tests/fuzz/stream_mutator.h"
#include "tests/hostile/session.h"

namespace {

int64_t read_at(void* user, void* dst, size_t n, uint64_t offset) {
  const auto& file = *static_cast<const l4d::Bytes*>(user);
  std::copy_n(file.data() + offset, n, static_cast<unsigned char*>(dst));
  return static_cast<int64_t>(n);
}
int64_t size_of(void* user) {
  return static_cast<int64_t>(static_cast<const l4d::Bytes*>(user)->size());
}
void on_violation(void*, const l4d_violation* v) {
  if (v->status == L4D_ERR_INTERNAL || v->message == nullptr || std::strlen(v->message) == 0) {
    std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static l4d::test::Session& session = *new l4d::test::Session;
  l4d::Bytes file(data, data + size);
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = &file;
  reader.read_at = read_at;
  reader.size = size_of;
  const l4d_decoder_options options = l4d::test::session_options();
  uint64_t violations = 0;
  const l4d_status checked = l4d_validate(&reader, &options, on_violation, nullptr, &violations);
  if (checked != L4D_OK && checked != L4D_ERR_LIMIT_EXCEEDED) std::abort();
  if (checked == L4D_OK && violations == 0) {
    const l4d_status status = session.decode_all(file, nullptr);
    if (status != L4D_OK && status != L4D_ERR_LIMIT_EXCEEDED) std::abort();
  }
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_input(data, size, max_size, 0, seed);
}
