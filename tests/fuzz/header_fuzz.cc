// SPDX-License-Identifier: Apache-2.0
// The file header and the scene header, without the checksums before them.
#include <cstdlib>

#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/file_header.h"
#include "libl4dcodec/container/page.h"
#include "libl4dcodec/container/scene_header.h"
#include "tests/fuzz/stream_mutator.h"

namespace {

using namespace l4d;

constexpr size_t kControlBytes = FileHeader::kBytes;

void file_header(Bytes head, bool repair) {
  if (repair && head.size() == FileHeader::kBytes) {
    store_le(hash64(ByteSpan(head.data(), 32)), head.data() + 32);
  }
  FileHeader parsed;
  if (!FileHeader::parse(head, &parsed).ok()) return;
  Bytes again;
  parsed.append(again);
  if (again != head) std::abort();  // nothing of it may be lost
}

void scene_header(const Bytes& bytes) {
  SceneHeader header;
  if (!parse_scene_header(bytes, 0, &header).ok()) return;
  // What was accepted can be written, and is then read as the same.
  const Bytes written = serialize_scene_header(header);
  SceneHeader again;
  if (!parse_scene_header(written, 0, &again).ok()) std::abort();
  if (serialize_scene_header(again) != written) std::abort();
  for (const LayerHeader& layer : header.layers) {
    if (num_directory_pages(layer) > 1u << 20) std::abort();
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      (void)stage0_entries(header, layer, c, nullptr);
    }
  }
  if (max_page_bytes(header, kMaxPageGaussians) > uint64_t{1} << 26) std::abort();
}

}  // namespace

// 40 bytes of file header, then a scene header.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < kControlBytes) {
    file_header(Bytes(data, data + size), false);
    return 0;
  }
  file_header(Bytes(data, data + kControlBytes), false);
  file_header(Bytes(data, data + kControlBytes), true);
  scene_header(Bytes(data + kControlBytes, data + size));
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_flat_input(data, size, max_size, kControlBytes, false, seed);
}
