// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "decoder/copy/copy_stream.h"
#include "decoder/read/member_list.h"
#include "l4d/members.h"
#include "libl4dcodec/base/first_versions.h"

using l4d::ListedMember;
using l4d::MemberRole;
using l4d::Status;
using l4d::api::guard;
using l4d::api::init_struct;
using l4d::api::keep_last;
using l4d::api::optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

namespace {

constexpr uint64_t kDefaultMemory = uint64_t{16} << 30;

l4d_members_options default_members_options() {
  l4d_members_options o{};
  o.struct_size = sizeof o;
  return o;
}

l4d_member_parameters default_parameters() {
  l4d_member_parameters p{};
  p.struct_size = sizeof p;
  p.max_level = p.max_tier = UINT32_MAX;
  return p;
}

}  // namespace

struct l4d_members {
  l4d_reader reader{};
  l4d::ByteSource source;
  l4d::MemoryBudget memory;
  l4d::MemberList list{source, memory};
  std::string rest;
  std::vector<std::unique_ptr<l4d::MemberReader>> readers;  // of members, made on first use
};

namespace {

// Runs the body of a call on a list, if its pointers are as it needs them.
template <typename Body>
l4d_status with_members(const l4d_members* members, const char* bad, const Body& body) {
  return keep_last(guard([&]() -> Status {
    if (members == nullptr) return l4d::invalid_argument("a required pointer is NULL");
    if (bad != nullptr) return l4d::invalid_argument(bad);
    return body(members->list);
  }));
}

Status find_member(const l4d::MemberList& list, uint64_t index, const ListedMember** out) {
  if (index >= list.members().size()) {
    return l4d::invalid_argument("the file has " + std::to_string(list.members().size()) +
                                 " members");
  }
  *out = &list.members()[static_cast<size_t>(index)];
  return {};
}

// The media member of a time, null if there is none: the last one that begins by then, or the one
// after it if that is nearer.
const ListedMember* media_at(const l4d::MemberList& list, double time) {
  const ListedMember* before = nullptr;
  for (const ListedMember& m : list.members()) {
    if (!m.is(MemberRole::kMedia)) continue;
    if (m.begin > time) {
      return before == nullptr || (time >= before->end && m.begin - time < time - before->end)
                 ? &m
                 : before;
    }
    before = &m;
  }
  return before;
}

Status find_shown(const l4d::MemberList& list, double time, std::vector<uint32_t>* out) {
  const ListedMember* media = media_at(list, time);
  if (media == nullptr) return {};
  const std::vector<ListedMember>& members = list.members();
  out->push_back(static_cast<uint32_t>(media - members.data()));
  for (uint32_t k = 0; k < media->num_needs; ++k) {
    const uint32_t number = list.needs()[media->first_need + k];
    const auto it =
        std::lower_bound(members.begin(), members.end(), number,
                         [](const ListedMember& m, uint32_t n) { return m.number < n; });
    if (it == members.end() || it->number != number) {
      return Status(L4D_ERR_TRUNCATED, "MEMB-7", media->offset,
                    "member " + std::to_string(media->number) + " needs member " +
                        std::to_string(number) + ", which is not in this file");
    }
    out->push_back(static_cast<uint32_t>(it - members.begin()));
  }
  return {};
}

template <typename T>
void copy_out(const std::vector<T>& from, T* out, uint64_t capacity, uint64_t* count) {
  std::copy_n(from.begin(), std::min<uint64_t>(capacity, from.size()), out);
  *count = from.size();
}

// An array of `capacity` elements that may be NULL if that is 0, and where their number goes.
const char* bad_output(const void* out, uint64_t capacity, const uint64_t* count) {
  const bool lacks = count == nullptr || (capacity > 0 && out == nullptr);
  return lacks ? "a required pointer is NULL" : nullptr;
}

Status to_request(const l4d_member_parameters& p, l4d::CopyRequest* out) {
  out->is_member = p.is_member != 0;
  out->member.stream = p.stream;
  out->member.number = p.number;
  out->member.role = p.role;
  out->member.shift = p.shift;
  if (p.num_needs > 0 && p.needs == nullptr) return l4d::invalid_argument("needs is NULL");
  if (p.role > L4D_MEMBER_STANDING) return l4d::invalid_argument("role is MEDIA or STANDING");
  out->member.needs.assign(p.needs, p.needs + p.num_needs);
  out->has_edit = p.has_edit != 0;
  out->edit = {p.edit_begin, p.edit_end};
  out->max_level = p.max_level;
  out->max_tier = p.max_tier;
  return {};
}

l4d::WriteFn writer_of(const l4d_writer& writer) {
  return [writer](l4d::ByteSpan bytes) -> Status {
    if (writer.write(writer.user, bytes.data(), bytes.size()) == 0) return {};
    return Status(L4D_ERR_IO, "the writer failed");
  };
}

}  // namespace

extern "C" {

void l4d_member_init_(l4d_member* member, size_t struct_size) {
  init_struct(member, struct_size, l4d_member{});
}
void l4d_members_options_init_(l4d_members_options* options, size_t struct_size) {
  init_struct(options, struct_size, default_members_options());
}
void l4d_members_info_init_(l4d_members_info* info, size_t struct_size) {
  init_struct(info, struct_size, l4d_members_info{});
}
void l4d_member_parameters_init_(l4d_member_parameters* parameters, size_t struct_size) {
  init_struct(parameters, struct_size, default_parameters());
}

l4d_status l4d_members_open(const l4d_reader* reader, const l4d_members_options* options,
                            l4d_members** out) {
  return keep_last(guard([&]() -> Status {
    const char* bad = required(reader);
    if (bad == nullptr) bad = optional(options);
    if (bad == nullptr) bad = required(out);
    if (bad != nullptr) return l4d::invalid_argument(bad);
    const l4d_members_options o = options == nullptr
                                      ? default_members_options()
                                      : read_struct(*options, default_members_options());
    auto made = std::make_unique<l4d_members>();
    made->reader = read_struct(*reader, l4d_reader{});
    made->memory.set_limit(o.max_memory_bytes > 0 ? o.max_memory_bytes : kDefaultMemory);
    L4D_RETURN_IF_ERROR(l4d::ByteSource::from_reader(made->reader, &made->source));
    L4D_RETURN_IF_ERROR(o.ignore_index != 0 ? made->list.walk() : made->list.read());
    if (!made->list.rest().ok()) made->rest = made->list.rest().detail();
    made->readers.resize(made->list.members().size());
    *out = made.release();
    return {};
  }));
}

void l4d_members_destroy(l4d_members* members) { delete members; }

l4d_status l4d_members_get_info(const l4d_members* members, l4d_members_info* info) {
  return with_members(members, required(info), [&](const l4d::MemberList& list) -> Status {
    l4d_members_info i{};
    i.count = list.members().size();
    i.bytes = list.end();
    i.stream = list.stream();
    i.from_index = list.is_from_index();
    i.rest = list.rest().code();
    write_struct(i, info);
    return {};
  });
}

const char* l4d_members_rest_message(const l4d_members* members) {
  return members == nullptr ? "" : members->rest.c_str();
}

l4d_status l4d_members_get(const l4d_members* members, uint64_t index, l4d_member* out) {
  return with_members(members, required(out), [&](const l4d::MemberList& list) -> Status {
    const ListedMember* m = nullptr;
    L4D_RETURN_IF_ERROR(find_member(list, index, &m));
    l4d_member found{};
    found.offset = m->offset;
    found.bytes = m->bytes;
    found.header_hash = m->header_hash;
    found.begin = m->begin;
    found.end = m->end;
    found.shift = m->shift;
    found.number = m->number;
    found.role = m->role;
    found.num_needs = m->num_needs;
    found.sequence_begin = m->sequence_begin;
    found.sequence_end = m->sequence_end;
    write_struct(found, out);
    return {};
  });
}

l4d_status l4d_members_get_needs(const l4d_members* members, uint64_t index, uint32_t* numbers,
                                 uint64_t capacity, uint64_t* count) {
  const char* bad = bad_output(numbers, capacity, count);
  return with_members(members, bad, [&](const l4d::MemberList& list) -> Status {
    const ListedMember* m = nullptr;
    L4D_RETURN_IF_ERROR(find_member(list, index, &m));
    const auto first = list.needs().begin() + static_cast<std::ptrdiff_t>(m->first_need);
    copy_out(std::vector<uint32_t>(first, first + m->num_needs), numbers, capacity, count);
    return {};
  });
}

l4d_status l4d_members_get_shown(const l4d_members* members, double time, uint32_t* indices,
                                 uint64_t capacity, uint64_t* count) {
  const char* bad = bad_output(indices, capacity, count);
  return with_members(members, bad, [&](const l4d::MemberList& list) -> Status {
    if (!std::isfinite(time)) return l4d::invalid_argument("time is finite");
    std::vector<uint32_t> shown;
    L4D_RETURN_IF_ERROR(find_shown(list, time, &shown));
    copy_out(shown, indices, capacity, count);
    return {};
  });
}

l4d_status l4d_members_get_reader(l4d_members* members, uint64_t index, l4d_reader* out) {
  return with_members(members, required(out), [&](const l4d::MemberList& list) -> Status {
    const ListedMember* m = nullptr;
    L4D_RETURN_IF_ERROR(find_member(list, index, &m));
    std::unique_ptr<l4d::MemberReader>& reader = members->readers[static_cast<size_t>(index)];
    if (reader == nullptr) {
      if (list.is_from_index()) L4D_RETURN_IF_ERROR(members->list.check_header(*m));
      reader = std::make_unique<l4d::MemberReader>(members->reader, m->offset, m->bytes);
    }
    write_struct(reader->reader(), out);
    return {};
  });
}

l4d_status l4d_copy_member(const l4d_reader* stream, const l4d_decoder_options* options,
                           const l4d_member_parameters* parameters, const l4d_writer* writer,
                           uint64_t* bytes) {
  return keep_last(guard([&]() -> Status {
    const char* bad = required(stream, parameters, writer);
    if (bad == nullptr) bad = optional(options);
    if (bad != nullptr) return l4d::invalid_argument(bad);
    if (writer->write == nullptr) return l4d::invalid_argument("the writer lacks a callback");
    l4d_decoder_options limits{};
    if (options != nullptr) limits = read_struct(*options, limits);
    l4d::CopyRequest request;
    L4D_RETURN_IF_ERROR(to_request(read_struct(*parameters, default_parameters()), &request));
    uint64_t written = 0;
    L4D_RETURN_IF_ERROR(l4d::copy_stream(read_struct(*stream, l4d_reader{}), limits, request,
                                         writer_of(*writer), &written));
    if (bytes != nullptr) *bytes = written;
    return {};
  }));
}

l4d_status l4d_write_member_index(const l4d_members* members, const l4d_writer* writer,
                                  uint64_t* bytes) {
  return with_members(members, required(writer), [&](const l4d::MemberList& list) -> Status {
    if (writer->write == nullptr) return l4d::invalid_argument("the writer lacks a callback");
    l4d::Bytes index;
    L4D_RETURN_IF_ERROR(l4d::make_index(list, &index));
    L4D_RETURN_IF_ERROR(writer_of(*writer)(index));
    if (bytes != nullptr) *bytes = index.size();
    return {};
  });
}

}  // extern "C"
