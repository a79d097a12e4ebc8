// SPDX-License-Identifier: Apache-2.0
#include "eval/image/image_comparison.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <optional>

#include "eval/image/captured_images.h"

namespace l4d::eval {
namespace {

double capped(double decibels) { return std::min(decibels, kMaxDecibels); }

// The frame rate of a camera's views, which rise in time; 0 for one view.
double fps_of(const CameraViews& all, const std::vector<size_t>& views) {
  std::vector<double> times;
  for (const size_t view : views) times.push_back(all.views[view].time);
  const double fps = video_rate(times);
  if (fps > 0 || views.size() == 1) return fps;
  throw io::Error(L4D_ERR_INVALID_ARGUMENT, "JOD is that of a video, and the frames of camera " +
                                                std::to_string(all.camera_of(views[0]).id) +
                                                " are not evenly spaced");
}

// The videos of the camera at hand.
class Videos {
 public:
  Videos(const CameraViews& all, bool images, const JodDisplay* display, uint32_t threads)
      : all_(all), images_(images), display_(display), threads_(threads) {
    if (display == nullptr) return;
    std::map<size_t, std::vector<size_t>> by_camera;
    for (size_t k = 0; k < all.views.size(); ++k) by_camera[all.views[k].camera].push_back(k);
    for (auto& [camera, views] : by_camera) {
      std::stable_sort(views.begin(), views.end(),
                       [&](size_t a, size_t b) { return all.views[a].time < all.views[b].time; });
      const double fps = fps_of(all, views);
      videos_[camera] = {all.set.cameras[camera].id, views.size(), fps, 0, 0, 0};
    }
  }

  // The views of a part, camera by camera.
  std::vector<size_t> order_of(std::vector<size_t> part) const {
    if (display_ == nullptr) return part;
    std::stable_sort(part.begin(), part.end(), [&](size_t a, size_t b) {
      const io::View &x = all_.views[a], &y = all_.views[b];
      return x.camera != y.camera ? x.camera < y.camera : x.time < y.time;
    });
    return part;
  }

  // seen: what the camera saw, or null.
  void add(size_t view, const io::Image& a, const io::Image& b, const io::Image* seen) {
    if (display_ == nullptr) return;
    const size_t camera = all_.views[view].camera;
    CameraJod& video = videos_[camera];
    if (meters_.empty()) {
      const l4d_camera& size = all_.set.cameras[camera].camera;
      for (size_t k = 0; k < (images_ ? 3U : 1U); ++k) {
        meters_.push_back(std::make_unique<JodMeter>(size.width, size.height, video.frames,
                                                     video.fps, *display_, threads_,
                                                     all_.set.holder));
      }
    }
    meters_[0]->add(b, a);
    if (seen != nullptr) {
      meters_[1]->add(a, *seen);
      meters_[2]->add(b, *seen);
    }
    if (meters_[0]->frames().size() < video.frames) return;
    video.jod = meters_[0]->jod();
    if (seen != nullptr) {
      video.a = meters_[1]->jod();
      video.b = meters_[2]->jod();
    }
    meters_.clear();
  }

  std::vector<CameraJod> take() const {
    std::vector<CameraJod> all;
    for (const auto& [camera, video] : videos_) all.push_back(video);
    return all;
  }

 private:
  const CameraViews& all_;
  const bool images_;
  const JodDisplay* display_;
  const uint32_t threads_;
  std::map<size_t, CameraJod> videos_;
  std::vector<std::unique_ptr<JodMeter>> meters_;
};

}  // namespace

double capped_psnr(double mse) { return capped(io::psnr_of_mse(mse)); }

io::Fidelity summarise(const std::vector<ImageError>& views) {
  io::FidelityAccumulator sums;
  double decibels = 0;
  for (const ImageError& view : views) {
    sums.add(view.mse, view.ssim);
    decibels += capped_psnr(view.mse);
  }
  io::Fidelity result = sums.result();
  result.psnr = capped(result.psnr);
  result.min_psnr = capped(result.min_psnr);
  // One view that is equal must not make the mean of all infinite.
  result.mean_psnr = decibels / static_cast<double>(views.size());
  return result;
}

io::Fidelity ImageComparison::summary(ImageError ViewFidelity::*of) const {
  std::vector<ImageError> errors;
  for (const ViewFidelity& view : views) errors.push_back(view.*of);
  return summarise(errors);
}

double ImageComparison::mean_lpips(ImageError ViewFidelity::*of) const {
  double sum = 0;
  for (const ViewFidelity& view : views) sum += (view.*of).lpips;
  return sum / static_cast<double>(views.size());
}

double ImageComparison::mean_jod(double CameraJod::*of) const {
  double sum = 0;
  for (const CameraJod& camera : jods) sum += camera.*of;
  return sum / static_cast<double>(jods.size());
}

double ImageComparison::min_jod() const {
  const auto worst =
      std::min_element(jods.begin(), jods.end(),
                       [](const CameraJod& x, const CameraJod& y) { return x.jod < y.jod; });
  return worst->jod;
}

size_t ImageComparison::worst() const {
  const auto at = std::max_element(
      views.begin(), views.end(),
      [](const ViewFidelity& x, const ViewFidelity& y) { return x.fidelity.mse < y.fidelity.mse; });
  return static_cast<size_t>(at - views.begin());
}

ImageComparison compare_images(RenderedScene& a, RenderedScene& b, const CameraViews& all,
                               bool images, const Lpips* lpips, uint32_t threads,
                               Observer& observer, const JodDisplay* display) {
  using Clock = std::chrono::steady_clock;
  std::vector<std::vector<size_t>> parts;
  if (images) {
    parts = parts_of(all);
  } else {
    parts.emplace_back(all.views.size());
    std::iota(parts[0].begin(), parts[0].end(), size_t{0});
  }
  ImageComparison result;
  result.has_images = images;
  result.display = display;
  Videos videos(all, images, display, threads);
  if (lpips != nullptr) {
    result.lpips = lpips->network();
    for (const io::View& view : all.views) {
      const l4d_camera& camera = all.set.cameras[view.camera].camera;
      lpips->check_size(camera.width, camera.height);
    }
  }
  result.views.resize(all.views.size());
  const auto error_of = [&](const io::Image& x, const io::Image& y,
                            const std::vector<uint8_t>& mask = {}) {
    const auto distance = [&] {
      return lpips->distance(io::masked(x, mask), io::masked(y, mask), threads);
    };
    return ImageError{io::mse(x, y, mask), io::ssim(x, y, threads, mask),
                      lpips == nullptr ? 0 : distance()};
  };
  io::Image image_a, image_b;
  size_t done = 0;
  for (const std::vector<size_t>& part : parts) {
    std::optional<CapturedImages> captured;
    if (images) captured.emplace(all, part, observer);
    for (const size_t index : videos.order_of(part)) {
      observer.check();
      observer.update(done++, all.views.size(), "rendering");
      ViewFidelity& out = result.views[index];
      out.view = all.views[index];
      const io::Camera& camera = all.set.cameras[out.view.camera];
      out.camera = camera.id;
      const Clock::time_point begun = Clock::now();
      a.set_time(out.view.time);
      a.render(camera.camera, &image_a);
      b.set_time(out.view.time);
      b.render(camera.camera, &image_b);
      result.render_seconds += std::chrono::duration<double>(Clock::now() - begun).count();
      out.fidelity = error_of(image_a, image_b);
      if (!captured) {
        videos.add(index, image_a, image_b, nullptr);
        continue;
      }
      const CapturedImage seen = captured->image(index);
      out.a = error_of(image_a, seen.image, seen.mask);
      out.b = error_of(image_b, seen.image, seen.mask);
      videos.add(index, image_a, image_b, &seen.image);
    }
  }
  result.jods = videos.take();
  return result;
}

io::Image side_by_side(RenderedScene& a, RenderedScene& b, const CameraViews& views,
                       const io::View& view, double gain) {
  const l4d_camera& camera = views.set.cameras[view.camera].camera;
  io::Image image_a, image_b;
  a.set_time(view.time);
  a.render(camera, &image_a);
  b.set_time(view.time);
  b.render(camera, &image_b);
  const io::Image error = io::error_map(image_a, image_b, gain);
  return io::side_by_side({std::move(image_a), std::move(image_b), error});
}

}  // namespace l4d::eval
