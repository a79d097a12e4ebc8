// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <tuple>

#include "io/camera/cameras.h"

namespace l4d::io {
namespace {

constexpr uint64_t kMaxViews = 100000000;

[[noreturn]] void fail(const std::string& what) { throw Error(L4D_ERR_INVALID_ARGUMENT, what); }

std::vector<std::string_view> split_at(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (size_t end = text.find(separator); end != std::string_view::npos;
       end = text.find(separator)) {
    parts.push_back(text.substr(0, end));
    text.remove_prefix(end + 1);
  }
  parts.push_back(text);
  return parts;
}

bool parse(std::string_view text, uint32_t* value) {
  const auto result = std::from_chars(text.data(), text.data() + text.size(), *value);
  return !text.empty() && result.ec == std::errc() && result.ptr == text.data() + text.size();
}

// Which cameras `ids` names.
std::vector<bool> cameras_of(const CameraSet& set, const std::string& ids) {
  std::vector<bool> chosen(set.cameras.size(), ids.empty());
  if (ids.empty()) return chosen;
  for (const std::string_view part : split_at(ids, ',')) {
    const std::vector<std::string_view> ends = split_at(part, '-');
    uint32_t first = 0, last = 0;
    if (ends.size() > 2 || !parse(ends.front(), &first) || !parse(ends.back(), &last) ||
        first > last) {
      fail("camera ids are numbers and ranges such as 0,10,15 or 0-3, not \"" + ids + "\"");
    }
    bool found = false;
    for (size_t i = 0; i < set.cameras.size(); ++i) {
      const int64_t id = set.cameras[i].id;
      if (id < int64_t{first} || id > int64_t{last}) continue;
      chosen[i] = true;
      found = true;
    }
    if (!found) fail("there is no camera " + std::string(part));
  }
  return chosen;
}

struct FrameRange {
  uint32_t first = 0, end = 0, step = 1;
  bool contains(uint32_t frame) const {
    return frame >= first && frame < end && (frame - first) % step == 0;
  }
};

FrameRange frames_of(const std::string& text, uint32_t count) {
  FrameRange range;
  range.end = count;
  if (text.empty()) return range;
  const std::vector<std::string_view> parts = split_at(text, ':');
  bool good = parts.size() <= 3 && parse(parts[0], &range.first);
  if (parts.size() == 1) {
    range.end = range.first < UINT32_MAX ? range.first + 1 : range.first;
  } else if (good) {
    good = parse(parts[1], &range.end) && range.first < range.end;
  }
  if (good && parts.size() == 3) good = parse(parts[2], &range.step) && range.step > 0;
  if (!good) {
    fail("frames are a number, first:end or first:end:step with first below end, not \"" + text +
         "\"");
  }
  if (range.first >= count || range.end > count) {
    fail("frames " + text + " go beyond the " + std::to_string(count) + " frames there are");
  }
  return range;
}

struct Frames {
  double begin = 0, seconds = 0, fps = 0;
  uint32_t count = 0;
};

Frames frames_of(const CameraSet& set, const l4d_timeline& timeline) {
  Frames frames;
  frames.begin = timeline.time_begin;
  frames.seconds = duration(timeline);
  frames.fps = set.fps > 0
                   ? set.fps
                   : static_cast<double>(timeline.fps_num) / static_cast<double>(timeline.fps_den);
  // Frames that begin before the end, with room for the rounding of the rate.
  const double fit = std::ceil(frames.seconds * frames.fps - 1e-6);
  frames.count = static_cast<uint32_t>(std::clamp(fit, 1.0, static_cast<double>(UINT32_MAX)));
  if (set.frames > 0) frames.count = std::min(frames.count, set.frames);
  return frames;
}

View view_of_instant(size_t camera, double since_begin, const Frames& frames) {
  View view;
  view.camera = camera;
  since_begin = std::min(since_begin, frames.seconds);
  view.time = frames.begin + since_begin;
  view.frame = static_cast<uint32_t>(
      std::clamp(std::round(since_begin * frames.fps), 0.0, static_cast<double>(frames.count - 1)));
  return view;
}

}  // namespace

std::vector<View> select_views(const CameraSet& set, const ViewSelection& selection,
                               const l4d_timeline& timeline) {
  const std::string& split = selection.split;
  if (split != "all" && split != "train" && split != "test" && split != "val") {
    fail("the split is all, train, test or val, not \"" + split + "\"");
  }
  if (timeline.num_frames == 0 || timeline.fps_num == 0 || timeline.fps_den == 0) {
    fail("the scene has no timeline");
  }
  const Frames frames = frames_of(set, timeline);
  const FrameRange range = frames_of(selection.frames, frames.count);
  const uint64_t frames_in_range = (uint64_t{range.end} - range.first - 1) / range.step + 1;
  const std::vector<bool> chosen = cameras_of(set, selection.ids);

  std::vector<View> views;
  for (size_t i = 0; i < set.cameras.size(); ++i) {
    const Camera& camera = set.cameras[i];
    if (!chosen[i] || (split != "all" && camera.split != split)) continue;
    if (camera.time) {
      const View view = view_of_instant(i, *camera.time * set.seconds, frames);
      if (range.contains(view.frame)) views.push_back(view);
      continue;
    }
    if (views.size() + frames_in_range > kMaxViews) {
      throw Error(L4D_ERR_LIMIT_EXCEEDED,
                  "more than " + std::to_string(kMaxViews) + " views; select frames or cameras");
    }
    const uint64_t more = std::max<uint64_t>(views.size() + frames_in_range, 2 * views.capacity());
    const std::shared_ptr<void> memory = hold(set.holder, more * sizeof(View), "the views");
    for (uint64_t k = range.first; k < range.end; k += range.step) {
      View view;
      view.camera = i;
      view.frame = static_cast<uint32_t>(k);
      view.time = frames.begin + static_cast<double>(k) / frames.fps;
      views.push_back(view);
    }
  }
  if (views.empty()) fail("no view is selected");
  std::sort(views.begin(), views.end(), [](const View& a, const View& b) {
    return std::tie(a.frame, a.time, a.camera) < std::tie(b.frame, b.time, b.camera);
  });
  return views;
}

}  // namespace l4d::io
