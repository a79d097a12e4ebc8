// SPDX-License-Identifier: Apache-2.0
#include "training/run/setup/memory.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <new>
#include <system_error>

#include "l4d/l4d.hpp"
#include "libl4dcodec/base/threads.h"
#include "training/images/frame_cache.h"
#include "training/images/pixels.h"
#include "training/images/store.h"

namespace l4d::train {
namespace {

constexpr uint64_t kSampleViews = 24;    // that are scored now and then
constexpr uint64_t kReadingBytes = 40;   // a pixel of an image as its file has it
constexpr uint64_t kStepBytes = 60;      // a pixel of a view of a step
constexpr uint64_t kScoringBytes = 200;  // a pixel of a view that is scored
constexpr uint64_t kRowBytes = 512;      // a Gaussian that a view of a step shows
constexpr uint64_t kListBytes = 64;      // a pixel: lists of splats
constexpr uint64_t kMaxLists = uint64_t{256} << 20;
constexpr uint64_t kStateBytes = 64;  // a Gaussian, besides attributes and moments
constexpr uint64_t kCopies = 4;  // of the state: in use, saved, and packed in a buffer that grows

uint64_t pixels_of(const l4d_camera& camera) { return uint64_t{camera.width} * camera.height; }

std::string in_words(uint64_t bytes) {
  char text[40];
  const double value = static_cast<double>(bytes);
  if (bytes < 1000000) {
    std::snprintf(text, sizeof(text), "%.0f kB", value / 1e3);
  } else if (bytes < 1000000000) {
    std::snprintf(text, sizeof(text), "%.1f MB", value / 1e6);
  } else {
    std::snprintf(text, sizeof(text), "%.1f GB", value / 1e9);
  }
  return text;
}

void count_images(const Settings& s, const Capture& capture, MemoryNeed* need) {
  std::vector<uint64_t> bytes;
  for (const CaptureCamera& camera : capture.cameras) {
    bytes.push_back(image_bytes(scaled_camera(camera.source.camera, s.scale)));
  }
  const auto [total, largest] =
      sizes_of(instants_of(capture, "train"), StoreOptions().window,
               [&](uint32_t view) { return bytes[capture.views[view].camera]; });
  need->images = std::min(total, s.host_memory);
  need->least_images = std::min(total, kLeastWindows * largest);
}

}  // namespace

MemoryNeed memory_need(const Settings& s, const Capture& capture, uint32_t threads,
                       const eval::Lpips* lpips, uint64_t lpips_bytes) {
  MemoryNeed need;
  count_images(s, capture, &need);
  uint64_t full = 0, scaled = 0, lenses = 0;  // pixels
  for (const CaptureCamera& camera : capture.cameras) {
    const l4d_camera small = scaled_camera(camera.source.camera, s.scale);
    full = std::max(full, pixels_of(camera.source.camera));
    scaled = std::max(scaled, pixels_of(small));
    const bool is_distorted = camera.source.distortion.model != io::Distortion::Model::kNone;
    if (is_distorted) lenses += pixels_of(camera.source.camera);
    if (is_distorted || !camera.source.mask.empty()) need.reading += pixels_of(small);
    if (lpips != nullptr) {
      need.scoring = std::max(need.scoring, lpips->memory(small.width));
    }
  }
  const auto workers = static_cast<uint64_t>(resolve_threads(static_cast<int>(threads)));
  need.decoding = std::min<uint64_t>(workers, capture.views.size()) * kReadingBytes * full;
  need.reading +=
      need.decoding + lenses * Undistortion::kBytes + kSampleViews * kImageBytes * scaled;
  need.scoring += 2 * lpips_bytes + kScoringBytes * scaled;

  const uint64_t sh = uint64_t{3} * (s.sh_degree + 1) * (s.sh_degree + 1);
  const uint64_t row = 4 * (17 + sh);  // attributes of a Gaussian
  const bool on_host = s.backend == "cpu";
  const uint64_t state = 3 * row + kStateBytes;
  need.model = s.gaussians * (kCopies * state + (on_host ? (1 + s.views) * row : 0));
  // Motions, and what is made of them: a model that is copied out, places, velocities, an order.
  if (s.consistency_weight > 0) need.model += s.gaussians * (state + 12 + 12 + 16 + 12 + 8);
  const uint64_t lists = std::min(kMaxLists, kListBytes * scaled);
  need.rendering = s.views * kStepBytes * scaled;
  if (on_host) need.rendering += s.views * (s.gaussians * (kRowBytes + 4 * sh) + lists);
  return need;
}

uint64_t cache_need(const Settings& s, const Capture& capture, uint32_t threads) {
  uint64_t videos = 0, pixels = 0;
  for (const CaptureCamera& camera : capture.cameras) {
    if (!camera.is_video()) continue;
    ++videos;
    pixels = std::max(pixels, pixels_of(scaled_camera(camera.source.camera, s.scale)));
  }
  const auto workers = static_cast<uint64_t>(resolve_threads(static_cast<int>(threads)));
  return std::min(workers, videos) * FrameCache::kFrames * 3 * pixels;
}

uint64_t images_within(uint64_t limit, const MemoryNeed& need, bool may_shrink) {
  if (limit == 0 || need.total() <= limit) return need.images;
  const uint64_t others = need.total() - need.images;
  if (may_shrink && others < limit && limit - others >= need.least_images) return limit - others;
  const uint64_t images = may_shrink ? need.least_images : need.images;
  throw io::Error(L4D_ERR_LIMIT_EXCEEDED,
                  "the training needs " + in_words(others + images) + ", and --limit-memory is " +
                      in_words(limit) + ": Gaussians (--gaussians) " + in_words(need.model) +
                      ", rendering (--views) " + in_words(need.rendering) +
                      ", images (--host-memory, --scale) " + in_words(images) + ", reading them " +
                      in_words(need.reading) + ", scores " + in_words(need.scoring) +
                      ", the capture " + in_words(need.capture));
}

MemoryShares share_memory(const RunOptions& options, const Capture& capture,
                          const eval::Lpips* lpips, uint64_t lpips_bytes, uint64_t held) {
  const uint64_t limit = options.limit_memory;
  const l4d_camera camera = scaled_camera(capture.cameras[0].source.camera, options.settings.scale);
  const Settings planned = resolved(options.settings, capture, camera.width, camera.height);
  MemoryNeed need = memory_need(planned, capture, options.threads, lpips, lpips_bytes);
  need.capture = held;
  if (!options.cache.empty()) need.reading += cache_need(planned, capture, options.threads);
  const uint64_t images = images_within(limit, need, options.may_shrink_images && !options.resume);
  MemoryShares shares;
  shares.images = images < need.images ? images : planned.host_memory;
  if (limit == 0) return shares;
  need.images = images;
  // Half of what is left is for renderers, which keep to it, and half for image files on their way,
  // which may have more bytes than their pixels need.
  const uint64_t spare = (limit - need.total()) / 2;
  shares.renderer = (need.rendering + spare) / planned.views;
  shares.training = limit - need.capture - need.decoding - spare;
  return shares;
}

std::string lack_of_memory() {
  try {
    throw;
  } catch (const std::bad_alloc&) {
    return "out of memory";
  } catch (const std::filesystem::filesystem_error&) {
    throw;
  } catch (const std::system_error& error) {  // a thread that got no stack
    return error.what();
  } catch (const io::Error& error) {
    if (error.status() != L4D_ERR_OUT_OF_MEMORY) throw;
    return error.what();
  } catch (const l4d::Error& error) {
    const l4d_status status = error.status();
    if (status != L4D_ERR_OUT_OF_MEMORY && status != L4D_ERR_LIMIT_EXCEEDED) throw;
    return error.what();
  }
}

}  // namespace l4d::train
