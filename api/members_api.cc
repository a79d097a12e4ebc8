// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "api/list_output.h"
#include "decoder/copy/copy_stream.h"
#include "decoder/read/member_list.h"
#include "l4d/experimental/copy.h"
#include "l4d/members.h"
#include "libl4dcodec/base/first_versions.h"

using l4d::ListedMember;
using l4d::MemberRole;
using l4d::Status;
using l4d::api::bad_output;
using l4d::api::copy_out;
using l4d::api::guard;
using l4d::api::keep_last;
using l4d::api::optional;
using l4d::api::read_optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

namespace {

constexpr uint64_t kDefaultMemory = uint64_t{16} << 30;

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
  out->levels = p.levels;
  out->tiers = p.tiers;
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

l4d_status l4d_members_open(const l4d_reader* reader, const l4d_members_options* options,
                            l4d_members** out) {
  return keep_last(guard([&]() -> Status {
    const char* bad = required(reader);
    if (bad == nullptr) bad = optional(options);
    if (bad == nullptr) bad = required(out);
    if (bad != nullptr) return l4d::invalid_argument(bad);
    const l4d_members_options o = read_optional(options);
    auto made = std::make_unique<l4d_members>();
    made->reader = read_struct(*reader);
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
    i.rest_message = members->rest.c_str();
    write_struct(i, info);
    return {};
  });
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
    L4D_RETURN_IF_ERROR(l4d::find_shown(list.members(), list.needs(), time, &shown));
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
    L4D_RETURN_IF_ERROR(to_request(read_struct(*parameters), &request));
    uint64_t written = 0;
    L4D_RETURN_IF_ERROR(
        l4d::copy_stream(read_struct(*stream), limits, request, writer_of(*writer), &written));
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
