// SPDX-License-Identifier: Apache-2.0
// Files of several streams: the list of the index and that of the headers, what shows an instant,
// and copies of members, which are valid wherever the member was.
#include <algorithm>
#include <cstdlib>
#include <vector>

#include "l4d/experimental/copy.h"
#include "l4d/members.h"
#include "tests/fuzz/stream_mutator.h"
#include "tests/hostile/session.h"

namespace {

using l4d::Bytes;

void require(bool holds) {
  if (!holds) std::abort();
}

int64_t read_at(void* user, void* dst, size_t n, uint64_t offset) {
  const auto& file = *static_cast<const Bytes*>(user);
  require(offset <= file.size() && n <= file.size() - offset);
  std::copy_n(file.data() + offset, n, static_cast<unsigned char*>(dst));
  return static_cast<int64_t>(n);
}
int64_t size_of(void* user) {
  return static_cast<int64_t>(static_cast<const Bytes*>(user)->size());
}

l4d_reader reader_of(const Bytes& file) {
  l4d_reader reader = L4D_INIT(l4d_reader);
  reader.user = const_cast<Bytes*>(&file);
  reader.read_at = read_at;
  reader.size = size_of;
  return reader;
}

int append(void* user, const void* src, size_t n) {
  const auto* bytes = static_cast<const unsigned char*>(src);
  auto& to = *static_cast<Bytes*>(user);
  to.insert(to.end(), bytes, bytes + n);
  return 0;
}
l4d_writer writer_to(Bytes* out) {
  l4d_writer writer = L4D_INIT(l4d_writer);
  writer.user = out;
  writer.write = append;
  return writer;
}

// Members lie one behind the other, and what shows an instant is in the list.
std::vector<l4d_member> call_on(const l4d_members* members, const Bytes& file) {
  l4d_members_info info = L4D_INIT(l4d_members_info);
  require(l4d_members_get_info(members, &info) == L4D_OK);
  require(info.count > 0 && info.bytes <= file.size());
  std::vector<l4d_member> out(static_cast<size_t>(info.count));
  uint64_t end = 0;
  for (uint64_t i = 0; i < info.count; ++i) {
    l4d_member& m = out[static_cast<size_t>(i)];
    m = L4D_INIT(l4d_member);
    require(l4d_members_get(members, i, &m) == L4D_OK);
    require(m.offset == end && m.bytes >= 40 && m.bytes <= file.size() - m.offset);
    end = m.offset + m.bytes;
    uint32_t shown[4];
    uint64_t count = 0;
    const l4d_status status = l4d_members_get_shown(members, m.begin, shown, 4, &count);
    require(status == L4D_OK || status == L4D_ERR_TRUNCATED || status == L4D_ERR_INVALID_ARGUMENT);
    for (uint64_t k = 0; status == L4D_OK && k < std::min<uint64_t>(count, 4); ++k) {
      require(shown[k] < info.count);
    }
  }
  require(end == info.bytes);
  return out;
}

// What is left of a damaged member is no larger than a member may be, and opens.
void copy_tolerantly(const l4d_reader& part, size_t size) {
  l4d_decoder_options options = l4d::test::session_options();
  options.tolerant = 1;
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  Bytes out;
  const l4d_writer writer = writer_to(&out);
  const l4d_status status = l4d_copy_member(&part, &options, &p, &writer, nullptr);
  require(status != L4D_ERR_INTERNAL);
  if (status != L4D_OK) return;
  require(out.size() <= 4 * size + 65536);
  const l4d_reader made = reader_of(out);
  l4d_decoder* decoder = nullptr;
  require(l4d_decoder_create(&options, &decoder) == L4D_OK);
  require(l4d_decoder_open(decoder, &made) == L4D_OK);
  l4d_decoder_destroy(decoder);
}

// A copy of a member is a valid file where the member has no violation.
void copy(l4d_members* members, uint64_t index, const l4d_member& m) {
  const l4d_decoder_options options = l4d::test::session_options();
  l4d_reader part = L4D_INIT(l4d_reader);
  if (l4d_members_get_reader(members, index, &part) != L4D_OK) return;
  copy_tolerantly(part, static_cast<size_t>(m.bytes));
  uint64_t before = 0, after = 0;
  if (l4d_validate(&part, &options, nullptr, nullptr, &before) != L4D_OK) return;
  l4d_member_parameters p = L4D_INIT(l4d_member_parameters);
  p.has_edit = m.number & 1;
  p.edit_begin = m.begin - m.shift;
  p.edit_end = p.edit_begin + (m.end - m.begin) / 2;
  Bytes out;
  const l4d_writer writer = writer_to(&out);
  uint64_t bytes = 0;
  const l4d_status status = l4d_copy_member(&part, &options, &p, &writer, &bytes);
  require(status != L4D_ERR_INTERNAL);
  if (status != L4D_OK) return;
  require(bytes == out.size());
  const l4d_reader made = reader_of(out);
  const l4d_status checked = l4d_validate(&made, &options, nullptr, nullptr, &after);
  require(checked == L4D_OK || checked == L4D_ERR_LIMIT_EXCEEDED);
  require(before > 0 || checked != L4D_OK || after == 0);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const Bytes file(data, data + size);
  const l4d_reader reader = reader_of(file);
  l4d_members_options options = L4D_INIT(l4d_members_options);
  options.max_memory_bytes = l4d::test::session_options().max_memory_bytes;
  for (options.ignore_index = 0; options.ignore_index < 2; ++options.ignore_index) {
    l4d_members* members = nullptr;
    const l4d_status status = l4d_members_open(&reader, &options, &members);
    require(status != L4D_ERR_INTERNAL && status != L4D_ERR_INVALID_ARGUMENT);
    if (status != L4D_OK) continue;
    const std::vector<l4d_member> found = call_on(members, file);
    for (size_t i = 0; i < std::min<size_t>(found.size(), 4); ++i) copy(members, i, found[i]);
    Bytes index;
    const l4d_writer writer = writer_to(&index);
    require(l4d_write_member_index(members, &writer, nullptr) != L4D_ERR_INTERNAL);
    l4d_members_destroy(members);
  }
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  return l4d::fuzz::mutate_input(data, size, max_size, 0, seed);
}
