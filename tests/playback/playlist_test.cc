// SPDX-License-Identifier: Apache-2.0
// Playlists: those that the tool writes, and those that nobody should write.
#include "decoder/playback/playlist.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "decoder/playback/playlist_text.h"

namespace l4d::playback::test {
namespace {

const std::string kHead = "#EXTM3U\n#EXT-X-TARGETDURATION:2\n";
const std::string kStanding =
    "#EXT-X-L4D-STANDING:NUMBER=0,BEGIN=0,END=4,SHIFT=0,BYTERANGE=\"100@0\",URI=\"a.l4d\"\n";

std::string media(uint32_t number, int begin, const std::string& needs = "0") {
  return "#EXT-X-L4D-MEMBER:NUMBER=" + std::to_string(number) + ",BEGIN=" + std::to_string(begin) +
         ",SHIFT=0.5,NEEDS=\"" + needs + "\"\n#EXTINF:2.000000,\n#EXT-X-BYTERANGE:50@" +
         std::to_string(50 + 50 * number) + "\na.l4d\n";
}

const std::string kGood = kHead + kStanding + media(1, 0) + media(2, 2);

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  const size_t at = text.rfind(what);
  EXPECT_NE(at, std::string::npos) << what;
  return at == std::string::npos ? text : text.replace(at, what.size(), by);
}

uint32_t cause_of(const std::string& text) {
  Playlist list;
  return parse_playlist(text.data(), text.size(), &list).cause;
}

Playlist parsed(const std::string& text) {
  Playlist list;
  const PlaylistError error = parse_playlist(text.data(), text.size(), &list);
  EXPECT_EQ(error.cause, uint32_t{L4D_CAUSE_NONE}) << "line " << error.line << " of " << text;
  return list;
}

TEST(Playlist, LinesOfOthersUrisAndEndsInSixDecimals) {
  const Playlist list =
      parsed(kHead + "# a comment\n#EXT-X-FUTURE:1\r\n\n" + kStanding + media(1, 0) +
             "#EXT-X-L4D-MEMBER:NUMBER=7,BEGIN=2.0000005,SHIFT=-1e-3\n"
             "#EXTINF:0.1,a title\nhttp://other.org/b.l4d?x=1\n");
  EXPECT_FALSE(list.is_complete);
  EXPECT_EQ(list.target_duration, 2);
  EXPECT_EQ(list.stream, 0u);
  ASSERT_EQ(list.members.size(), 3u);
  const Member& last = list.members[2];
  EXPECT_EQ(last.number, 7u);
  EXPECT_EQ(last.begin, 2.0000005);
  EXPECT_EQ(last.end, 2.0000005 + 0.1);
  EXPECT_EQ(last.shift, -1e-3);
  EXPECT_EQ(last.num_needs, 0u);
  EXPECT_TRUE(last.is_media);
  EXPECT_EQ(list.uris[last.uri], "http://other.org/b.l4d?x=1");
  EXPECT_EQ(last.offset, 0u);
  EXPECT_EQ(last.bytes, 0u);
  EXPECT_EQ(list.members[1].end, 2.0000005) << "no gap between neighbours";
  EXPECT_FALSE(list.members[0].is_media);
  EXPECT_EQ(list.members[0].bytes, 100u);
  EXPECT_EQ(list.members[1].offset, 100u);
  EXPECT_EQ(list.uris.size(), 2u);
  EXPECT_EQ(list.find(7), &list.members[2]);
  EXPECT_EQ(list.find(3), nullptr);
}

TEST(Playlist, AStreamAndAFrontThatIsGone) {
  const Playlist list =
      parsed(replaced(kGood, kHead,
                      kHead + "#EXT-X-MEDIA-SEQUENCE:4\n#EXT-X-L4D-STREAM:18446744073709551615\n") +
             "#EXT-X-ENDLIST\n");
  EXPECT_EQ(list.stream, UINT64_MAX);
  EXPECT_TRUE(list.is_complete);
}

// spec: PLST-1
TEST(Playlist, WhatBreaksARuleIsRefused) {
  std::string many;
  for (int k = 0; k <= 64; ++k) many += (k > 0 ? "," : "") + std::to_string(k);
  const struct {
    const char* what;
    std::string text;
    uint32_t cause;
  } cases[] = {
      {"no playlist", "hello\n", L4D_CAUSE_PLAYLIST},
      {"nothing", "", L4D_CAUSE_PLAYLIST},
      {"no target duration", "#EXTM3U\n" + kStanding + media(1, 0), L4D_CAUSE_PLAYLIST},
      {"a huge target duration", replaced(kGood, "DURATION:2", "DURATION:1000000000"),
       L4D_CAUSE_PLAYLIST},
      {"overlapping spans", kHead + kStanding + media(1, 0) + media(2, 1), L4D_CAUSE_PLAYLIST},
      {"numbers that do not ascend", kHead + kStanding + media(2, 0) + media(2, 2),
       L4D_CAUSE_PLAYLIST},
      {"a number that is too large", replaced(kGood, "NUMBER=2", "NUMBER=4294967295"),
       L4D_CAUSE_PLAYLIST},
      {"a need of itself", kHead + kStanding + media(1, 0, "1"), L4D_CAUSE_PLAYLIST},
      {"a need of what comes later",
       kHead + media(1, 0, "3") + replaced(kStanding, "NUMBER=0", "NUMBER=3"), L4D_CAUSE_PLAYLIST},
      {"a need of a media member", kHead + kStanding + media(1, 0) + media(2, 2, "1"),
       L4D_CAUSE_PLAYLIST},
      {"needs twice", kHead + kStanding + media(1, 0, "0,0"), L4D_CAUSE_PLAYLIST},
      {"a comma behind the needs", kHead + kStanding + media(1, 0, "0,"), L4D_CAUSE_PLAYLIST},
      {"too many needs",
       kHead +
           [] {
             std::string standing;
             for (int k = 0; k <= 64; ++k) {
               standing += replaced(kStanding, "NUMBER=0", "NUMBER=" + std::to_string(k));
             }
             return standing;
           }() +
           media(70, 0, many),
       L4D_CAUSE_LIMIT},
      {"no range of bytes", replaced(kGood, "50@150", "50"), L4D_CAUSE_PLAYLIST},
      {"an empty range", replaced(kGood, "50@150", "0@150"), L4D_CAUSE_PLAYLIST},
      {"a range beyond all numbers", replaced(kGood, "50@150", "9007199254740991@1"),
       L4D_CAUSE_PLAYLIST},
      {"a begin that is no number", replaced(kGood, "BEGIN=2", "BEGIN=Infinity"),
       L4D_CAUSE_PLAYLIST},
      {"an end before the begin", replaced(kGood, "END=4", "END=-4"), L4D_CAUSE_PLAYLIST},
      {"a duration of nothing", replaced(kGood, "EXTINF:2", "EXTINF:0"), L4D_CAUSE_PLAYLIST},
      {"a duration that vanishes",
       replaced(replaced(kGood, "BEGIN=2", "BEGIN=1e15"), "EXTINF:2.000000", "EXTINF:1e-9"),
       L4D_CAUSE_PLAYLIST},
      {"a segment that says nothing of itself", kGood + "a.l4d\n", L4D_CAUSE_PLAYLIST},
      {"a segment without a URI", kGood.substr(0, kGood.size() - 6), L4D_CAUSE_PLAYLIST},
      {"an attribute twice", replaced(kGood, "NUMBER=2", "NUMBER=2,NUMBER=3"), L4D_CAUSE_PLAYLIST},
      {"an open quotation mark", replaced(kGood, "URI=\"a.l4d\"", "URI=\"a.l4d"),
       L4D_CAUSE_PLAYLIST},
      {"an empty URI", replaced(kGood, "URI=\"a.l4d\"", "URI=\"\""), L4D_CAUSE_PLAYLIST},
      {"a stream that is no number", kGood + "#EXT-X-L4D-STREAM:-1\n", L4D_CAUSE_PLAYLIST},
      {"a stream of 65 bits", kGood + "#EXT-X-L4D-STREAM:18446744073709551616\n",
       L4D_CAUSE_PLAYLIST},
      {"a playlist of playlists", kHead + "#EXT-X-STREAM-INF:BANDWIDTH=1\nb.m3u8\n",
       L4D_CAUSE_FEATURE},
      {"encryption", replaced(kGood, kStanding, "#EXT-X-KEY:METHOD=AES-128\n" + kStanding),
       L4D_CAUSE_FEATURE},
      {"a long line", kHead + "#" + std::string(8192, 'x') + "\n", L4D_CAUSE_LIMIT},
      {"a long playlist", kHead + std::string(kMaxPlaylistBytes, '\n'), L4D_CAUSE_LIMIT},
  };
  for (const auto& c : cases) EXPECT_EQ(cause_of(c.text), c.cause) << c.what;
}

TEST(Playlist, TheLineOfAnErrorIsStated) {
  Playlist list;
  const std::string text = kGood + "a.l4d\n";
  EXPECT_EQ(parse_playlist(text.data(), text.size(), &list).line, 12u);
}

TEST(Playlist, MoreMembersThanTheLimit) {
  std::string text = kHead;
  for (int k = 0; k <= 200000; ++k) {
    text += "#EXT-X-L4D-MEMBER:NUMBER=" + std::to_string(k) + ",BEGIN=" + std::to_string(k) +
            ",SHIFT=0\n#EXTINF:1,\nu\n";
  }
  EXPECT_EQ(cause_of(text), uint32_t{L4D_CAUSE_LIMIT});
}

// Whatever is cut or changed, there are members that keep all rules, or an error.
TEST(Playlist, WhateverIsCutOrChanged) {
  size_t right = 0;
  for (size_t k = 0; k < kGood.size(); ++k) {
    const std::string head = kGood.substr(0, k), tail = kGood.substr(k + 1);
    for (const std::string& text : {head, head + tail, head + "9" + tail}) {
      Playlist list;
      if (parse_playlist(text.data(), text.size(), &list).cause != L4D_CAUSE_NONE) continue;
      ++right;
      for (const Member& m : list.members) {
        EXPECT_LT(m.begin, m.end) << text;
        EXPECT_LT(m.uri, list.uris.size());
        EXPECT_LE(m.first_need + m.num_needs, list.needs.size());
      }
    }
  }
  EXPECT_GT(right, 100u);
}

// spec: PLST-2, PLST-3
TEST(Playlist, WhatALaterLookSays) {
  const auto change = [](const std::string& before, const std::string& after) {
    return compare(parsed(before), parsed(after));
  };
  const std::string one = kHead + kStanding + media(1, 0), end = "#EXT-X-ENDLIST\n";
  const std::string three = kGood + media(3, 4);
  EXPECT_EQ(change(kGood, kGood), PlaylistChange::kNone);
  EXPECT_EQ(change(kHead, kHead), PlaylistChange::kNone);
  EXPECT_EQ(change(kHead, one), PlaylistChange::kGrown);
  EXPECT_EQ(change(one, kGood), PlaylistChange::kGrown);
  EXPECT_EQ(change(kGood, kGood + end), PlaylistChange::kGrown);
  EXPECT_EQ(change(kGood, one), PlaylistChange::kOlder);
  EXPECT_EQ(change(kGood, kHead), PlaylistChange::kOlder);
  // Windows: segments leave at the front, and what they needed with them.
  const std::string window = kHead + media(2, 2, "") + media(3, 4, "");
  const std::string later = kHead + media(3, 4, "") + media(4, 6, "");
  EXPECT_EQ(change(three, window), PlaylistChange::kGrown);
  EXPECT_EQ(change(window, later), PlaylistChange::kGrown);
  EXPECT_EQ(change(window, kHead + media(3, 4, "")), PlaylistChange::kGrown);
  EXPECT_EQ(change(window, kHead + media(8, 14, "")), PlaylistChange::kGrown) << "all has left";
  EXPECT_EQ(change(later, window), PlaylistChange::kOlder);
  EXPECT_EQ(change(three, kHead + kStanding + media(3, 4)), PlaylistChange::kGrown);
  // Others.
  EXPECT_EQ(change(kGood, one + end), PlaylistChange::kOther);
  EXPECT_EQ(change(kGood, kHead + end), PlaylistChange::kOther);
  EXPECT_EQ(change(one, replaced(one, "100@0", "101@0")), PlaylistChange::kOther);
  EXPECT_EQ(change(kGood, replaced(kGood, "SHIFT=0.5", "SHIFT=0")), PlaylistChange::kOther);
  EXPECT_EQ(change(kGood, replaced(kGood, "BEGIN=2", "BEGIN=2.5")), PlaylistChange::kOther);
  EXPECT_EQ(change(kGood, replaced(kGood, "a.l4d\n", "b.l4d\n")), PlaylistChange::kOther);
  EXPECT_EQ(change(three, one + media(3, 4)), PlaylistChange::kOther) << "one has vanished";
  EXPECT_EQ(change(one + media(3, 4), three), PlaylistChange::kOther) << "one has come between";
  EXPECT_EQ(change(kGood, kGood + "#EXT-X-L4D-STREAM:5\n"), PlaylistChange::kOther);
}

TEST(Playlist, NumbersAreReadToTheLastBit) {
  const auto seconds = [](const std::string& text) {
    double value = NAN;
    return Text{text.data(), text.data() + text.size()}.to_seconds(&value) ? value : NAN;
  };
  for (const double value : {0.0, 1.0, -2.5, 0.1, 1.0 / 3, 12345.678901234567, 1e-7, 3e-17,
                             86399.999999999985, 2.0000005, 1e17, 0.033366666666666669}) {
    char text[64];
    std::snprintf(text, sizeof text, "%.17g", value);
    EXPECT_EQ(seconds(text), value) << text;
    std::snprintf(text, sizeof text, "%.18f", value);
    if (value < 1 && value > 1e-8) {
      EXPECT_NEAR(seconds(text), value, 1e-17) << text;
    }
  }
  EXPECT_EQ(seconds("+1.50e+2"), 150);
  EXPECT_EQ(seconds(".5"), 0.5);
  EXPECT_EQ(seconds("5."), 5);
  EXPECT_EQ(seconds("1e-300"), 0);
  EXPECT_EQ(seconds("0e9999"), 0);
  EXPECT_EQ(seconds("1152921504606846976"), 1152921504606846976.0);
  EXPECT_EQ(seconds("100000000000000000000e-19"), 10);
  for (const char* text : {"", "-", ".", "1e", "1e+", "e5", "1,5", "0x10", "nan", "inf", "1 ", " 1",
                           "1e19", "1e9999", "1e99999", "--1", "1.2.3"}) {
    EXPECT_TRUE(std::isnan(seconds(text))) << text;
  }
}

}  // namespace
}  // namespace l4d::playback::test
