// SPDX-License-Identifier: Apache-2.0
// members.hpp: members.h for C++17. Functions that can fail throw l4d::Error.
#ifndef L4D_MEMBERS_HPP
#define L4D_MEMBERS_HPP

#include <vector>

#include "l4d/decode.hpp"
#include "l4d/members.h"

namespace l4d {

class MembersHandle : public Handle<l4d_members, l4d_members_destroy> {
 public:
  // Calls `reader`, of which it keeps a copy, for as long as it lives. options may be null.
  explicit MembersHandle(const l4d_reader& reader, const l4d_members_options* options = nullptr)
      : Handle([&](l4d_members** out) { return l4d_members_open(&reader, options, out); }) {}

  l4d_members_info info() const {
    return detail::filled<l4d_members_info>(
        [&](l4d_members_info* i) { return l4d_members_get_info(get(), i); });
  }
  l4d_member member(uint64_t index) const {
    return detail::filled<l4d_member>(
        [&](l4d_member* m) { return l4d_members_get(get(), index, m); });
  }
  // Numbers of standing members.
  std::vector<uint32_t> needs(uint64_t index) const {
    return detail::listed<uint32_t>([&](uint32_t* out, uint64_t n, uint64_t* count) {
      return l4d_members_get_needs(get(), index, out, n, count);
    });
  }
  // Indices of the members that show a time.
  std::vector<uint32_t> shown(double time) const {
    return detail::listed<uint32_t>([&](uint32_t* out, uint64_t n, uint64_t* count) {
      return l4d_members_get_shown(get(), time, out, n, count);
    });
  }
  // Valid as long as this handle.
  l4d_reader reader(uint64_t index) const {
    return detail::filled<l4d_reader>(
        [&](l4d_reader* r) { return l4d_members_get_reader(get(), index, r); });
  }
};

// Several streams as one. sh_degree: the highest of them.
inline SplatArrays slice_streams(ArrayView<const l4d_shown_stream> streams, uint32_t sh_degree,
                                 const SliceOptions& options = {}) {
  return splats_of(sh_degree, options, [&](l4d_splat_buffers* b) {
    require_ok(l4d_slice_streams(streams.data(), streams.size(), b));
  });
}

}  // namespace l4d
#endif  // L4D_MEMBERS_HPP
