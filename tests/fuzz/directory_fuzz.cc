// SPDX-License-Identifier: Apache-2.0
// A page table entry and a directory page, for a layer that allows everything.
#include <cstdlib>

#include "libl4dcodec/container/directory.h"
#include "tests/fuzz/stream_mutator.h"

namespace {

using namespace l4d;

// Layer number, index of the directory page and its bits, payload offset; the entry.
constexpr size_t kControlBytes = 4 + PageTableEntry::kBytes;

SceneHeader header_of(const uint8_t* control) {
  SceneHeader header;
  header.timeline = {0, 1u << 20, 30, 1, 0};
  header.sh.coding = ComponentCodingId::kVq;
  header.layers.resize(2);
  for (LayerHeader& layer : header.layers) {
    layer.level = control[1] % 16u;
    layer.directory_bits = control[2] % 17u;
    layer.num_gaussians = 1000;
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      layer.component[c].coding = ComponentCodingId::kVq;
      layer.component[c].has_rcq = c != L4D_COMPONENT_ROTOR_TEMPORAL;
    }
  }
  header.payload_offset = control[3] == 255 ? ~uint64_t{0} - 100 : control[3];
  return header;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size < kControlBytes) return 0;
  PageTableEntry entry;
  (void)PageTableEntry::parse(ByteSpan(data + 4, PageTableEntry::kBytes), 0, &entry);
  const SceneHeader header = header_of(data);
  const uint32_t index = (data[0] >> 1) % num_directory_pages(header.layers[0]);
  DirectoryPage page;
  // An address of its own, odd by the second bit: FlatBuffers want theirs aligned.
  const size_t shift = data[0] >> 7;
  Bytes storage(shift + size - kControlBytes);
  std::copy(data + kControlBytes, data + size,
            storage.begin() + static_cast<std::ptrdiff_t>(shift));
  const ByteSpan bytes(storage.data() + shift, size - kControlBytes);
  if (!parse_directory_page(bytes, 0, header, data[0] & 1, index, &page).ok()) return 0;
  if (page.blocks.size() > kMaxBlocksPerPage) std::abort();
  const uint64_t end = num_buckets(header.layers[0].level);
  for (const PageRecord& p : page.pages) {
    if (p.bucket >= end || p.num_gaussians == 0 || p.num_gaussians > kMaxPageGaussians) {
      std::abort();
    }
    if (p.block != kNoBlock && p.block >= page.blocks.size()) std::abort();
  }
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_flat_input(data, size, max_size, kControlBytes, true, seed);
}
