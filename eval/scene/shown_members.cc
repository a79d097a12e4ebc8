// SPDX-License-Identifier: Apache-2.0
#include "eval/scene/shown_members.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "eval/errors.h"
#include "eval/scene/decoded_scene.h"
#include "io/scene/scene.h"

namespace l4d::eval {
namespace {

void add_counters(const DecoderHandle& decoder, l4d_counters* sums) {
  const l4d_counters c = decoder.counters();
  sums->buckets_decoded += c.buckets_decoded;
  sums->cache_hits += c.cache_hits;
}

// Of bytes that are wrong, so that other members may be right.
bool is_damage(l4d_status status) {
  return status == L4D_ERR_TRUNCATED || status == L4D_ERR_CORRUPT || status == L4D_ERR_CHECKSUM ||
         status == L4D_ERR_NOT_L4D;
}

MembersHandle list_of(const l4d_reader& reader, const l4d_decoder_options& decoding) {
  l4d_members_options options = L4D_INIT(l4d_members_options);
  options.max_memory_bytes = decoding.max_memory_bytes;
  return MembersHandle(reader, &options);
}

}  // namespace

template <typename Body>
auto ShownMembers::of_member(uint32_t index, const Body& body) const {
  try {
    return body();
  } catch (const Error& error) {
    const l4d_member m = list_.member(index);
    throw Error(error.status(), "member " + std::to_string(m.number) + ", which begins at byte " +
                                    std::to_string(m.offset) + ": " + detail_of(error));
  }
}

ShownMembers::ShownMembers(const l4d_reader& reader, const l4d_decoder_options& options)
    : options_(options), list_(list_of(reader, options)) {
  const uint64_t count = list_.info().count;
  uint32_t most = 0;
  double begin = 0, end = 0;
  bool any = false;
  for (uint64_t i = 0; i < count; ++i) {
    const l4d_member m = list_.member(i);
    if (m.role != L4D_MEMBER_MEDIA) continue;
    most = std::max(most, m.num_needs);
    if (!any) begin = m.begin;
    end = m.end;
    any = true;
  }
  if (!any) throw Error(L4D_ERR_CORRUPT, "the file has no media member");
  options_.accept_needs = 1;
  if (options_.max_memory_bytes > 0) {
    options_.max_memory_bytes = std::max<uint64_t>(1, options_.max_memory_bytes / (1 + most));
  }
  choose_first(count);
  timeline_ = timeline_between(first().info().timeline, begin, end);
}

DecoderHandle& ShownMembers::open(uint32_t index) {
  const auto known = open_.find(index);
  if (known != open_.end()) return known->second;
  DecoderHandle decoder(&options_);
  of_member(index, [&] { decoder.open(list_.reader(index)); });
  return open_.emplace(index, std::move(decoder)).first->second;
}

// The first media member that opens. Throws what is wrong with the first one if none does.
void ShownMembers::choose_first(uint64_t count) {
  std::optional<Error> why;
  for (uint64_t i = 0; i < count; ++i) {
    if (list_.member(i).role != L4D_MEMBER_MEDIA) continue;
    first_ = static_cast<uint32_t>(i);
    try {
      open(first_);
      return;
    } catch (const Error& error) {
      if (!is_damage(error.status())) throw;
      if (!why) why = error;
    }
  }
  throw Error(*why);
}

const DecoderHandle& ShownMembers::first() { return open(first_); }

uint64_t ShownMembers::num_gaussians() {
  uint64_t count = 0;
  for (uint64_t i = 0; i < list_.info().count; ++i) {
    if (list_.member(i).role == L4D_MEMBER_INDEX) continue;
    try {
      count += open(static_cast<uint32_t>(i)).info().num_gaussians;
    } catch (const Error& error) {
      if (!is_damage(error.status())) throw;
    }
    shown_indices_ = {first_};
    close_others();
  }
  return count;
}

const std::vector<ShownMembers::Shown>& ShownMembers::show(double seconds) {
  shown_indices_ = list_.shown(seconds);
  shown_.clear();
  time_ = seconds;
  if (!shown_indices_.empty()) {
    // Between spans nothing is known but what is seen at their ends.
    const l4d_member media = list_.member(shown_indices_.front());
    time_ = std::clamp(seconds, media.begin, media.end);
  }
  for (const uint32_t index : shown_indices_) {
    const l4d_member m = list_.member(index);
    try {
      shown_.push_back({&open(index), index, m.shift, time_ - m.shift, m.offset});
    } catch (const Error& error) {
      if (options_.tolerant == 0 || !is_damage(error.status())) throw;
      left_out_.emplace(index, detail_of(error));
    }
  }
  return shown_;
}

void ShownMembers::close_others() {
  for (auto it = open_.begin(); it != open_.end();) {
    const bool used =
        std::find(shown_indices_.begin(), shown_indices_.end(), it->first) != shown_indices_.end();
    if (!used) add_counters(it->second, &closed_);
    it = used ? std::next(it) : open_.erase(it);
  }
}

l4d_counters ShownMembers::counters() const {
  l4d_counters sums = closed_;
  for (const auto& [index, decoder] : open_) add_counters(decoder, &sums);
  return sums;
}

SplatArrays ShownMembers::slice(double seconds, const l4d_operating_point& point) {
  show(seconds);
  std::vector<l4d_shown_stream> streams;
  uint32_t degree = 0;
  for (const Shown& s : shown_) {
    streams.push_back({s.decoder->get(), s.time});
    degree = std::max(degree, s.decoder->info().sh_degree);
  }
  if (streams.empty()) return {};
  SliceOptions options;
  options.point = point;
  return splats_of(degree, options, [&](l4d_splat_buffers* b) {
    const l4d_status status = l4d_slice_streams(streams.data(), streams.size(), b);
    if (status == L4D_OK) return;
    const Error reason(status, l4d_last_error_message());
    // Which of them it was: its own slice fails, too.
    for (const Shown& s : shown_) of_member(s.index, [&] { s.decoder->slice(s.time, options); });
    throw reason;
  });
}

uint64_t ShownMembers::slice_bytes(double seconds) {
  uint64_t bytes = 0;
  uint32_t degree = 0;
  for (const Shown& s : show(seconds)) degree = std::max(degree, s.decoder->info().sh_degree);
  for (const Shown& s : shown_) {
    of_member(s.index, [&] { bytes += eval::slice_bytes(*s.decoder, s.time, degree); });
  }
  return bytes;
}

}  // namespace l4d::eval
