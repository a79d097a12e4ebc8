// SPDX-License-Identifier: Apache-2.0
#include "eval/image/captured_images.h"

#include <algorithm>
#include <map>

#include "io/image/metrics.h"
#include "io/image/video.h"

namespace l4d::eval {
namespace {

// Captured images that evaluations keep in memory at a time.
constexpr uint64_t kMaxBytes = uint64_t{1} << 30;
// Of a pixel of a frame of a video, as bytes and as values. Of image files, the reader counts more.
constexpr uint64_t kReadingBytes = 15;

std::string camera_name(const io::Camera& camera) { return "camera " + std::to_string(camera.id); }

// Names the camera in errors of its files.
template <typename Body>
void about_camera(const io::Camera& camera, const Body& body) {
  try {
    body();
  } catch (const io::Error& error) {
    if (error.status() == L4D_ERR_CANCELLED) throw;
    throw io::Error(error.status(), camera_name(camera) + ": " + error.what());
  }
}

std::vector<uint8_t> to_bytes(const io::Image& image) {
  std::vector<uint8_t> bytes(image.rgb.size());
  io::to_bytes(image.rgb.data(), bytes.size(), bytes.data());
  return bytes;
}

}  // namespace

CapturedImages::CapturedImages(const CameraViews& all, const std::vector<size_t>& views,
                               Observer& observer)
    : all_(all), bytes_(all.views.size()), masks_(all.set.cameras.size()) {
  std::map<size_t, std::vector<size_t>> by_camera;  // views, by rising frame
  for (const size_t view : views) by_camera[all.views[view].camera].push_back(view);
  size_t done = 0;
  io::Image image;
  for (const auto& entry : by_camera) {  // no structured binding: lambdas of C++17 capture none
    const auto& index = entry.first;
    const auto& of_camera = entry.second;
    const io::Camera& camera = all.set.cameras[index];
    const uint64_t pixels = uint64_t{camera.camera.width} * camera.camera.height;
    io::require_inside(all.set, camera);
    // All images as bytes, the mask, and one as it is read.
    memory_.push_back(io::hold(all.set.holder, (3 * of_camera.size() + 1 + kReadingBytes) * pixels,
                               "a set of images of " + camera_name(camera)));
    const io::ImageLimits limits{camera.camera.width, camera.camera.height, all.set.holder};
    if (!camera.mask.empty()) {
      about_camera(camera, [&] {
        std::vector<uint8_t>& mask = masks_[index];
        mask = io::mask_of(io::read_image(camera.mask, limits));
        if (std::find(mask.begin(), mask.end(), 255) != mask.end()) return;
        throw io::Error(L4D_ERR_CORRUPT,
                        "by its mask, " + camera.mask + ", none of its pixels counts");
      });
    }
    const auto keep = [&](size_t view) {
      observer.check();
      observer.update(done++, views.size(), "reading captured images");
      bytes_[view] = to_bytes(image);
    };
    if (!camera.video.empty()) {
      about_camera(camera, [&] {
        io::check_video(camera.video, camera.camera.width, camera.camera.height);
        io::VideoRange whole;
        whole.is_video = true;
        io::VideoReader video(camera.video, camera.camera.width, camera.camera.height, whole);
        for (const size_t view : of_camera) {
          video.read(all.views[view].frame, &image);
          keep(view);
        }
      });
    } else if (!camera.image.empty()) {
      about_camera(camera, [&] { image = io::read_image(camera.image, limits); });
      for (const size_t view : of_camera) keep(view);
    } else if (!camera.images.empty()) {
      for (const size_t view : of_camera) {
        about_camera(camera, [&] {
          image = io::read_image(io::numbered_image(camera, all.views[view].frame), limits);
        });
        keep(view);
      }
    } else {
      throw io::Error(L4D_ERR_IO, camera_name(camera) + " has no captured images");
    }
  }
}

CapturedImage CapturedImages::image(size_t view) const {
  const size_t index = all_.views[view].camera;
  const l4d_camera& camera = all_.set.cameras[index].camera;
  io::Image image(camera.width, camera.height);
  io::from_bytes(bytes_[view].data(), bytes_[view].size(), image.rgb.data());
  return {std::move(image), masks_[index]};
}

std::vector<std::vector<size_t>> parts_of(const CameraViews& all) {
  const uint64_t max_bytes =
      all.set.image_memory > 0 ? std::min(all.set.image_memory, kMaxBytes) : kMaxBytes;
  std::vector<uint64_t> bytes(all.set.cameras.size());
  for (const io::View& view : all.views) {
    const l4d_camera& camera = all.set.cameras[view.camera].camera;
    bytes[view.camera] += uint64_t{3} * camera.width * camera.height;
  }
  std::vector<size_t> part_of_camera(bytes.size());
  size_t part = 0;
  uint64_t in_part = 0;
  for (size_t camera = 0; camera < bytes.size(); ++camera) {
    if (in_part > 0 && in_part + bytes[camera] > max_bytes) {
      ++part;
      in_part = 0;
    }
    in_part += bytes[camera];
    part_of_camera[camera] = part;
  }
  std::vector<std::vector<size_t>> parts(part + 1);
  for (size_t view = 0; view < all.views.size(); ++view) {
    parts[part_of_camera[all.views[view].camera]].push_back(view);
  }
  parts.erase(std::remove_if(parts.begin(), parts.end(), [](const auto& p) { return p.empty(); }),
              parts.end());
  return parts;
}

}  // namespace l4d::eval
