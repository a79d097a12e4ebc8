// SPDX-License-Identifier: Apache-2.0
#include "tests/playback/recording.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "l4d/l4d.hpp"

namespace l4d::playback::test {
namespace {

constexpr uint32_t kStanding = 0;

std::string text_of(const char* format, double a) {
  char text[64];
  std::snprintf(text, sizeof text, format, a);
  return text;
}

}  // namespace

Recording::Recording(const std::vector<const Bytes*>& files, const RecordingShape& shape,
                     uint64_t seed)
    : files_(files), shape_(shape), random_(seed) {
  auto whole = std::make_shared<Bytes>(*files[0]);
  double at = 0, begin = 10;
  const size_t turn = seed % files.size();
  for (uint32_t k = 0; k < shape.members; ++k) {
    Segment s{};
    s.number = k + 1;
    s.file = (turn + k) % files.size();
    const Bytes& bytes = *files[s.file];
    DecoderHandle decoder;
    decoder.open_memory(bytes.data(), bytes.size());
    const l4d_timeline t = decoder.info().timeline;
    const double seconds = static_cast<double>(t.num_frames) * t.fps_den / t.fps_num;
    if (shape.gap > 0 && k % 3 == 2) begin += shape.gap;
    s.begin = begin;
    s.end = begin + seconds;
    s.shift = begin - t.time_begin;
    begin = s.end;
    target_ = std::max(target_, std::round(seconds));
    if (k >= shape.first) at += seconds;
    const bool is_late = at >= shape.pause_from && at < shape.pause_until;
    const double there = is_late ? shape.pause_until : at;
    if (!shape.catches_up) at = there;
    s.at = k < shape.first ? 0 : there + shape.jitter * random_.uniform();
    s.offset = whole->size();
    s.bytes = bytes.size();
    s.needs = shape.standing && k % 2 == 0;
    segments_.push_back(s);
    auto own = std::make_shared<Bytes>(bytes);
    if (shape.damaged.count(k) != 0) {
      for (uint64_t i = 2000; i < own->size(); i += 3000) (*own)[static_cast<size_t>(i)] ^= 0x40;
    }
    whole->insert(whole->end(), own->begin(), own->end());
    served_.push_back(own);
  }
  served_.push_back(std::make_shared<Bytes>(*files[0]));
  whole_ = whole;
}

size_t Recording::num_listed(double now) const {
  const double base = has_restarted(now) ? shape_.restart_at : 0;
  if (now >= completed_at_) return segments_.size();
  return static_cast<size_t>(std::count_if(segments_.begin(), segments_.end(),
                                           [&](const Segment& s) { return s.at + base <= now; }));
}

bool Recording::is_complete(double now) const {
  return now >= completed_at_ || (shape_.ends && num_listed(now) == segments_.size());
}

double Recording::end(double now) const {
  const size_t n = num_listed(now);
  return n == 0 ? 0 : segments_[n - 1].end;
}

const Bytes& Recording::file_of(uint32_t number, double now) const {
  if (number == kStanding) return *files_[0];
  return content(number - 1, has_restarted(now));
}

// Another recording has other files.
const Bytes& Recording::content(size_t k, bool again) const {
  return *files_[(segments_[k].file + (again ? 1 : 0)) % files_.size()];
}

std::string Recording::list_at(double now) const {
  std::string out =
      "#EXTM3U\n#EXT-X-VERSION:4\n#EXT-X-TARGETDURATION:" + text_of("%.0f", target_) + "\n";
  const size_t n = num_listed(now);
  const bool complete = is_complete(now);
  const size_t from = shape_.window > 0 && !complete && n > shape_.window ? n - shape_.window : 0;
  out += "#EXT-X-MEDIA-SEQUENCE:" + std::to_string(from) + "\n";
  if (shape_.states_stream) {
    out += std::string("#EXT-X-L4D-STREAM:") + (has_restarted(now) ? "77" : "5") + "\n";
  }
  if (shape_.standing) {
    out += "#EXT-X-L4D-STANDING:NUMBER=0,BEGIN=0,END=1000,SHIFT=0,BYTERANGE=\"" +
           std::to_string(files_[0]->size()) + "@0\",URI=\"" +
           (shape_.one_file ? "all.l4d" : "0.l4d") + "\"\n";
  }
  for (size_t k = from; k < n; ++k) {
    const Segment& s = segments_[k];
    out += "#EXT-X-L4D-MEMBER:NUMBER=" + std::to_string(s.number) +
           ",BEGIN=" + text_of("%.17g", s.begin) + ",SHIFT=" + text_of("%.17g", s.shift) +
           ",NEEDS=\"" + (s.needs ? "0" : "") + "\"\n#EXTINF:" + text_of("%.6f", s.end - s.begin) +
           ",\n";
    if (shape_.one_file) {
      out += "#EXT-X-BYTERANGE:" + std::to_string(s.bytes) + "@" + std::to_string(s.offset) + "\n";
    }
    out += shape_.one_file ? "all.l4d\n" : std::to_string(s.number) + ".l4d\n";
  }
  return out + (complete ? "#EXT-X-ENDLIST\n" : "");
}

Served Recording::get(uint32_t source, double now) {
  if (source == 0) {
    double seen = now;
    if (now < shape_.cache_seconds && random_.below(3) == 0) {
      seen = std::max(now - 10 * random_.uniform(), std::min(now, 0.0));
    }
    const std::string text = list_at(seen);
    return {std::make_shared<Bytes>(text.begin(), text.end()), 0};
  }
  const uint32_t number = source - 1;
  const bool again = has_restarted(now);
  if (number > segments_.size()) return {};
  if (number != kStanding && shape_.absent.count(number - 1) != 0) return {};
  // What is listed no more is deleted, a little later.
  const size_t listed = num_listed(now);
  const bool leaves = shape_.window > 0 && !is_complete(now) && listed > shape_.window + 1;
  if (number != kStanding && leaves && number < listed - shape_.window) return {};
  if (shape_.one_file && !again) return {whole_, uint64_t{num_listed(now)} + 1};
  if (number == kStanding) return {served_.back(), 1};
  if (segments_[number - 1].at + (again ? shape_.restart_at : 0) > now && now < completed_at_) {
    return {};
  }
  if (again) return {std::make_shared<Bytes>(content(number - 1, true)), 2};
  return {served_[number - 1], 1};
}

}  // namespace l4d::playback::test
