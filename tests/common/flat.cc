// SPDX-License-Identifier: Apache-2.0
#include "tests/common/flat.h"

#include <algorithm>
#include <stdexcept>

namespace l4d::test {
namespace {

uint32_t u32(const Bytes& b, size_t at) { return load_le<uint32_t>(b.data() + at); }
void set_u32(Bytes& b, size_t at, size_t v) {
  store_le<uint32_t>(static_cast<uint32_t>(v), b.data() + at);
}
uint16_t u16(const Bytes& b, size_t at) { return load_le<uint16_t>(b.data() + at); }
void set_u16(Bytes& b, size_t at, size_t v) {
  store_le<uint16_t>(static_cast<uint16_t>(v), b.data() + at);
}

size_t vtable_of(const Bytes& b, size_t table) {
  return static_cast<size_t>(static_cast<int64_t>(table) - static_cast<int32_t>(u32(b, table)));
}

// Where field `slot` of a table lies.
size_t field(const Bytes& b, size_t table, size_t slot) {
  const size_t vtable = vtable_of(b, table);
  if (4 + 2 * slot >= u16(b, vtable) || u16(b, vtable + 4 + 2 * slot) == 0) {
    throw std::runtime_error("the FlatBuffer lacks the field");
  }
  return table + u16(b, vtable + 4 + 2 * slot);
}

size_t follow(const Bytes& b, size_t at) { return at + u32(b, at); }

// Element i of the vector of offsets in field `slot`.
size_t element(const Bytes& b, size_t table, size_t slot, size_t i) {
  return follow(b, field(b, table, slot)) + 4 + 4 * i;
}

constexpr size_t kHeaderSlots = 22;
constexpr size_t kHeaderOpacity = 15;
constexpr size_t kHeaderMetadata = 20;
constexpr size_t kHeaderExtensions = 21;
constexpr size_t kHeaderReferences[] = {kHeaderOpacity, 17, 18, 20};  // sh, layers, metadata

}  // namespace

// Offsets to tables and vectors are unsigned and point forward, so a root table that is written
// anew before everything else can refer to all that the old one did. Its vtable gains the field.
void add_extension(Bytes& b, uint32_t id, bool critical) {
  constexpr size_t kVtable = 16;  // where the new vtable goes
  const size_t old_root = u32(b, 0);
  const size_t old_vtable = vtable_of(b, old_root);
  const size_t old_slots = (u16(b, old_vtable) - size_t{4}) / 2;
  const size_t table_bytes = (u16(b, old_vtable + 2) + size_t{3}) / 4 * 4;
  size_t root = kVtable + 4 + 2 * kHeaderSlots;
  while (root % 16 != old_root % 16) ++root;
  const size_t vector = root + table_bytes + 4;   // after the new field: count, one offset
  const size_t extension_vtable = vector + 8;     // 4 + 2 * 2 bytes
  const size_t extension = extension_vtable + 8;  // vtable offset, id, critical
  const size_t inserted = (extension + 12 + 15) / 16 * 16;
  Bytes out(inserted, 0);
  std::copy(b.begin() + 4, b.begin() + 8, out.begin() + 4);  // identifier
  set_u32(out, 0, root);
  set_u16(out, kVtable, 4 + 2 * kHeaderSlots);
  set_u16(out, kVtable + 2, table_bytes + 4);
  for (size_t slot = 0; slot < old_slots; ++slot) {
    set_u16(out, kVtable + 4 + 2 * slot, u16(b, old_vtable + 4 + 2 * slot));
  }
  set_u16(out, kVtable + 4 + 2 * kHeaderExtensions, table_bytes);
  std::copy_n(b.begin() + static_cast<std::ptrdiff_t>(old_root), table_bytes,
              out.begin() + static_cast<std::ptrdiff_t>(root));
  set_u32(out, root, root - kVtable);
  const size_t moved = old_root + inserted - root;  // by which references grow
  for (const size_t slot : kHeaderReferences) {
    const uint16_t at = u16(out, kVtable + 4 + 2 * slot);
    if (at != 0) set_u32(out, root + at, u32(out, root + at) + moved);
  }
  set_u32(out, root + table_bytes, 4);  // to the vector
  set_u32(out, vector, 1);
  set_u32(out, vector + 4, extension - (vector + 4));
  set_u16(out, extension_vtable, 8);
  set_u16(out, extension_vtable + 2, 9);
  set_u16(out, extension_vtable + 4, 4);
  set_u16(out, extension_vtable + 6, 8);
  set_u32(out, extension, extension - extension_vtable);
  set_u32(out, extension + 4, id);
  out[extension + 8] = critical ? 1 : 0;
  // Old positions move by `inserted`, a multiple of every alignment.
  out.insert(out.end(), b.begin(), b.end());
  b = std::move(out);
}

void share_metadata(Bytes& b) {
  const size_t root = u32(b, 0);
  const size_t first = follow(b, element(b, root, kHeaderMetadata, 0));
  const size_t count = u32(b, follow(b, field(b, root, kHeaderMetadata)));
  for (size_t i = 1; i < count; ++i) {
    const size_t at = element(b, root, kHeaderMetadata, i);
    if (first <= at) throw std::runtime_error("the first entry lies before the list");
    set_u32(b, at, first - at);
  }
}

void repeat_component(Bytes& b, size_t block) {
  constexpr size_t kBlocks = 3, kTables = 0, kComponent = 0;
  const size_t table = follow(b, element(b, u32(b, 0), kBlocks, block));
  const size_t first = follow(b, element(b, table, kTables, 0));
  const size_t second = follow(b, element(b, table, kTables, 1));
  b[field(b, second, kComponent)] = b[field(b, first, kComponent)];
}

size_t root_vtable(const Bytes& b) { return vtable_of(b, u32(b, 0)); }

size_t opacity_vtable(const Bytes& b) {
  return vtable_of(b, follow(b, field(b, u32(b, 0), kHeaderOpacity)));
}

}  // namespace l4d::test
