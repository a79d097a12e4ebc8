// SPDX-License-Identifier: Apache-2.0
#include "tests/hostile/chunk_walk.h"

#include <algorithm>
#include <utility>

#include "l4d_generated.h"
#include "libl4dcodec/base/hash.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/file_header.h"
#include "libl4dcodec/container/flat_check.h"
#include "libl4dcodec/container/scene_header.h"
#include "libl4dcodec/entropy/zstd_codec.h"

namespace l4d::test {
namespace {

// Both structs that locate chunks in FlatBuffers begin with the offset and the hash. A page record
// has those of an SH chunk next.
constexpr size_t kHashInStruct = 8;
constexpr size_t kShHashInStruct = 24;
// Of one layer: a stream may claim a million of them.
constexpr uint32_t kMaxDirectoryPages = 4096;
constexpr uint32_t kMaxUnpackedDirectory = 1u << 20;

class Walker {
 public:
  Walker(Bytes& file, bool repair) : file_(file), repair_(repair) {}

  void run() {
    if (file_.size() < FileHeader::kBytes) return;
    note(ChunkKind::kFileHeader, 0, FileHeader::kBytes);
    const uint32_t bytes = load_le<uint32_t>(file_.data() + 12);
    const uint64_t offset = load_le<uint64_t>(file_.data() + 16);
    if (inside(offset, bytes) && bytes > 0) {
      note(ChunkKind::kSceneHeader, offset, bytes);
      scene_header(static_cast<size_t>(offset), bytes);
    }
    if (repair_) store_le(hash64(ByteSpan(file_.data(), 32)), file_.data() + 32);
  }

  std::vector<ChunkPlace> places;

 private:
  bool inside(uint64_t offset, uint64_t bytes) const {
    return offset <= file_.size() && bytes <= file_.size() - offset;
  }
  void note(ChunkKind kind, uint64_t offset, uint64_t bytes) {
    places.push_back({kind, static_cast<size_t>(offset), static_cast<size_t>(bytes)});
  }
  uint64_t hash_of(uint64_t offset, uint64_t bytes) const {
    return hash64(ByteSpan(file_.data() + offset, static_cast<size_t>(bytes)));
  }

  // `place`: a ChunkRef or a PageRecord in a copy of its FlatBuffer.
  template <typename Place>
  void chunk(ChunkKind kind, const Place* place, uint64_t base) {
    range(kind, place, kHashInStruct, place->offset(), place->stored_bytes(), base);
  }
  // hash_at: where in `place` its hash is.
  void range(ChunkKind kind, const void* place, size_t hash_at, uint64_t relative, uint32_t stored,
             uint64_t base) {
    const uint64_t offset = base + relative;
    if (offset < base || stored == 0) return;
    if (!inside(offset, stored)) return;
    note(kind, offset, stored);
    if (!repair_) return;
    auto* bytes = const_cast<unsigned char*>(static_cast<const unsigned char*>(place));
    hashes_.emplace_back(bytes + hash_at, hash_of(offset, stored));
  }

  // Of the places in a FlatBuffer, once all of it has been read: its objects may overlap, and a
  // hash stored in one can then spoil the others, which have been verified.
  void store_hashes() {
    for (const auto& [bytes, hash] : hashes_) store_le(hash, bytes);
    hashes_.clear();
  }

  void component(const fbs::ComponentCoding* coding) {
    if (coding->coding() == static_cast<uint8_t>(ComponentCodingId::kTransform) &&
        coding->basis() != nullptr) {
      chunk(ChunkKind::kCodebook, coding->basis()->codebook(), 0);
    }
    if (coding->coding() != static_cast<uint8_t>(ComponentCodingId::kVq)) return;
    if (coding->stages() != nullptr) {
      for (const fbs::Stage* s : *coding->stages()) chunk(ChunkKind::kCodebook, s->codebook(), 0);
    }
    if (coding->rcq() != nullptr) chunk(ChunkKind::kCodebook, coding->rcq()->codebook(), 0);
  }

  void scene_header(size_t offset, size_t bytes) {
    // A copy, as FlatBuffers want theirs aligned.
    const auto begin = file_.begin() + static_cast<std::ptrdiff_t>(offset);
    Bytes copy(begin, begin + static_cast<std::ptrdiff_t>(bytes));
    flatbuffers::Verifier verifier(copy.data(), copy.size(), 16, 100000);
    if (verifier.VerifyBuffer<fbs::Header>("L4DH") &&
        tables_are_whole(copy, fbs::HeaderTypeTable())) {
      const fbs::Header* header = flatbuffers::GetRoot<fbs::Header>(copy.data());
      component(header->sh());
      for (const fbs::Layer* layer : *header->layers()) {
        component(layer->scale());
        component(layer->rotor_spatial());
        component(layer->rotor_temporal());
        if (layer->entropy() != nullptr) chunk(ChunkKind::kCodebook, layer->entropy(), 0);
      }
      store_hashes();
      SceneHeader scene;
      if (parse_scene_header(copy, 0, &scene).ok()) {
        for (uint32_t l = 0; l < scene.layers.size(); ++l) page_table(scene, l);
      }
    }
    if (!repair_) return;
    std::copy(copy.begin(), copy.end(), file_.begin() + static_cast<std::ptrdiff_t>(offset));
    store_le(hash_of(offset, bytes), file_.data() + 24);
  }

  void page_table(const SceneHeader& scene, uint32_t l) {
    const LayerHeader& layer = scene.layers[l];
    if (layer.num_gaussians == 0) return;
    const uint32_t count = std::min(num_directory_pages(layer), kMaxDirectoryPages);
    if (!inside(layer.page_table_offset, count * PageTableEntry::kBytes)) return;
    note(ChunkKind::kPageTable, layer.page_table_offset, count * PageTableEntry::kBytes);
    for (uint32_t d = 0; d < count; ++d) {
      const auto at = static_cast<size_t>(layer.page_table_offset) + d * PageTableEntry::kBytes;
      const uint64_t offset = load_le<uint64_t>(file_.data() + at);
      const uint32_t stored = load_le<uint32_t>(file_.data() + at + 16);
      const uint32_t raw = load_le<uint32_t>(file_.data() + at + 20);
      const uint32_t codec = load_le<uint32_t>(file_.data() + at + 24);
      if (stored > 0 && inside(offset, stored)) {
        note(ChunkKind::kDirectoryPage, offset, stored);
        directory_page(scene, static_cast<size_t>(offset), stored, raw, codec);
        if (repair_) store_le(hash_of(offset, stored), file_.data() + at + 8);
      }
      if (repair_) {
        store_le(static_cast<uint32_t>(hash_of(at, 28)), file_.data() + at + 28);
      }
    }
  }

  void directory_page(const SceneHeader& scene, size_t offset, size_t stored, uint32_t raw,
                      uint32_t codec) {
    const auto begin = file_.begin() + static_cast<std::ptrdiff_t>(offset);
    Bytes copy(begin, begin + static_cast<std::ptrdiff_t>(stored));
    if (codec != 0) {
      if (raw > kMaxUnpackedDirectory) return;
      Bytes unpacked(raw);
      if (!zstd_.decompress(copy, unpacked.data(), unpacked.size())) return;
      copy = std::move(unpacked);
    }
    flatbuffers::Verifier verifier(copy.data(), copy.size(), 16, 2048);
    if (!verifier.VerifyBuffer<fbs::DirectoryPage>("L4DD")) return;
    const fbs::DirectoryPage* page = flatbuffers::GetRoot<fbs::DirectoryPage>(copy.data());
    if (!tables_are_whole(copy, fbs::DirectoryPageTypeTable())) return;
    for (const fbs::PageRecord* p : *page->pages()) {
      chunk(ChunkKind::kPage, p, scene.payload_offset);
      range(ChunkKind::kShDetail, p, kShHashInStruct, p->sh_offset(), p->sh_bytes(),
            scene.payload_offset);
    }
    if (page->blocks() != nullptr) {
      for (const fbs::Block* block : *page->blocks()) {
        for (const fbs::RcqTable* t : *block->tables()) {
          chunk(ChunkKind::kBlockCodebook, t->table(), scene.payload_offset);
        }
      }
    }
    store_hashes();
    if (repair_ && codec == 0) std::copy(copy.begin(), copy.end(), begin);
  }

  Bytes& file_;
  const bool repair_;
  std::vector<std::pair<unsigned char*, uint64_t>> hashes_;
  ZstdDecompressor zstd_;
};

}  // namespace

std::vector<ChunkPlace> chunk_places(const Bytes& file) {
  Bytes copy = file;
  Walker walker(copy, false);
  walker.run();
  return walker.places;
}

void repair_checksums(Bytes& file) { Walker(file, true).run(); }

}  // namespace l4d::test
