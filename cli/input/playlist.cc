// SPDX-License-Identifier: Apache-2.0
#include "cli/input/playlist.h"

#include <algorithm>
#include <cmath>

#include "cli/text/escape.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

std::string range_of(const MemberInfo& m) {
  return std::to_string(m.member.bytes) + "@" + std::to_string(m.member.offset);
}

// Without an exponent, which playlists do not have, and never 0.
std::string duration_text(double seconds) {
  return format(seconds < 1e-3 ? "%.18f" : "%.6f", seconds);
}

// No "-0".
double plain(double seconds) { return seconds == 0 ? 0 : seconds; }

// before: the media member before, null if there is none. Where a span does not begin at the end of
// that one, the clock of segments jumps.
std::string media_lines(const MemberInfo& m, const MemberInfo* before, const std::string& url) {
  const bool jumps =
      before != nullptr && m.member.begin - before->member.end > rounding_of(m.member);
  std::string needs;
  for (const uint32_t n : m.needs) needs += (needs.empty() ? "" : ",") + std::to_string(n);
  return std::string(jumps ? "#EXT-X-DISCONTINUITY\n" : "") +
         format("#EXT-X-L4D-MEMBER:NUMBER=%u,BEGIN=%.17g,SHIFT=%.17g,NEEDS=\"%s\"\n",
                m.member.number, plain(m.member.begin), plain(m.member.shift), needs.c_str()) +
         "#EXTINF:" + duration_text(m.member.end - m.member.begin) + ",\n" +
         "#EXT-X-BYTERANGE:" + range_of(m) + "\n" + url + "\n";
}

}  // namespace

std::string reference_to(const std::string& name, const std::filesystem::path& folder) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path from = fs::canonical(folder.empty() ? fs::path(".") : folder, error);
  const fs::path file = fs::path(name);
  const fs::path parent = file.parent_path();
  const fs::path to = fs::canonical(parent.empty() ? fs::path(".") : parent, error);
  const fs::path relative =
      error ? file.filename() : (to / file.filename()).lexically_relative(from);
  return percent_encoded(relative.generic_string());
}

void check_url(const std::string& url) {
  if (std::any_of(url.begin(), url.end(),
                  [](unsigned char c) { return c <= ' ' || c == '"' || c == 0x7f; })) {
    throw usage_error("--url has a space, a quotation mark or a control character");
  }
}

std::string playlist_of(const std::vector<MemberInfo>& members, bool complete,
                        const std::string& url, uint64_t stream, double longest) {
  std::string lines;
  const MemberInfo* before = nullptr;
  for (const MemberInfo& m : members) {
    if (m.member.role == L4D_MEMBER_STANDING) {
      lines += format("#EXT-X-L4D-STANDING:NUMBER=%u,BEGIN=%.17g,END=%.17g,SHIFT=%.17g,",
                      m.member.number, plain(m.member.begin), plain(m.member.end),
                      plain(m.member.shift)) +
               "BYTERANGE=\"" + range_of(m) + "\",URI=\"" + url + "\"\n";
    }
    if (!m.is_media()) continue;
    longest = std::max(longest, m.member.end - m.member.begin);
    lines += media_lines(m, before, url);
    before = &m;
  }
  return "#EXTM3U\n#EXT-X-VERSION:4\n" +
         format("#EXT-X-TARGETDURATION:%.0f\n", std::max(1.0, std::round(longest))) +
         (complete ? "#EXT-X-PLAYLIST-TYPE:VOD\n" : "#EXT-X-PLAYLIST-TYPE:EVENT\n") +
         "#EXT-X-MEDIA-SEQUENCE:0\n" +
         (stream != 0 ? "#EXT-X-L4D-STREAM:" + std::to_string(stream) + "\n" : "") + lines +
         (complete ? "#EXT-X-ENDLIST\n" : "");
}

}  // namespace l4d::cli
