// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <memory>

#include "api/encoder_handle.h"
#include "encoder/session/session.h"
#include "l4d/experimental/session.h"
#include "libl4dcodec/base/first_versions.h"

using l4d::Status;
using l4d::api::call_on;
using l4d::api::optional;
using l4d::api::read_optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

namespace l4d::api {

L4D_FIRST_VERSION(l4d_session_options, standing_segments);

}  // namespace l4d::api

struct l4d_session {
  l4d_session(l4d_encoder* e, const l4d::SessionOptions& options) : encoder(e), impl(options) {}
  l4d_encoder* encoder;
  l4d::Session impl;
};

namespace {

Status check(const l4d_session_options& options) {
  if (!(options.segment_seconds >= 0 && std::isfinite(options.segment_seconds))) {
    return l4d::invalid_argument("segment_seconds must be at least 0 and finite");
  }
  if (options.has_end > 1) return l4d::invalid_argument("has_end is 0 or 1");
  if (options.has_end != 0 && std::isnan(options.end))
    return l4d::invalid_argument("end is not a number");
  return {};
}

}  // namespace

extern "C" {

l4d_status l4d_session_create(l4d_encoder* encoder, const l4d_session_options* options,
                              l4d_session** out) {
  const char* bad = required(out);
  if (bad == nullptr) bad = optional(options);
  return call_on(encoder, bad, [&]() -> Status {
    const l4d_session_options given = read_optional(options);
    L4D_RETURN_IF_ERROR(check(given));
    l4d::SessionOptions o;
    if (given.segment_seconds > 0) o.segment = given.segment_seconds;
    if (given.has_end != 0) o.end = given.end;
    o.stream = given.stream;
    o.max_memory_bytes = given.max_memory_bytes == 0 ? UINT64_MAX : given.max_memory_bytes;
    if (given.standing_segments > 0) o.standing_segments = given.standing_segments;
    *out = std::make_unique<l4d_session>(encoder, o).release();
    return {};
  });
}

void l4d_session_destroy(l4d_session* session) { delete session; }

l4d_status l4d_session_add(l4d_session* session) {
  return call_on(session == nullptr ? nullptr : session->encoder, nullptr,
                 [&] { return session->impl.add(session->encoder->impl); });
}

l4d_status l4d_session_add_empty(l4d_session* session, const l4d_timeline* timeline,
                                 const l4d_placement* placement) {
  return call_on(session == nullptr ? nullptr : session->encoder, required(timeline), [&] {
    constexpr l4d_placement kIdentity{{0, 0, 0}, 1, L4D_COORDINATES_UNKNOWN, L4D_COLOR_SRGB};
    return session->impl.add_empty(session->encoder->impl, *timeline,
                                   placement == nullptr ? kIdentity : *placement);
  });
}

l4d_status l4d_session_encode(l4d_session* session, const l4d_writer* writer, l4d_member* member) {
  return call_on(session == nullptr ? nullptr : session->encoder, required(writer, member),
                 [&]() -> Status {
                   const l4d_writer w = read_struct(*writer);
                   if (w.write == nullptr) {
                     return l4d::invalid_argument("the writer lacks its callback");
                   }
                   const auto write = [&](l4d::ByteSpan bytes) -> Status {
                     if (w.write(w.user, bytes.data(), bytes.size()) == 0) return {};
                     return Status(L4D_ERR_IO, "the writer failed");
                   };
                   l4d::ListedMember made;
                   L4D_RETURN_IF_ERROR(session->impl.next(session->encoder->impl, write, &made));
                   l4d_member found{};
                   found.offset = made.offset;
                   found.bytes = made.bytes;
                   found.header_hash = made.header_hash;
                   found.begin = found.sequence_begin = made.begin;
                   found.end = found.sequence_end = made.end;
                   found.number = made.number;
                   found.role = made.role;
                   found.num_needs = made.num_needs;
                   write_struct(found, member);
                   return {};
                 });
}

}  // extern "C"
