// SPDX-License-Identifier: Apache-2.0
#include "tests/hostile/flat_slots.h"

#include "l4d_generated.h"
#include "libl4dcodec/container/flat_check.h"

namespace l4d::test {
namespace {

// Widths of the numbers of a table's fields, in the order of the schema. Offsets count as numbers.
constexpr const char* kChunkRef = "884444";
constexpr const char* kPageRecord = "88884444441111222222";
constexpr const char* kHeader[] = {"8", "8", "4", "4", "4",   "4", "888", "8", "1",
                                   "1", "1", "1", "1", "444", "4", "4",   "1", "4",
                                   "4", "8", "4", "4", "1",   "1", "1",   "1"};
constexpr const char* kLayer[] = {"1", "1", "8", "1", "4", "4",      "4",
                                  "4", "4", "1", "8", "1", kChunkRef};
constexpr const char* kScalarCoding[] = {"1", "1", "4", "4"};
constexpr const char* kStage[] = {"4", "1", kChunkRef};
constexpr const char* kComponentCoding[] = {"1", "4", "1", "4", "4", "4", "4"};
constexpr const char* kKeyValue[] = {"4", "4"};
constexpr const char* kExtension[] = {"4", "1", kChunkRef};
constexpr const char* kDirectoryPage[] = {"4", "4", "4", "4"};
constexpr const char* kBlock[] = {"4"};
constexpr const char* kRcqTable[] = {"1", "4", kChunkRef};

class Collector {
 public:
  explicit Collector(const Bytes& bytes) : bytes_(bytes) { add(0, 4); }

  // The table's own fields and its vtable.
  template <typename Table, size_t kFields>
  void table(const Table* t, const char* const (&fields)[kFields]) {
    const auto* raw = reinterpret_cast<const flatbuffers::Table*>(t);
    add(offset_of(t), 4);
    const size_t vtable = offset_of(raw->GetVTable());
    add(vtable, 2);
    add(vtable + 2, 2);
    for (size_t f = 0; f < kFields; ++f) {
      const auto entry = static_cast<flatbuffers::voffset_t>(4 + 2 * f);
      const uint8_t* at = raw->GetAddressOf(entry);
      if (at == nullptr) continue;
      add(vtable + entry, 2);
      numbers(offset_of(at), fields[f]);
    }
  }
  // A vector of tables: its length, its offsets, and `each` of them.
  template <typename Vector, typename Each>
  void tables(const Vector* v, const Each& each) {
    if (v == nullptr) return;
    length(v);
    for (flatbuffers::uoffset_t i = 0; i < v->size(); ++i) {
      add(offset_of(v) + 4 + 4 * i, 4);
      each(v->Get(i));
    }
  }
  void length(const void* vector) { add(offset_of(vector), 4); }
  void numbers(size_t at, const char* widths) {
    for (; *widths != 0; ++widths) {
      const auto width = static_cast<unsigned>(*widths - '0');
      add(at, width);
      at += width;
    }
  }
  size_t offset_of(const void* p) const {
    return static_cast<size_t>(static_cast<const unsigned char*>(p) - bytes_.data());
  }

  std::vector<FlatSlot> slots;

 private:
  // The verifier looks at no field that this schema does not read: such a one may lie anywhere.
  void add(size_t at, unsigned width) {
    if (at <= bytes_.size() && width <= bytes_.size() - at) slots.push_back({at, width});
  }

  const Bytes& bytes_;
};

void add_component(Collector& c, const fbs::ComponentCoding* coding) {
  c.table(coding, kComponentCoding);
  c.tables(coding->stages(), [&](const fbs::Stage* s) { c.table(s, kStage); });
  if (coding->rcq() != nullptr) c.table(coding->rcq(), kStage);
  if (coding->basis() != nullptr) c.table(coding->basis(), kStage);
}

}  // namespace

std::vector<FlatSlot> scene_header_slots(const Bytes& bytes) {
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), 16, 100000);
  if (!verifier.VerifyBuffer<fbs::Header>("L4DH") ||
      !tables_are_whole(bytes, fbs::HeaderTypeTable())) {
    return {};
  }
  const fbs::Header* h = flatbuffers::GetRoot<fbs::Header>(bytes.data());
  Collector c(bytes);
  c.table(h, kHeader);
  c.table(h->opacity(), kScalarCoding);
  add_component(c, h->sh());
  c.tables(h->layers(), [&](const fbs::Layer* l) {
    c.table(l, kLayer);
    c.table(l->scale_factor(), kScalarCoding);
    add_component(c, l->scale());
    add_component(c, l->rotor_spatial());
    add_component(c, l->rotor_temporal());
  });
  c.tables(h->metadata(), [&](const fbs::KeyValue* kv) {
    c.table(kv, kKeyValue);
    c.length(kv->key());
    c.length(kv->value());
  });
  c.tables(h->extensions(), [&](const fbs::Extension* e) { c.table(e, kExtension); });
  return c.slots;
}

std::vector<FlatSlot> directory_page_slots(const Bytes& bytes) {
  flatbuffers::Verifier verifier(bytes.data(), bytes.size(), 16, 2048);
  if (!verifier.VerifyBuffer<fbs::DirectoryPage>("L4DD") ||
      !tables_are_whole(bytes, fbs::DirectoryPageTypeTable())) {
    return {};
  }
  const fbs::DirectoryPage* page = flatbuffers::GetRoot<fbs::DirectoryPage>(bytes.data());
  Collector c(bytes);
  c.table(page, kDirectoryPage);
  c.length(page->pages());
  for (const fbs::PageRecord* p : *page->pages()) c.numbers(c.offset_of(p), kPageRecord);
  c.tables(page->blocks(), [&](const fbs::Block* block) {
    c.table(block, kBlock);
    c.tables(block->tables(), [&](const fbs::RcqTable* t) { c.table(t, kRcqTable); });
  });
  return c.slots;
}

}  // namespace l4d::test
