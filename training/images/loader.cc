// SPDX-License-Identifier: Apache-2.0
#include "training/images/loader.h"

#include <algorithm>
#include <iterator>
#include <map>
#include <optional>

#include "io/image/metrics.h"
#include "io/image/video.h"
#include "libl4dcodec/base/threads.h"

namespace l4d::train {
namespace {

using io::Error;

io::ImageLimits limits_of(const CaptureCamera& camera, const io::Hold& holder) {
  return {camera.source.camera.width, camera.source.camera.height, holder};
}

io::Image read_mask(const CaptureCamera& camera, const io::Hold& holder) {
  try {
    return io::read_image(camera.source.mask, limits_of(camera, holder));
  } catch (const Error& error) {
    throw Error(error.status(), camera.name + ": its mask: " + error.what());
  }
}

// A time between a frame and the one before. Half a frame early, for times are rounded.
double seek_of(const CaptureCamera& camera, uint32_t frame, double fps) {
  const std::vector<double>& times = camera.times;
  if (times.empty()) return (frame - 0.5) / fps;
  return frame < times.size() ? (times[frame - 1] + times[frame]) / 2 : times.back();
}

}  // namespace

ImageLoader::ImageLoader(const Capture& capture, double scale, double near)
    : capture_(capture), scale_(scale) {
  const double near_plane = near * frame_of(capture).radius;
  for (const CaptureCamera& camera : capture.cameras) {
    const l4d_camera& full = camera.source.camera;
    cameras_.push_back(scaled_camera(full, scale));
    cameras_.back().near_plane = std::max(full.near_plane, near_plane);
    const l4d_camera& out = cameras_.back();
    std::unique_ptr<Undistortion> undistortion;
    std::vector<uint8_t> mask;
    if (camera.source.distortion.model != io::Distortion::Model::kNone) {
      undistortion = std::make_unique<Undistortion>(full, camera.source.distortion);
      mask = undistortion->mask();
    }
    if (!camera.source.mask.empty()) {
      io::Image image = read_mask(camera, capture.holder);
      if (undistortion) image = undistortion->apply(image);
      std::vector<uint8_t> own = io::mask_of(image);
      for (size_t i = 0; i < mask.size(); ++i) own[i] = std::min(own[i], mask[i]);
      mask = std::move(own);
    }
    if (!mask.empty()) {
      io::Image image(full.width, full.height);
      for (size_t i = 0; i < mask.size(); ++i) image.rgb[3 * i] = mask[i] != 0 ? 1.0f : 0.0f;
      const Pixels small = resized(image, {}, out.width, out.height);
      mask.assign(size_t{out.width} * out.height, 0);
      // A pixel counts where nothing of it is masked.
      for (size_t i = 0; i < mask.size(); ++i) mask[i] = small.rgb[3 * i] == 255 ? 255 : 0;
      if (std::find(mask.begin(), mask.end(), 255) == mask.end()) {
        const std::string by = camera.source.mask.empty() ? "lens" : "mask, " + camera.source.mask;
        throw Error(L4D_ERR_CORRUPT,
                    camera.name + ": by its " + by + ", none of its pixels counts");
      }
    }
    if (!camera.source.mask.empty()) {
      memory_.push_back(io::hold(capture.holder, mask.size(), camera.name + ": its mask"));
    }
    masks_.push_back(std::move(mask));
    undistortions_.push_back(std::move(undistortion));
  }
}

// Number by number: a thread that reads images looks at sizes.
void ImageLoader::renew_cameras() {
  for (uint32_t c = 0; c < cameras_.size(); ++c) {
    const CaptureCamera& of = capture_.cameras[c];
    const l4d_camera now = scaled_camera(changed(of.source.camera, of.change), scale_);
    l4d_camera& out = cameras_[c];
    std::copy_n(now.world_to_camera, std::size(now.world_to_camera), out.world_to_camera);
    out.fx = now.fx;
    out.fy = now.fy;
  }
}

Pixels ImageLoader::finish(uint32_t camera, const io::Image& image,
                           const std::vector<float>& alpha) const {
  const l4d_camera& out = cameras_[camera];
  if (undistortions_[camera] == nullptr) return resized(image, alpha, out.width, out.height);
  io::Image plane(image.width, image.height);
  std::vector<float> straight = alpha;
  if (!alpha.empty()) {
    for (size_t i = 0; i < alpha.size(); ++i) plane.rgb[3 * i] = alpha[i];
    plane = undistortions_[camera]->apply(plane);
    for (size_t i = 0; i < alpha.size(); ++i) straight[i] = plane.rgb[3 * i];
  }
  return resized(undistortions_[camera]->apply(image), straight, out.width, out.height);
}

void ImageLoader::load_file(uint32_t index, const Sink& sink) const {
  const CaptureView& view = capture_.views[index];
  const CaptureCamera& camera = capture_.cameras[view.camera];
  std::optional<io::ByteImage> bytes;
  std::vector<float> alpha;
  io::Image image;
  try {
    const io::ImageLimits limits = limits_of(camera, capture_.holder);
    bytes = io::read_image_bytes(view.file, limits);
    if (!bytes) image = io::read_image(view.file, &alpha, limits);
  } catch (const Error& error) {
    throw Error(error.status(),
                camera.name + ", frame " + std::to_string(view.frame) + ": " + error.what());
  }
  if (bytes) {
    const l4d_camera& out = cameras_[view.camera];
    const bool is_scaled = out.width != bytes->width || out.height != bytes->height;
    if (!is_scaled && undistortions_[view.camera] == nullptr) {
      sink(index,
           Pixels{bytes->width, bytes->height, std::move(bytes->rgb), std::move(bytes->alpha)});
      return;
    }
    image = io::Image(bytes->width, bytes->height);
    io::from_bytes(bytes->rgb.data(), bytes->rgb.size(), image.rgb.data());
    alpha.resize(bytes->alpha.size());
    io::from_bytes(bytes->alpha.data(), bytes->alpha.size(), alpha.data());
  }
  sink(index, finish(view.camera, image, alpha));
}

void ImageLoader::load_video(uint32_t index, const std::vector<uint32_t>& views, const Sink& sink,
                             const std::function<bool()>& cancelled) const {
  const CaptureCamera& camera = capture_.cameras[index];
  const l4d_camera& full = camera.source.camera;
  const l4d_camera& out = cameras_[index];
  const bool scales_itself = undistortions_[index] != nullptr;
  io::VideoRange range;
  range.is_video = true;
  range.first = capture_.views[views.front()].frame;
  if (range.first > 0) range.seek = seek_of(camera, range.first, capture_.fps);
  if (!scales_itself) {
    range.out_width = out.width;
    range.out_height = out.height;
  }
  try {
    io::VideoReader reader(camera.source.video, full.width, full.height, range);
    std::vector<uint8_t> rgb;
    for (const uint32_t view : views) {
      if (cancelled && cancelled()) return;
      const uint32_t frame = capture_.views[view].frame;
      bool there = true;
      while (there && reader.position() <= frame) there = reader.next(&rgb);
      if (!there) {
        throw Error(L4D_ERR_IO, camera.source.video + ": there is no frame " +
                                    std::to_string(frame) + "; the video ends after " +
                                    std::to_string(reader.position()));
      }
      if (!scales_itself) {
        sink(view, Pixels{out.width, out.height, rgb, {}});
        continue;
      }
      io::Image image(full.width, full.height);
      io::from_bytes(rgb.data(), rgb.size(), image.rgb.data());
      sink(view, finish(index, image, {}));
    }
  } catch (const Error& error) {
    throw Error(error.status(), camera.name + ": " + error.what());
  }
}

void ImageLoader::load(std::vector<uint32_t> views, uint32_t threads, const Sink& sink,
                       const std::function<bool()>& cancelled) const {
  std::map<uint32_t, std::vector<uint32_t>> videos;
  std::vector<uint32_t> files;
  for (const uint32_t view : views) {
    if (capture_.views[view].file.empty()) {
      videos[capture_.views[view].camera].push_back(view);
    } else {
      files.push_back(view);
    }
  }
  for (auto& [camera, list] : videos) {
    std::sort(list.begin(), list.end(), [&](uint32_t a, uint32_t b) {
      return capture_.views[a].frame < capture_.views[b].frame;
    });
  }
  const std::vector<std::pair<uint32_t, std::vector<uint32_t>>> list(videos.begin(), videos.end());
  const int workers = static_cast<int>(threads);
  parallel_for(workers, list.size(), 1, [&](size_t k, size_t) {
    if (cancelled && cancelled()) return;
    if (cache_ != nullptr) {
      load_parts(list[k].first, list[k].second, sink, cancelled);
    } else {
      load_video(list[k].first, list[k].second, sink, cancelled);
    }
  });
  parallel_for(workers, files.size(), 1, [&](size_t k, size_t) {
    if (cancelled && cancelled()) return;
    load_file(files[k], sink);
  });
}

}  // namespace l4d::train
