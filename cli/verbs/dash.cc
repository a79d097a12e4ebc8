// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs/dash.h"

#include <algorithm>
#include <cmath>

#include "cli/text/escape.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr double kTimescale = 1e6;  // of a segment list, in ticks a second
constexpr const char* kMediaType = "model/l4d";
// A scheme of this format; players that do not know it pass over it.
constexpr const char* kScheme = "urn:l4d:member:1";

// First and last byte.
std::string range_of(const MemberInfo& m) {
  return std::to_string(m.member.offset) + "-" +
         std::to_string(m.member.offset + m.member.bytes - 1);
}

std::string seconds_text(double seconds) { return format("PT%.6fS", seconds); }

std::string property_of(const MemberInfo& m) {
  std::string needs;
  for (const uint32_t n : m.needs) needs += (needs.empty() ? "" : ",") + std::to_string(n);
  return format(
      "      <SupplementalProperty schemeIdUri=\"%s\" value=\"number=%u;role=%s;"
      "begin=%.17g;end=%.17g;shift=%.17g;range=%s;needs=%s\"/>\n",
      kScheme, m.member.number, member_role_name(m.member.role), m.member.begin + 0.0,
      m.member.end + 0.0, m.member.shift + 0.0, range_of(m).c_str(), needs.c_str());
}

}  // namespace

std::string dash_manifest(const MemberFile& file, const std::string& url, bool complete) {
  const double begin = file.begin(), length = file.end() - begin;
  double longest = 0, rate = 1;
  std::string properties, timeline, segments;
  for (const MemberInfo& m : file.members()) {
    if (m.is_index()) continue;
    properties += property_of(m);
    if (!m.is_media()) continue;
    const double seconds = m.member.end - m.member.begin;
    longest = std::max(longest, seconds);
    rate = std::max(rate, 8 * static_cast<double>(m.member.bytes) / std::max(seconds, 1e-6));
    const double first = std::round((m.member.begin - begin) * kTimescale);
    const double ticks = std::max(1.0, std::round((m.member.end - begin) * kTimescale) - first);
    timeline += format("          <S t=\"%.0f\" d=\"%.0f\"/>\n", first, ticks);
    segments += "        <SegmentURL mediaRange=\"" + range_of(m) + "\"/>\n";
  }
  const std::string kind =
      complete ? "type=\"static\" mediaPresentationDuration=\"" + seconds_text(length) + "\""
               : "type=\"dynamic\" availabilityStartTime=\"1970-01-01T00:00:00Z\" "
                 "minimumUpdatePeriod=\"" +
                     seconds_text(std::max(longest, 0.5)) + "\"";
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
         "<MPD xmlns=\"urn:mpeg:dash:schema:mpd:2011\" "
         "profiles=\"urn:mpeg:dash:profile:full:2011\"\n"
         "     " +
         kind + " minBufferTime=\"" + seconds_text(longest) +
         "\">\n"
         "  <Period id=\"0\" start=\"PT0S\">\n"
         "    <AdaptationSet id=\"0\" contentType=\"application\" mimeType=\"" +
         kMediaType + "\">\n" +
         format("    <Representation id=\"0\" bandwidth=\"%.0f\">\n", std::ceil(rate)) +
         properties + "      <BaseURL>" + marked_up(url) + "</BaseURL>\n" +
         format("      <SegmentList timescale=\"%.0f\">\n", kTimescale) +
         "        <SegmentTimeline>\n" + timeline + "        </SegmentTimeline>\n" + segments +
         "      </SegmentList>\n    </Representation>\n    </AdaptationSet>\n  </Period>\n"
         "</MPD>\n";
}

}  // namespace l4d::cli
