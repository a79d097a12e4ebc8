// SPDX-License-Identifier: Apache-2.0
#include "training/images/store.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <exception>
#include <map>
#include <mutex>
#include <numeric>
#include <set>
#include <thread>

#include "training/model/random.h"
#include "training/step/schedule.h"

namespace l4d::train {
namespace {

using io::Error;
using Images = std::map<uint32_t, Pixels>;  // by view
using Cancelled = std::function<bool()>;

constexpr uint64_t kFewWindows = 8;     // in memory, for StoreOptions::few
constexpr uint64_t kShortSequence = 4;  // windows: with fewer, there is no reservoir for it

uint64_t bytes_of(const Pixels& pixels) { return pixels.rgb.size() + pixels.alpha.size(); }

// Reads the images of some instants.
Images read_images(const ImageLoader& loader, const std::vector<Instant>& instants,
                   const std::vector<uint32_t>& which, uint32_t threads,
                   const std::function<void()>& each, const Cancelled& cancelled) {
  std::vector<uint32_t> views;
  for (const uint32_t k : which) {
    views.insert(views.end(), instants[k].views.begin(), instants[k].views.end());
  }
  Images images;
  std::mutex mutex;
  loader.load(
      views, threads,
      [&](uint32_t view, Pixels pixels) {
        const std::lock_guard<std::mutex> lock(mutex);
        images[view] = std::move(pixels);
        if (each) each();
      },
      cancelled);
  return images;
}

class HostStore final : public ImageStore {
 public:
  HostStore(const ImageLoader& loader, const std::vector<Instant>& instants,
            const StoreOptions& options, const std::function<bool(uint64_t, uint64_t)>& progress)
      : all_(instants.size()) {
    std::iota(all_.begin(), all_.end(), 0u);
    uint64_t total = 0, done = 0;
    for (const Instant& instant : instants) total += instant.views.size();
    std::atomic<bool> stop{false};
    images_ = read_images(
        loader, instants, all_, options.threads,
        [&] {
          if (progress && progress(++done, total)) stop = true;
        },
        [&] { return stop.load(); });
    if (stop) throw Error(L4D_ERR_CANCELLED, "cancelled");
    for (const auto& [view, pixels] : images_) bytes_ += bytes_of(pixels);
  }
  void go_to(uint64_t step) override { step_ = step; }
  const std::vector<uint32_t>& instants() const override { return all_; }
  uint64_t period() const override { return 0; }
  uint64_t step_of_period() const override { return step_; }
  uint32_t windows() const override { return 1; }
  void use_windows(uint32_t) override {}
  const Pixels& image(uint32_t view) const override { return images_.at(view); }
  uint64_t bytes() const override { return bytes_; }
  double seconds_waited() const override { return 0; }

 private:
  std::vector<uint32_t> all_;
  Images images_;
  uint64_t bytes_ = 0, step_ = 0;
};

class Reservoir final : public ImageStore {
 public:
  // kept: windows in memory at a time, and one more is being read.
  Reservoir(const ImageLoader& loader, const std::vector<Instant>& instants,
            const StoreOptions& options, uint32_t kept)
      : loader_(loader), instants_(instants), options_(options), kept_(kept), used_(kept) {
    const uint32_t n = static_cast<uint32_t>(instants.size());
    windows_ = (n + options.window - 1) / options.window;
    uint64_t views = 0;
    for (const Instant& instant : instants) views += instant.views.size();
    // A window goes after as many steps as use each of its images `uses` times, where steps draw
    // from all windows alike.
    const double per_window = static_cast<double>(views) / windows_;
    steps_ = static_cast<uint64_t>(std::max(
        1.0, std::ceil(per_window * options.uses / static_cast<double>(options.views_per_step))));
  }
  ~Reservoir() override {
    stop_ = true;
    if (reader_.joinable()) reader_.join();
  }
  Reservoir(const Reservoir&) = delete;
  Reservoir& operator=(const Reservoir&) = delete;

  void go_to(uint64_t step) override {
    step_ = step;
    const uint64_t period = step / steps_;
    if (started_ && period == period_) return;
    const auto since = std::chrono::steady_clock::now();
    std::map<uint32_t, Images> kept;
    for (uint32_t k = 0; k < kept_; ++k) {
      const uint32_t window = window_at(period + k);
      auto found = resident_.find(window);
      if (found != resident_.end()) {
        kept.insert(resident_.extract(found));
      } else if (kept.count(window) == 0) {
        kept[window] = take(window);
      }
    }
    resident_ = std::move(kept);
    period_ = period;
    started_ = true;
    list();
    waited_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
    read_ahead(window_at(period + kept_));
  }
  const std::vector<uint32_t>& instants() const override { return list_; }
  uint64_t period() const override { return period_; }
  uint64_t step_of_period() const override { return step_ - period_ * steps_; }
  uint32_t windows() const override { return used_; }
  void use_windows(uint32_t windows) override {
    used_ = std::clamp<uint32_t>(windows, 1, kept_);
    if (started_) list();
  }
  const Pixels& image(uint32_t view) const override {
    for (const auto& [window, images] : resident_) {
      const auto found = images.find(view);
      if (found != images.end()) return found->second;
    }
    throw Error(L4D_ERR_INTERNAL, "an image is used that is not in memory");
  }
  uint64_t bytes() const override { return bytes_; }
  double seconds_waited() const override { return waited_; }

 private:
  // The windows in the order in which they come: one of each stratum of the sequence in turn, so
  // that those in memory are spread over it. A stratum gives its windows in a permutation, round by
  // round. There is one stratum more than windows in memory, so none is there twice.
  uint32_t window_at(uint64_t position) const {
    const uint64_t strata = kept_ + 1;
    const uint64_t round = position / strata, place = position % strata;
    const uint32_t first = static_cast<uint32_t>(place * windows_ / strata);
    const uint32_t size = static_cast<uint32_t>((place + 1) * windows_ / strata) - first;
    const std::vector<uint32_t> order = permutation(size, options_.seed, place << 32 | round / size,
                                                    static_cast<uint32_t>(Use::kWindows));
    return first + order[round % size];
  }
  std::vector<uint32_t> instants_of_window(uint32_t window) const {
    std::vector<uint32_t> out;
    const uint32_t n = static_cast<uint32_t>(instants_.size());
    const uint32_t begin = window * options_.window;
    for (uint32_t k = begin; k < std::min(begin + options_.window, n); ++k) out.push_back(k);
    return out;
  }
  Images read(uint32_t window) const {
    return read_images(loader_, instants_, instants_of_window(window), options_.threads, nullptr,
                       [this] { return stop_.load(); });
  }
  void read_ahead(uint32_t window) {
    if (resident_.count(window) != 0) return;
    if (reader_.joinable()) reader_.join();
    ahead_ = window;
    ahead_images_.clear();
    error_ = nullptr;
    reader_ = std::thread([this, window] {
      try {
        ahead_images_ = read(window);
      } catch (...) {
        error_ = std::current_exception();
      }
    });
  }
  Images take(uint32_t window) {
    if (reader_.joinable()) {
      reader_.join();
      if (error_) std::rethrow_exception(error_);
      if (ahead_ == window) return std::move(ahead_images_);
    }
    return read(window);
  }
  void list() {
    list_.clear();
    bytes_ = 0;
    std::set<uint32_t> used;
    for (uint32_t k = kept_ - used_; k < kept_; ++k) used.insert(window_at(period_ + k));
    for (const auto& [window, images] : resident_) {
      for (const auto& [view, pixels] : images) bytes_ += bytes_of(pixels);
      if (used.count(window) == 0) continue;
      const std::vector<uint32_t> of_window = instants_of_window(window);
      list_.insert(list_.end(), of_window.begin(), of_window.end());
    }
  }

  const ImageLoader& loader_;
  const std::vector<Instant>& instants_;
  StoreOptions options_;
  uint32_t kept_, used_, windows_ = 0;
  uint64_t steps_ = 1;  // of a period
  uint64_t step_ = 0, period_ = 0;
  bool started_ = false;
  std::map<uint32_t, Images> resident_;  // by window
  std::vector<uint32_t> list_;
  uint64_t bytes_ = 0;
  double waited_ = 0;
  std::thread reader_;
  std::atomic<bool> stop_{false};
  uint32_t ahead_ = 0;
  Images ahead_images_;
  std::exception_ptr error_;
};

}  // namespace

std::vector<Instant> instants_of(const Capture& capture, const char* split) {
  std::vector<Instant> out;
  double frame = 0;
  for (uint32_t k = 0; k < capture.views.size(); ++k) {
    const CaptureView& view = capture.views[k];
    if (capture.cameras[view.camera].split != split) continue;
    const double nearest = std::min(std::round(view.time * capture.fps), capture.frames - 1.0);
    if (out.empty() || nearest > frame) out.push_back({view.time, view.time, {}});
    frame = nearest;
    out.back().last = view.time;
    out.back().views.push_back(k);
  }
  return out;
}

ImageSizes sizes_of(const std::vector<Instant>& instants, uint32_t window,
                    const std::function<uint64_t(uint32_t)>& bytes_of) {
  ImageSizes sizes;
  uint64_t of_window = 0;
  for (size_t k = 0; k < instants.size(); ++k) {
    if (k % window == 0) of_window = 0;
    uint64_t of_instant = 0;
    for (const uint32_t view : instants[k].views) of_instant += bytes_of(view);
    of_window += of_instant;
    sizes.total += of_instant;
    sizes.largest_window = std::max(sizes.largest_window, of_window);
  }
  return sizes;
}

std::unique_ptr<ImageStore> make_image_store(
    const ImageLoader& loader, const std::vector<Instant>& instants, const StoreOptions& options,
    const std::function<bool(uint64_t, uint64_t)>& progress) {
  const auto [total, largest] = sizes_of(
      instants, options.window, [&](uint32_t view) { return image_bytes(loader.camera_of(view)); });
  const uint64_t windows = (instants.size() + options.window - 1) / options.window;
  const bool few = options.few && windows >= kShortSequence;
  if (total <= options.memory && !few) {
    return std::make_unique<HostStore>(loader, instants, options, progress);
  }
  const uint64_t fit = largest == 0 ? 0 : options.memory / largest;
  if (fit < kLeastWindows) {
    throw Error(L4D_ERR_LIMIT_EXCEEDED,
                "the images of three windows of " + std::to_string(options.window) +
                    " frames take " + std::to_string(kLeastWindows * largest) +
                    " bytes, and --host-memory is " + std::to_string(options.memory));
  }
  uint64_t kept = fit - 1;
  if (few) kept = std::min({kept, kFewWindows, windows / 2});
  return std::make_unique<Reservoir>(loader, instants, options, static_cast<uint32_t>(kept));
}

}  // namespace l4d::train
