// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/evaluate.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <map>
#include <mutex>
#include <numeric>
#include <optional>
#include <set>

#include "libl4dcodec/base/threads.h"
#include "training/images/store.h"

namespace l4d::train {
namespace {

constexpr size_t kBatch = 64;  // images in memory at a time
constexpr uint32_t kMinSsimSize = 11;
constexpr size_t kPixelGrain = size_t{1} << 14;

// Colours of a pixel of a render, and 1.
std::array<double, 4> row_of(const io::Image& render, size_t pixel) {
  std::array<double, 4> row = {0, 0, 0, 1};
  for (size_t k = 0; k < 3; ++k) {
    row[k] = std::clamp(static_cast<double>(render.rgb[3 * pixel + k]), 0.0, 1.0);
  }
  return row;
}

// Three least-squares problems of four unknowns.
struct Equations {
  double normal[4][4] = {}, right[3][4] = {};

  void add(const std::array<double, 4>& row, const float* captured) {
    for (size_t a = 0; a < 4; ++a) {
      for (size_t b = 0; b < 4; ++b) normal[a][b] += row[a] * row[b];
      for (size_t c = 0; c < 3; ++c) right[c][a] += row[a] * static_cast<double>(captured[c]);
    }
  }
  void add(const Equations& other) {
    for (size_t a = 0; a < 4; ++a) {
      for (size_t b = 0; b < 4; ++b) normal[a][b] += other.normal[a][b];
      for (size_t c = 0; c < 3; ++c) right[c][a] += other.right[c][a];
    }
  }
  // By Gauss and Jordan, on all right-hand sides.
  std::array<std::array<double, 4>, 3> solve() {
    for (size_t p = 0; p < 4; ++p) {
      for (size_t a = 0; a < 4; ++a) {
        if (a == p) continue;
        const double factor = normal[a][p] / normal[p][p];
        for (size_t b = 0; b < 4; ++b) normal[a][b] -= factor * normal[p][b];
        for (size_t c = 0; c < 3; ++c) right[c][a] -= factor * right[c][p];
      }
    }
    std::array<std::array<double, 4>, 3> map;
    for (size_t c = 0; c < 3; ++c) {
      for (size_t k = 0; k < 4; ++k) map[c][k] = right[c][k] / normal[k][k];
    }
    return map;
  }
};

// Mean squared error of the captured image against the affine map of the render that is nearest to
// it, over the pixels of a mask. Sums are of pieces of one length, so that they do not depend on
// the number of threads.
double affine_mse(const io::Image& render, const io::Image& captured,
                  const std::vector<uint8_t>& mask, int threads) {
  const size_t n = render.rgb.size() / 3;
  const auto counts = [&](size_t i) { return mask.empty() || mask[i] != 0; };
  const auto counted = static_cast<double>(
      mask.empty() ? n : n - static_cast<size_t>(std::count(mask.begin(), mask.end(), 0)));
  std::vector<Equations> parts((n + kPixelGrain - 1) / kPixelGrain);
  parallel_for(threads, n, kPixelGrain, [&](size_t begin, size_t end) {
    Equations& part = parts[begin / kPixelGrain];
    for (size_t i = begin; i < end; ++i) {
      if (counts(i)) part.add(row_of(render, i), &captured.rgb[3 * i]);
    }
  });
  Equations all;
  for (const Equations& part : parts) all.add(part);
  for (size_t a = 0; a < 4; ++a) all.normal[a][a] += 1e-6 * counted;
  const std::array<std::array<double, 4>, 3> map = all.solve();

  std::vector<double> sums(parts.size());
  parallel_for(threads, n, kPixelGrain, [&](size_t begin, size_t end) {
    double sum = 0;
    for (size_t i = begin; i < end; ++i) {
      if (!counts(i)) continue;
      const std::array<double, 4> row = row_of(render, i);
      for (size_t c = 0; c < 3; ++c) {
        double x = 0;
        for (size_t k = 0; k < 4; ++k) x += map[c][k] * row[k];
        const double d = std::clamp(x, 0.0, 1.0) - static_cast<double>(captured.rgb[3 * i + c]);
        sum += d * d;
      }
    }
    sums[begin / kPixelGrain] = sum;
  });
  return std::accumulate(sums.begin(), sums.end(), 0.0) / (3 * counted);
}

}  // namespace

std::vector<uint32_t> views_to_score(const Capture& capture, const char* split, uint32_t frames) {
  const std::vector<Instant> instants = instants_of(capture, split);
  std::vector<uint32_t> views;
  const size_t n = instants.size();
  const size_t chosen = frames == 0 ? n : std::min<size_t>(n, frames);
  for (size_t k = 0; k < chosen; ++k) {
    const Instant& instant = instants[k * n / chosen];
    views.insert(views.end(), instant.views.begin(), instant.views.end());
  }
  return views;
}

std::vector<uint32_t> views_to_watch(const Capture& capture, const char* split, size_t count) {
  const std::vector<Instant> instants = instants_of(capture, split);
  std::vector<const Instant*> instant_of;  // by view
  for (const Instant& instant : instants) {
    instant_of.insert(instant_of.end(), instant.views.size(), &instant);
  }
  const size_t n = instant_of.size(), chosen = std::min(n, count);
  std::map<uint32_t, size_t> uses;  // by camera
  std::set<uint32_t> views;
  for (size_t k = 0; k < chosen; ++k) {
    const std::vector<uint32_t>& there = instant_of[(2 * k + 1) * n / (2 * chosen)]->views;
    const auto used = [&](uint32_t view) {
      return std::make_pair(views.count(view), uses[capture.views[view].camera]);
    };
    const uint32_t view = *std::min_element(
        there.begin(), there.end(), [&](uint32_t a, uint32_t b) { return used(a) < used(b); });
    views.insert(view);
    ++uses[capture.views[view].camera];
  }
  return {views.begin(), views.end()};
}

Scorer::Psnr Scorer::add(const Pixels& pixels, const std::vector<uint8_t>& mask,
                         const io::Image& image, uint32_t threads) {
  const io::Image captured = io::masked(image_of(pixels, background_), mask);
  const io::Image rendered = io::masked(image, mask);
  const bool has_ssim = std::min(captured.width, captured.height) >= kMinSsimSize;
  const double mse = io::mse(captured, rendered, mask);
  sum_.add(mse, has_ssim ? io::ssim(captured, rendered, threads, mask) : std::nan(""));
  const double affine =
      io::psnr_of_mse(affine_mse(rendered, captured, mask, static_cast<int>(threads)));
  affine_ += affine;
  if (lpips_ != nullptr) distance_ += lpips_->distance(captured, rendered, threads);
  return {io::psnr_of_mse(mse), affine};
}

Score Scorer::score() const {
  Score score;
  score.plain = sum_.result();
  const double views = static_cast<double>(score.plain.views);
  score.psnr_affine = affine_ / views;
  score.lpips = distance_ / views;
  return score;
}

namespace {

// JOD of the videos of cameras, whose views come in the order of their times.
class VideoScores {
 public:
  VideoScores(const Capture& capture, const ImageLoader& loader, const std::vector<uint32_t>& views,
              uint32_t threads)
      : capture_(capture), loader_(loader), threads_(threads) {
    std::map<uint32_t, std::vector<double>> times;
    for (const uint32_t view : views) {
      times[capture.views[view].camera].push_back(capture.views[view].time);
    }
    for (auto& [camera, of] : times) {
      std::sort(of.begin(), of.end());
      videos_[camera].frames = of.size();
      videos_[camera].fps = eval::video_rate(of);
    }
  }

  void add(uint32_t view, const io::Image& captured, const io::Image& rendered) {
    const uint32_t camera = capture_.views[view].camera;
    Video& video = videos_[camera];
    if (video.fps == 0 && video.frames > 1) return;
    if (!video.meter) {
      const l4d_camera& size = loader_.camera(camera);
      video.meter = std::make_unique<eval::JodMeter>(
          size.width, size.height, video.frames, video.fps, *eval::find_jod_display("standard_4k"),
          threads_, io::Hold());
    }
    video.meter->add(rendered, captured);
    if (video.meter->frames().size() < video.frames) return;
    video.jod = video.meter->jod();
    video.meter.reset();
  }
  double jod_of(uint32_t camera) const { return videos_.at(camera).jod; }

 private:
  struct Video {
    size_t frames = 0;
    double fps = 0;  // 0: an image, or not evenly spaced
    std::unique_ptr<eval::JodMeter> meter;
    double jod = std::nan("");
  };
  const Capture& capture_;
  const ImageLoader& loader_;
  const uint32_t threads_;
  std::map<uint32_t, Video> videos_;  // by camera
};

// Scores by camera, and the views that are worst.
class ViewScores {
 public:
  ViewScores(const Capture& capture, const Colour& background)
      : capture_(capture), background_(background), cameras_(capture.cameras.size()) {}

  void add(uint32_t view, const Scorer::Psnr& psnrs, const Pixels& captured,
           const io::Image& rendered) {
    const double psnr = psnrs.plain;
    const CaptureView& of = capture_.views[view];
    CameraScore& camera = cameras_[of.camera];
    camera.min_psnr = camera.views == 0 ? psnr : std::min(camera.min_psnr, psnr);
    camera.psnr += psnr;
    camera.psnr_affine += psnrs.affine;
    ++camera.views;
    if (worst_.size() == kWorst && !(psnr < worst_.back().psnr)) return;
    const std::string beside = io::encode_png(
        io::side_by_side({small(image_of(captured, background_)), small(rendered)}), kLevel);
    if (worst_.size() == kWorst) worst_.pop_back();
    worst_.push_back({capture_.cameras[of.camera].name, of.frame, of.time, psnr, beside});
    std::sort(worst_.begin(), worst_.end(),
              [](const WorstView& a, const WorstView& b) { return a.psnr < b.psnr; });
  }
  // videos: may be null.
  void put(const VideoScores* videos, Score* score) {
    double sum = 0;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      CameraScore& camera = cameras_[c];
      if (camera.views == 0) continue;
      camera.name = capture_.cameras[c].name;
      camera.psnr /= static_cast<double>(camera.views);
      camera.psnr_affine /= static_cast<double>(camera.views);
      if (videos != nullptr) camera.jod = videos->jod_of(static_cast<uint32_t>(c));
      sum += camera.jod;
      score->cameras.push_back(camera);
    }
    score->jod = sum / static_cast<double>(score->cameras.size());
    score->worst = std::move(worst_);
  }

 private:
  static constexpr size_t kWorst = 3;
  static constexpr uint32_t kWidth = 480;
  static constexpr int kLevel = 6;

  io::Image small(const io::Image& image) const {
    if (image.width <= kWidth) return image;
    const auto height = static_cast<uint32_t>(uint64_t{image.height} * kWidth / image.width);
    return image_of(resized(image, {}, kWidth, std::max(height, 1U)), background_);
  }

  const Capture& capture_;
  const Colour background_;
  std::vector<CameraScore> cameras_;
  std::vector<WorstView> worst_;
};

}  // namespace

void for_each_image(const ImageLoader& loader, const std::vector<uint32_t>& views, uint32_t threads,
                    const std::function<void(uint32_t view, const Pixels& pixels)>& visit,
                    const IsCancelled& cancelled) {
  for (size_t begin = 0; begin < views.size(); begin += kBatch) {
    const auto first = views.begin() + static_cast<ptrdiff_t>(begin);
    const auto end = views.begin() + static_cast<ptrdiff_t>(std::min(begin + kBatch, views.size()));
    std::map<uint32_t, Pixels> images;
    std::mutex mutex;
    loader.load(
        std::vector<uint32_t>(first, end), threads,
        [&](uint32_t view, Pixels pixels) {
          const std::lock_guard<std::mutex> lock(mutex);
          images[view] = std::move(pixels);
        },
        cancelled);
    for (auto view = first; view != end; ++view) {
      if (cancelled && cancelled()) throw io::Error(L4D_ERR_CANCELLED, "cancelled");
      visit(*view, images.at(*view));
    }
  }
}

Score score_views(const Capture& capture, const ImageLoader& loader,
                  const std::vector<uint32_t>& views, Scorer scorer, uint32_t threads,
                  const RenderView& render, const IsCancelled& cancelled) {
  ViewScores by_view(capture, scorer.background());
  std::optional<VideoScores> videos;
  if (scorer.measures_jod()) videos.emplace(capture, loader, views, threads);
  // Whole cameras follow each other, so that a video is not opened for each of its frames.
  std::vector<uint32_t> order = views;
  std::stable_sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return capture.views[a].camera < capture.views[b].camera;
  });
  // In a part, cameras of an instant share what the back end has then; videos are whole, one by
  // one.
  for (size_t begin = 0; !videos && begin < order.size(); begin += kBatch) {
    const size_t end = std::min(begin + kBatch, order.size());
    std::sort(order.begin() + static_cast<ptrdiff_t>(begin),
              order.begin() + static_cast<ptrdiff_t>(end));
  }
  const auto compare = [&](uint32_t view, const Pixels& pixels) {
    const io::Image rendered = render(view);
    const std::vector<uint8_t>& mask = loader.mask(capture.views[view].camera);
    by_view.add(view, scorer.add(pixels, mask, rendered, threads), pixels, rendered);
    if (videos) {
      videos->add(view, io::masked(image_of(pixels, scorer.background()), mask),
                  io::masked(rendered, mask));
    }
  };
  for_each_image(loader, order, threads, compare, cancelled);
  Score score = scorer.score();
  by_view.put(videos ? &*videos : nullptr, &score);
  return score;
}

std::vector<std::string> notes_of_cameras(const Score& train) {
  // Cameras of one rig lie within a few decibels; a camera that is half a second or 2 degrees off
  // is many below.
  constexpr size_t kLeastCameras = 5;
  constexpr double kLeastGap = 4, kDeviations = 4, kOfNormal = 1.4826;
  std::vector<std::string> notes;
  std::vector<double> all;
  for (const CameraScore& camera : train.cameras) all.push_back(camera.psnr_affine);
  if (all.size() < kLeastCameras) return notes;
  const auto median = [](std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  const double usual = median(all);
  for (double& value : all) value = std::abs(value - usual);
  const double gap = std::max(kLeastGap, kDeviations * kOfNormal * median(all));
  for (const CameraScore& camera : train.cameras) {
    if (!(camera.psnr_affine < usual - gap)) continue;
    char text[160];
    std::snprintf(text, sizeof(text),
                  " is shown at %.1f dB after fitting colours, where others are at %.1f: its "
                  "place, lens or clock may be wrong.",
                  camera.psnr_affine, usual);
    notes.push_back(camera.name + text);
    notes.back()[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(notes.back()[0])));
  }
  return notes;
}

std::unique_ptr<eval::Lpips> read_lpips(const std::string& path, const io::Hold& holder) {
  if (path.empty()) return nullptr;
  return std::make_unique<eval::Lpips>(eval::Lpips::read(io::InputFile(path, holder), holder));
}

void check_sizes(const eval::Lpips* lpips, const Capture& capture, const ImageLoader& loader) {
  if (lpips == nullptr) return;
  for (const CaptureView& view : capture.views) {
    const l4d_camera& camera = loader.camera(view.camera);
    lpips->check_size(camera.width, camera.height);
  }
}

}  // namespace l4d::train
