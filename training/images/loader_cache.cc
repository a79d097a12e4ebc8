// SPDX-License-Identifier: Apache-2.0
// How ImageLoader reads videos through a FrameCache.
#include <algorithm>
#include <atomic>
#include <map>
#include <mutex>
#include <set>

#include "libl4dcodec/base/threads.h"
#include "training/images/loader.h"

namespace l4d::train {

void ImageLoader::use(FrameCache* cache) {
  cache_ = cache;
  videos_.assign(capture_.cameras.size(), {});
  places_.assign(capture_.views.size(), 0);
  // Views are by time, and so those of a camera are by frame.
  for (uint32_t k = 0; k < capture_.views.size(); ++k) {
    if (!capture_.views[k].file.empty()) continue;
    std::vector<uint32_t>& of_camera = videos_[capture_.views[k].camera];
    places_[k] = static_cast<uint32_t>(of_camera.size());
    of_camera.push_back(k);
  }
}

FramePart ImageLoader::part_of(uint32_t camera, uint32_t part) const {
  const size_t rest = videos_[camera].size() - size_t{part} * FrameCache::kFrames;
  const auto count = static_cast<uint32_t>(std::min<size_t>(rest, FrameCache::kFrames));
  return {camera, part, count, cameras_[camera].width, cameras_[camera].height};
}

void ImageLoader::load_parts(uint32_t camera, const std::vector<uint32_t>& views, const Sink& sink,
                             const std::function<bool()>& cancelled) const {
  std::map<uint32_t, std::vector<uint32_t>> parts;  // places of views in them
  for (const uint32_t view : views) {
    parts[places_[view] / FrameCache::kFrames].push_back(places_[view] % FrameCache::kFrames);
  }
  const bool keeps = cache_->is_writable();
  std::vector<uint32_t> missing;  // views, by frame
  for (const auto& [number, places] : parts) {
    if (cancelled && cancelled()) return;
    const FramePart part = part_of(camera, number);
    const uint32_t* first = videos_[camera].data() + size_t{number} * FrameCache::kFrames;
    std::vector<Pixels> frames = cache_->read(part, places);
    for (size_t k = 0; k < frames.size(); ++k) sink(first[places[k]], std::move(frames[k]));
    if (!frames.empty()) continue;
    if (keeps) missing.insert(missing.end(), first, first + part.count);
    for (size_t k = 0; k < places.size() && !keeps; ++k) missing.push_back(first[places[k]]);
  }
  if (missing.empty()) return;
  const std::set<uint32_t> wanted(views.begin(), views.end());
  std::vector<Pixels> frames;  // of the part that is being decoded
  const auto take = [&](uint32_t view, Pixels pixels) {
    if (keeps) frames.push_back(pixels);
    if (wanted.count(view) != 0) sink(view, std::move(pixels));
    const FramePart part = part_of(camera, places_[view] / FrameCache::kFrames);
    if (frames.size() < part.count) return;
    cache_->write(part, frames);
    frames.clear();
  };
  load_video(camera, missing, take, cancelled);
}

std::vector<uint32_t> ImageLoader::not_cached(uint32_t camera) const {
  const std::vector<uint32_t>& all = videos_[camera];
  std::vector<uint32_t> views;
  for (uint32_t k = 0; k < all.size(); k += FrameCache::kFrames) {
    const FramePart part = part_of(camera, k / FrameCache::kFrames);
    if (!cache_->has(part)) views.insert(views.end(), &all[k], &all[k] + part.count);
  }
  return views;
}

void ImageLoader::fill_cache(const char* split, uint32_t threads,
                             const std::function<bool(uint64_t, uint64_t)>& progress) const {
  std::vector<std::vector<uint32_t>> missing;
  uint64_t done = 0, total = 0;
  for (uint32_t c = 0; c < videos_.size(); ++c) {
    if (capture_.cameras[c].split != split) continue;
    missing.push_back(not_cached(c));
    total += missing.back().size();
  }
  std::mutex mutex;
  std::atomic<bool> stop{false};
  const auto count = [&](uint32_t, const Pixels&) {
    const std::lock_guard<std::mutex> lock(mutex);
    if (progress && progress(++done, total)) stop = true;
  };
  parallel_for(static_cast<int>(threads), missing.size(), 1, [&](size_t k, size_t) {
    const auto ends = [&] { return stop || !cache_->is_writable(); };
    if (missing[k].empty() || ends()) return;
    load_parts(capture_.views[missing[k][0]].camera, missing[k], count, ends);
  });
  if (stop) throw io::Error(L4D_ERR_CANCELLED, "cancelled");
}

}  // namespace l4d::train
