// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/flat_check.h"

#include <algorithm>

namespace l4d {
namespace {

using flatbuffers::ElementaryType;
using flatbuffers::TypeTable;

constexpr size_t kOffsetBytes = sizeof(flatbuffers::uoffset_t);

class TableCheck {
 public:
  explicit TableCheck(ByteSpan bytes) : begin_(bytes.data()), end_(bytes.data() + bytes.size()) {}

  bool table(const uint8_t* at, const TypeTable* type) const {
    const uint8_t* vtable = at - flatbuffers::ReadScalar<flatbuffers::soffset_t>(at);
    const size_t vtable_bytes = number_at(vtable);
    if (vtable_bytes < 4) return false;
    const size_t table_bytes = number_at(vtable + 2);
    if (table_bytes < kOffsetBytes || table_bytes > static_cast<size_t>(end_ - at)) return false;
    for (size_t i = 0; 4 + 2 * i < vtable_bytes; ++i) {
      const size_t offset = number_at(vtable + 4 + 2 * i);
      if (offset == 0) continue;
      if (offset < kOffsetBytes || offset >= table_bytes) return false;
      // Of a field that this version does not know, nothing else is known.
      if (i < type->num_elems && !field(at + offset, table_bytes - offset, type, i)) return false;
    }
    return true;
  }

 private:
  static size_t number_at(const uint8_t* at) {
    return flatbuffers::ReadScalar<flatbuffers::voffset_t>(at);
  }
  bool aligned(const uint8_t* at, size_t bytes) const {
    return static_cast<size_t>(at - begin_) % bytes == 0;
  }
  static const TypeTable* type_of(const TypeTable* type, size_t i) {
    const int ref = type->type_codes[i].sequence_ref;
    return ref < 0 ? nullptr : type->type_refs[ref]();
  }
  static size_t alignment(ElementaryType kind, const TypeTable* of) {
    if (of == nullptr || of->st != flatbuffers::ST_STRUCT) {
      return flatbuffers::InlineSize(kind, of);
    }
    size_t most = 1;
    for (size_t i = 0; i < of->num_elems; ++i) {
      const auto member = static_cast<ElementaryType>(of->type_codes[i].base_type);
      most = std::max(most, alignment(member, type_of(of, i)));
    }
    return most;
  }

  // Field i of a table, of which `room` bytes are left from the field on.
  bool field(const uint8_t* at, size_t room, const TypeTable* type, size_t i) const {
    const flatbuffers::TypeCode code = type->type_codes[i];
    const auto kind = static_cast<ElementaryType>(code.base_type);
    const TypeTable* const of = type_of(type, i);
    const bool is_table = of != nullptr && of->st == flatbuffers::ST_TABLE;
    const bool is_offset = code.is_repeating != 0 || is_table || kind == flatbuffers::ET_STRING;
    if (!is_offset) {
      return flatbuffers::InlineSize(kind, of) <= room && aligned(at, alignment(kind, of));
    }
    if (kOffsetBytes > room || !aligned(at, kOffsetBytes)) return false;
    const uint8_t* const target = at + flatbuffers::ReadScalar<flatbuffers::uoffset_t>(at);
    if (code.is_repeating == 0) return !is_table || table(target, of);
    const size_t n = flatbuffers::ReadScalar<flatbuffers::uoffset_t>(target);
    const uint8_t* element = target + kOffsetBytes;
    if (!is_table) return n == 0 || aligned(element, alignment(kind, of));
    for (size_t k = 0; k < n; ++k, element += kOffsetBytes) {
      if (!table(element + flatbuffers::ReadScalar<flatbuffers::uoffset_t>(element), of)) {
        return false;
      }
    }
    return true;
  }

  const uint8_t* begin_;
  const uint8_t* end_;
};

}  // namespace

bool tables_are_whole(ByteSpan bytes, const TypeTable* root) {
  return TableCheck(bytes).table(
      bytes.data() + flatbuffers::ReadScalar<flatbuffers::uoffset_t>(bytes.data()), root);
}

}  // namespace l4d
