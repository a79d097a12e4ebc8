// SPDX-License-Identifier: Apache-2.0
#include "tests/hostile/mutate.h"

#include <algorithm>

#include "libl4dcodec/container/directory.h"
#include "tests/hostile/chunk_walk.h"
#include "tests/hostile/flat_slots.h"

namespace l4d::test {
namespace {

uint32_t below(Random& random, size_t n) { return random.below(static_cast<uint32_t>(n)); }

// Short runs are the rule: long ones hit checks that short ones hit too.
size_t run_length(Random& random, size_t limit) {
  const size_t longest = size_t{1} << random.below(8);
  return 1 + below(random, std::min(longest, limit));
}

uint64_t load(const unsigned char* p, unsigned width) {
  uint64_t v = 0;
  for (unsigned i = 0; i < width; ++i) v |= uint64_t{p[i]} << (8 * i);
  return v;
}
void store(unsigned char* p, unsigned width, uint64_t v) {
  for (unsigned i = 0; i < width; ++i) p[i] = static_cast<unsigned char>(v >> (8 * i));
}

// Numbers at the borders of what parsers allow, and near to what was there.
uint64_t number(Random& random, uint64_t old, unsigned width) {
  static constexpr uint64_t kBorders[] = {0,     1,     2,       3,       4,       8,         15,
                                          16,    17,    25,      255,     256,     4096,      65535,
                                          65536, 65537, 1 << 20, 1 << 24, 1 << 26, 0x7fffffff};
  switch (random.below(8)) {
    case 0:
      return ~uint64_t{0} - random.below(3);
    case 1:
      return uint64_t{1} << (8 * width - 1);
    case 2:
      return random.bits();
    case 3:
      return old + 1;
    case 4:
      return old - 1;
    case 5:
      return random.below(2) == 0 ? old * 2 : old / 2;
    default:
      return kBorders[random.below(static_cast<uint32_t>(std::size(kBorders)))];
  }
}

void mutate_number(Bytes& bytes, size_t at, unsigned width, Random& random) {
  unsigned char* p = bytes.data() + at;
  store(p, width, number(random, load(p, width), width));
}

// Changes bytes where they are.
void mutate_in_place(Bytes& file, size_t begin, size_t size, Random& random) {
  const size_t n = run_length(random, size);
  const size_t at = begin + below(random, size - n + 1);
  switch (random.below(4)) {
    case 0:
      file[at] = static_cast<unsigned char>(file[at] ^ (1u << random.below(8)));
      break;
    case 1:
      file[at] =
          static_cast<unsigned char>(random.below(2) == 0 ? random.below(8) : random.below(256));
      break;
    case 2:
      std::fill_n(file.begin() + static_cast<std::ptrdiff_t>(at), n,
                  static_cast<unsigned char>(random.below(2) == 0 ? 0 : random.below(256)));
      break;
    default: {
      const size_t from = begin + below(random, size - n + 1);
      const Bytes piece(file.begin() + static_cast<std::ptrdiff_t>(from),
                        file.begin() + static_cast<std::ptrdiff_t>(from + n));
      std::copy(piece.begin(), piece.end(), file.begin() + static_cast<std::ptrdiff_t>(at));
    }
  }
}

}  // namespace

void mutate_bytes(Bytes& bytes, Random& random) {
  if (bytes.empty()) return;
  const auto at = [&](size_t i) { return bytes.begin() + static_cast<std::ptrdiff_t>(i); };
  const size_t n = run_length(random, bytes.size());
  const size_t begin = below(random, bytes.size() - n + 1);
  switch (random.below(8)) {
    case 0:
      bytes.resize(below(random, bytes.size()));
      break;
    case 1:
      bytes.erase(at(begin), at(begin + n));
      break;
    case 2: {
      const Bytes piece(at(begin), at(begin + n));
      bytes.insert(at(below(random, bytes.size() + 1)), piece.begin(), piece.end());
      break;
    }
    case 3: {
      // Two pieces that do not overlap change places.
      const size_t other = below(random, bytes.size() - n + 1);
      if (other + n <= begin || begin + n <= other) {
        std::swap_ranges(at(begin), at(begin + n), at(other));
      }
      break;
    }
    default:
      mutate_in_place(bytes, 0, bytes.size(), random);
  }
}

bool mutate_flat(Bytes& bytes, bool is_directory_page, Random& random) {
  const std::vector<FlatSlot> slots =
      is_directory_page ? directory_page_slots(bytes) : scene_header_slots(bytes);
  if (slots.empty()) return false;
  const FlatSlot slot = slots[below(random, slots.size())];
  if (random.below(6) == 0) {
    // The number of another place: offsets that meet, counts that belong to something else.
    const FlatSlot other = slots[below(random, slots.size())];
    store(bytes.data() + slot.offset, slot.width, load(bytes.data() + other.offset, other.width));
  } else {
    mutate_number(bytes, slot.offset, slot.width, random);
  }
  return true;
}

void mutate_stream(Bytes& file, Random& random) {
  for (uint32_t k = 0, n = 1 + random.below(4); k < n; ++k) {
    const std::vector<ChunkPlace> places = chunk_places(file);
    if (places.empty()) break;
    const ChunkPlace place = places[random.below(3) == 0 ? std::min<size_t>(1, places.size() - 1)
                                                         : below(random, places.size())];
    const auto begin = file.begin() + static_cast<std::ptrdiff_t>(place.offset);
    if (place.kind == ChunkKind::kPageTable) {
      // Offsets and sizes of an entry; its hashes are repaired anyway.
      static constexpr FlatSlot kFields[] = {{0, 8}, {16, 4}, {20, 4}, {24, 4}};
      const FlatSlot field = kFields[random.below(4)];
      const size_t entry = below(random, place.bytes / PageTableEntry::kBytes);
      mutate_number(file, place.offset + entry * PageTableEntry::kBytes + field.offset, field.width,
                    random);
      continue;
    }
    const bool flat =
        place.kind == ChunkKind::kSceneHeader || place.kind == ChunkKind::kDirectoryPage;
    if (flat && random.below(8) != 0) {
      Bytes copy(begin, begin + static_cast<std::ptrdiff_t>(place.bytes));
      if (mutate_flat(copy, place.kind == ChunkKind::kDirectoryPage, random)) {
        std::copy(copy.begin(), copy.end(), begin);
        continue;
      }
    }
    mutate_in_place(file, place.offset, place.bytes, random);
  }
  repair_checksums(file);
}

}  // namespace l4d::test
