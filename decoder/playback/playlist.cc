// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/playlist.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "decoder/playback/playlist_text.h"

namespace l4d::playback {
namespace {

constexpr size_t kMaxMembers = 200000, kMaxNeeds = 64, kMaxLineBytes = 8192;
constexpr uint64_t kMaxTargetDuration = 86400;
// Durations have six decimals: an end this close to the next begin is that begin.
constexpr double kRounding = 2e-6;

// Tags that change what a segment is.
constexpr const char* kRefused[] = {"EXT-X-KEY",  "EXT-X-MAP",        "EXT-X-GAP",
                                    "EXT-X-SKIP", "EXT-X-STREAM-INF", "EXT-X-PART"};

class Parser {
 public:
  explicit Parser(Playlist* out) : out_(*out) {}
  PlaylistError parse(Text text);

 private:
  // Each returns whether the line is right; else cause_ says why not.
  bool read_line(Text line);
  bool read_tag(Text name, Text value);
  bool add_standing(Text value);
  bool add_media(Text uri);
  bool add(const Attributes& attributes, Text uri, Member* member);
  bool add_needs(Text list, Member* member);
  bool fail(uint32_t cause = L4D_CAUSE_PLAYLIST) {
    if (cause_ == L4D_CAUSE_NONE) cause_ = cause;
    return false;
  }

  Playlist& out_;
  uint32_t line_ = 0, cause_ = L4D_CAUSE_NONE;
  size_t last_media_ = SIZE_MAX;
  // Of the segment whose URI is still to come.
  bool has_attributes_ = false, has_range_ = false;
  Attributes attributes_;
  double duration_ = 0;
  uint64_t offset_ = 0, bytes_ = 0;
};

bool Parser::add(const Attributes& attributes, Text uri, Member* member) {
  if (out_.members.size() >= kMaxMembers) return fail(L4D_CAUSE_LIMIT);
  uint64_t number = 0;
  if (!attributes.get("NUMBER").to_count(UINT32_MAX - 1, &number)) return fail();
  if (!out_.members.empty() && number <= out_.members.back().number) return fail();
  if (!attributes.get("BEGIN").to_seconds(&member->begin)) return fail();
  if (!attributes.get("SHIFT").to_seconds(&member->shift)) return fail();
  if (uri.empty()) return fail();
  member->number = static_cast<uint32_t>(number);
  // Most members lie in one file.
  if (out_.uris.empty() || !uri.is(out_.uris.back().c_str())) {
    out_.uris.emplace_back(uri.begin, uri.size());
  }
  member->uri = static_cast<uint32_t>(out_.uris.size() - 1);
  return true;
}

bool Parser::add_standing(Text value) {
  Attributes attributes;
  Member member;
  member.is_media = false;
  if (!attributes.parse(value) || !add(attributes, attributes.get("URI"), &member)) return fail();
  if (!attributes.get("BYTERANGE").to_range(&member.offset, &member.bytes)) return fail();
  if (!attributes.get("END").to_seconds(&member.end) || !(member.end > member.begin)) {
    return fail();
  }
  out_.members.push_back(member);
  return true;
}

bool Parser::add_needs(Text list, Member* member) {
  member->first_need = out_.needs.size();
  while (!list.empty()) {
    if (member->num_needs >= kMaxNeeds) return fail(L4D_CAUSE_LIMIT);
    uint64_t number = 0;
    const bool is_last = !list.contains(',');
    if (!list.cut(',').to_count(UINT32_MAX - 1, &number)) return fail();
    if (!is_last && list.empty()) return fail();  // a comma at the end
    if (member->num_needs > 0 && number <= out_.needs.back()) return fail();
    const Member* const standing = out_.find(static_cast<uint32_t>(number));
    if (number >= member->number || standing == nullptr || standing->is_media) return fail();
    out_.needs.push_back(static_cast<uint32_t>(number));
    ++member->num_needs;
  }
  return true;
}

bool Parser::add_media(Text uri) {
  if (!has_attributes_ || !(duration_ > 0)) return fail();
  Member member;
  if (!add(attributes_, uri, &member)) return false;
  member.offset = offset_;
  member.bytes = bytes_;
  member.end = member.begin + duration_;
  if (!(member.end > member.begin) || !add_needs(attributes_.get("NEEDS"), &member)) return fail();
  if (last_media_ != SIZE_MAX) {
    Member& before = out_.members[last_media_];
    if (std::fabs(member.begin - before.end) <= kRounding && member.begin > before.begin) {
      before.end = member.begin;
    }
    if (member.begin < before.end) return fail();
  }
  last_media_ = out_.members.size();
  out_.members.push_back(member);
  has_attributes_ = has_range_ = false;
  duration_ = 0;
  offset_ = bytes_ = 0;
  return true;
}

bool Parser::read_tag(Text name, Text value) {
  uint64_t count = 0;
  for (const char* refused : kRefused) {
    if (name.is(refused)) return fail(L4D_CAUSE_FEATURE);
  }
  if (name.is("EXT-X-L4D-STANDING")) return add_standing(value);
  if (name.is("EXT-X-L4D-MEMBER")) {
    has_attributes_ = attributes_.parse(value);
    return has_attributes_ || fail();
  }
  if (name.is("EXTINF")) return value.cut(',').to_seconds(&duration_) || fail();
  if (name.is("EXT-X-BYTERANGE")) {
    has_range_ = value.to_range(&offset_, &bytes_);
    return has_range_ || fail();
  }
  if (name.is("EXT-X-TARGETDURATION")) {
    if (!value.to_count(kMaxTargetDuration, &count)) return fail();
    out_.target_duration = static_cast<double>(count);
  } else if (name.is("EXT-X-MEDIA-SEQUENCE")) {
    return value.to_count(UINT64_MAX, &count) || fail();
  } else if (name.is("EXT-X-L4D-STREAM")) {
    return value.to_count(UINT64_MAX, &out_.stream) || fail();
  } else if (name.is("EXT-X-ENDLIST")) {
    out_.is_complete = true;
  }
  return true;
}

bool Parser::read_line(Text line) {
  if (line.size() > kMaxLineBytes) return fail(L4D_CAUSE_LIMIT);
  if (line_ == 1) return line.is("#EXTM3U") || fail();
  if (line.empty()) return true;
  if (*line.begin != '#') return add_media(line);
  ++line.begin;
  const Text name = line.cut(':');
  return read_tag(name, line);
}

PlaylistError Parser::parse(Text text) {
  if (text.size() > kMaxPlaylistBytes) return {L4D_CAUSE_LIMIT, 0};
  for (bool more = true; more;) {
    ++line_;
    more = text.contains('\n');
    Text line = text.cut('\n');
    if (!line.empty() && line.end[-1] == '\r') --line.end;
    if (!read_line(line)) return {cause_, line_};
  }
  if (has_attributes_ || has_range_ || duration_ > 0 || !(out_.target_duration > 0)) {
    return {L4D_CAUSE_PLAYLIST, line_};
  }
  return {};
}

// Of the first media member; UINT32_MAX where there is none.
uint32_t first_media(const Playlist& list) {
  for (const Member& m : list.members) {
    if (m.is_media) return m.number;
  }
  return UINT32_MAX;
}

bool same_member(const Playlist& a, const Member& x, const Playlist& b, const Member& y) {
  return x.begin == y.begin && x.shift == y.shift && x.offset == y.offset && x.bytes == y.bytes &&
         x.is_media == y.is_media && a.uris[x.uri] == b.uris[y.uri];
}

}  // namespace

PlaylistChange compare(const Playlist& before, const Playlist& after) {
  const bool ends = after.is_complete;
  if (before.stream != after.stream) return PlaylistChange::kOther;
  if (before.members.empty()) {
    return after.members.empty() && !ends ? PlaylistChange::kNone : PlaylistChange::kGrown;
  }
  if (after.members.empty()) return ends ? PlaylistChange::kOther : PlaylistChange::kOlder;
  const uint32_t last_before = before.members.back().number;
  const uint32_t last_after = after.members.back().number;
  const uint32_t front_before = first_media(before), front_after = first_media(after);
  auto x = before.members.begin();
  auto y = after.members.begin();
  while (x != before.members.end() || y != after.members.end()) {
    const uint32_t a = x != before.members.end() ? x->number : UINT32_MAX;
    const uint32_t b = y != after.members.end() ? y->number : UINT32_MAX;
    if (a == b && !same_member(before, *x, after, *y)) return PlaylistChange::kOther;
    // Media members leave at the front, and come at the end.
    if (a < b && x->is_media && a >= front_after && a <= last_after) return PlaylistChange::kOther;
    if (b < a && y->is_media && b >= front_before && b <= last_before) {
      return PlaylistChange::kOther;
    }
    if (a <= b) ++x;
    if (b <= a) ++y;
  }
  if (last_after < last_before) return ends ? PlaylistChange::kOther : PlaylistChange::kOlder;
  const bool same = last_after == last_before && front_after == front_before && !ends;
  return same ? PlaylistChange::kNone : PlaylistChange::kGrown;
}

const Member* Playlist::find(uint32_t number) const {
  const auto it = std::lower_bound(members.begin(), members.end(), number,
                                   [](const Member& m, uint32_t n) { return m.number < n; });
  return it == members.end() || it->number != number ? nullptr : &*it;
}

PlaylistError parse_playlist(const char* text, size_t size, Playlist* out) {
  *out = Playlist();
  return Parser(out).parse({text, text + size});
}

}  // namespace l4d::playback
