// SPDX-License-Identifier: Apache-2.0
// Everything a player does with a stream from a stranger: open, plan, decode both forms, slice,
// look at codebooks, validate. Checksums stand in the way of random bytes, so files are repaired
// first where the first input byte says so: the parsers behind the checksums must stand on their
// own.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "l4d/decode.h"
#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "tests/fuzz/stream_mutator.h"
#include "tests/hostile/chunk_walk.h"

namespace {

constexpr uint64_t kMaxGaussians = 100000;

void decode_whole(l4d_decoder* decoder, const l4d_info& info, uint32_t detail) {
  l4d_query query = L4D_INIT(l4d_query);
  query.point.detail = detail;
  l4d_selection selection = L4D_INIT(l4d_selection);
  if (l4d_decoder_select(decoder, &query, &selection) != L4D_OK) return;
  const size_t n = static_cast<size_t>(selection.num_gaussians);
  if (n > kMaxGaussians) std::abort();  // the limit was not honoured
  const size_t sh_dim = 3 * (info.sh_degree + 1) * (info.sh_degree + 1);
  std::vector<float> position(3 * n), mean(n), scale(4 * n), rotor(8 * n), opacity(n),
      sh(sh_dim * n);
  l4d_gaussian_buffers buffers = L4D_INIT(l4d_gaussian_buffers);
  buffers.capacity = n;
  buffers.position = position.data();
  buffers.mean_t = mean.data();
  buffers.log_scale = scale.data();
  buffers.rotor = rotor.data();
  buffers.opacity = opacity.data();
  buffers.sh = sh.data();
  (void)l4d_decoder_decode(decoder, &query, &buffers);
  std::vector<uint16_t> index(n * L4D_MAX_STAGES);
  l4d_packed_buffers packed = L4D_INIT(l4d_packed_buffers);
  packed.capacity = n;
  packed.component[L4D_COMPONENT_SCALE].index = index.data();
  (void)l4d_decoder_decode_packed(decoder, &query, &packed);
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  splats.point = query.point;
  (void)l4d_decoder_slice(decoder, info.timeline.time_begin + 0.5 * info.duration, &splats);
}

int64_t read_at(void* user, void* dst, size_t n, uint64_t offset) {
  const auto& file = *static_cast<std::vector<unsigned char>*>(user);
  std::copy_n(file.data() + offset, n, static_cast<unsigned char*>(dst));
  return static_cast<int64_t>(n);
}
int64_t size_of(void* user) {
  return static_cast<int64_t>(static_cast<std::vector<unsigned char>*>(user)->size());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  // An exact-size copy, so that a read one byte too far is seen.
  std::vector<unsigned char> file(data + 1, data + size);
  if ((data[0] & 1) != 0) l4d::test::repair_checksums(file);
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.threads = 1;
  options.backend = (data[0] & 2) != 0 ? L4D_BACKEND_REFERENCE : L4D_BACKEND_CPU;
  options.max_memory_bytes = 256u << 20;
  options.max_gaussians = kMaxGaussians;
  l4d_decoder* decoder = nullptr;
  if (l4d_decoder_create(&options, &decoder) != L4D_OK) return 0;
  if (l4d_decoder_open_memory(decoder, file.data(), file.size()) == L4D_OK) {
    l4d_info info = L4D_INIT(l4d_info);
    if (l4d_decoder_get_info(decoder, &info) != L4D_OK) std::abort();
    decode_whole(decoder, info, L4D_DETAIL_FULL);
    decode_whole(decoder, info, L4D_DETAIL_BASE_COLOR);
    uint64_t sections[L4D_SECTION_COUNT];
    (void)l4d_decoder_get_sections(decoder, sections, L4D_SECTION_COUNT, nullptr, nullptr, 0);
    l4d_codebook codebook = L4D_INIT(l4d_codebook);
    (void)l4d_decoder_get_codebook(decoder, 0, L4D_COMPONENT_SCALE, 0, L4D_NO_BLOCK, &codebook);
  }
  l4d_decoder_destroy(decoder);
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = &file;
  reader.read_at = read_at;
  reader.size = size_of;
  uint64_t violations = 0;
  (void)l4d_validate(&reader, &options, nullptr, nullptr, &violations);
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_input(data, size, max_size, 1, seed);
}
