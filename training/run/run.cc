// SPDX-License-Identifier: Apache-2.0
#include "training/run/run.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "training/capture/capture_hash.h"
#include "training/init/start.h"
#include "training/run/report/report.h"
#include "training/run/run_parts.h"
#include "training/run/setup/capacity.h"
#include "training/run/setup/memory.h"
#include "training/run/train/output.h"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

constexpr size_t kSampleViews = 12;     // of each split, for scores while training
constexpr uint64_t kMinStart = 120000;  // Gaussians to begin with
// s: of the temporal standard deviations of random points, where a part of the model is away. Those
// of a longer life would be in the back end all the time.
constexpr double kLongestLife = 10;
constexpr int kEnoughCameras = 8;  // for --refine-cameras

class Run {
 public:
  Run(const RunOptions& options, RunObserver* observer)
      : options_(options), observer_(observer), parts_(options, observer) {}

  RunReport run() {
    check_options(options_);
    read_network();
    check_folder(options_);
    read_the_capture();
    parts_.lock = std::make_unique<FolderLock>(options_.folder);
    // Again, since another training may have come and gone.
    check_folder(options_);
    resolve_settings();
    parts_.times.begin(kImages);
    parts_.backend = settings_.backend == "cuda"
                         ? make_cuda_group(devices_of(settings_.devices))
                         : make_cpu_backend(options_.threads, shares_.renderer);
    plan_memory();
    read_images();
    parts_.trainer = std::make_unique<Trainer>(settings_, capture_, *parts_.loader, parts_.instants,
                                               parts_.store.get(), parts_.backend.get(),
                                               options_.threads, parts_.residence.get());
    parts_.trainer->set_background(options_.background);
    if (settings_.refine_times > 0 || settings_.refine_cameras > 0) {
      note_few_cameras();
      parts_.refinement = std::make_unique<Refinement>(settings_, &capture_, parts_.loader.get(),
                                                       parts_.trainer.get());
    }
    settings_.opacity_weight = opacity_weight_of(settings_, parts_.trainer->has_alpha());
    parts_.times.begin(kStart);
    Steps steps(&parts_);
    try {
      begin(&steps);
      steps.run();
      return write_results(&parts_, &steps);
    } catch (const BucketError& rows) {
      steps.fail_for_buckets(rows);
    }
  }

 private:
  // As it is stored, and as it is used.
  void read_network() {
    std::error_code error;
    if (!options_.lpips.empty()) lpips_bytes_ = fs::file_size(options_.lpips, error);
    if (error) lpips_bytes_ = 0;  // reading it says why
    network_memory_ =
        parts_.budget.take(2 * lpips_bytes_, options_.lpips + ": the network of --lpips");
    parts_.lpips = read_lpips(options_.lpips, parts_.budget.holder());
  }

  void read_the_capture() {
    observer_->update(0, 0, "reading the capture");
    CaptureOptions reading = options_.settings.reading;
    reading.holder = parts_.budget.holder();
    capture_ = read_capture(options_.settings.capture, reading);
    if (refine_times_of(options_.settings, capture_) > 0 || options_.settings.refine_cameras > 0) {
      camera_set(capture_);  // which throws where cameras have one image each
    }
    fit_memory();
    const double scale = options_.settings.scale;
    parts_.loader =
        std::make_unique<ImageLoader>(capture_, scale, near_of(options_.settings, capture_));
    check_scale(scale, capture_, *parts_.loader);
    parts_.say(capture_.notes);
    check_sizes(parts_.lpips.get(), capture_, *parts_.loader);
  }

  void note_few_cameras() {
    const auto training =
        std::count_if(capture_.cameras.begin(), capture_.cameras.end(),
                      [](const CaptureCamera& camera) { return camera.split == "train"; });
    if (settings_.refine_cameras == 0 || training >= kEnoughCameras) return;
    parts_.say("Only " + std::to_string(training) +
               " cameras train: so few do not tell errors of places from those of the scene, and "
               "--refine-cameras may move cameras that are right");
  }

  // Before anything large is allocated.
  void fit_memory() {
    network_memory_.reset();  // it is counted with the scores
    shares_ =
        share_memory(options_, capture_, parts_.lpips.get(), lpips_bytes_, parts_.budget.held());
    if (shares_.training > 0)
      training_memory_ = parts_.budget.take(shares_.training, "the training");
  }

  void resolve_settings() {
    const l4d_camera& camera = parts_.loader->camera(0);
    Settings asked = options_.settings;
    if (options_.bitrate > 0) {
      asked.size = static_cast<uint64_t>(options_.bitrate * io::duration(capture_.timeline()));
    }
    settings_ = resolved(asked, capture_, camera.width, camera.height);
    settings_.host_memory = shares_.images;
    settings_.preset = options_.preset;
    settings_.capture = absolute_path(settings_.capture);
    settings_.capture_hash = hash_of(capture_);
    if (!is_init_word(settings_.init)) settings_.init = absolute_path(settings_.init);
  }

  // All that can be refused has been refused: the files of a run that was here go. They go when the
  // new settings are on the disk, as far as these can be written, and before these have their name.
  void replace_run() {
    if (observer_->cancelled()) throw Error(L4D_ERR_CANCELLED, "cancelled before the first step");
    io::OutputFile settings(parts_.file("settings.json"));
    const std::string text = json_of(settings_) + "\n";
    settings.write(text.data(), text.size());
    remove_results(options_.folder);
    settings.commit();
  }

  // Decides how much of the model is in the back end.
  void plan_memory() {
    std::vector<std::string> notes;
    const StepSize size = step_size(settings_, capture_, *parts_.loader);
    settle_capacity(&settings_, parts_.backend->cost(size), &notes);
    parts_.say(notes);
    if (settings_.device_memory != 0) parts_.backend->limit_memory(settings_.device_memory);
    remove_buckets(parts_.file("buckets"));
    if (!is_partly_away(settings_)) return;
    BucketOptions buckets;
    buckets.memory = options_.bucket_memory;
    buckets.folder = parts_.file("buckets");
    buckets.duration = capture_.duration();
    parts_.residence =
        std::make_unique<Residence>(parts_.backend.get(), buckets, settings_.resident);
  }

  // Reports how far something is, and returns whether it is to end.
  auto progress(const char* stage) {
    return [this, stage](uint64_t done, uint64_t total) {
      observer_->update(done, total, stage);
      return observer_->cancelled();
    };
  }

  void read_images() {
    parts_.instants = instants_of(capture_, "train");
    if (!options_.cache.empty()) open_cache();
    StoreOptions store;
    store.memory = settings_.host_memory;
    store.threads = options_.threads;
    store.seed = settings_.seed;
    store.views_per_step = settings_.views;
    store.few = parts_.residence != nullptr;
    parts_.store =
        make_image_store(*parts_.loader, parts_.instants, store, progress("reading images"));
    const auto sample = [&](const char* split) {
      return std::make_unique<Sample>(capture_, *parts_.loader, split, kSampleViews,
                                      options_.background, options_.threads);
    };
    parts_.train_sample = sample("train");
    parts_.test_sample = sample("test");
    if (parts_.cache && !parts_.cache->is_writable()) parts_.say(parts_.cache->trouble());
  }

  // If images do not fit into memory, each is read several times: all videos are decoded once, in
  // order. Otherwise reading the images fills the cache.
  void open_cache() {
    const auto is_video = [](const CaptureCamera& camera) { return camera.is_video(); };
    if (std::none_of(capture_.cameras.begin(), capture_.cameras.end(), is_video)) {
      return parts_.say("The capture has no videos, so that --cache has nothing to keep.");
    }
    observer_->update(0, 0, "opening the cache");
    parts_.cache = std::make_unique<FrameCache>(
        options_.cache, FrameCache::key_of(capture_, settings_.scale), options_.cache_bytes);
    parts_.loader->use(parts_.cache.get());
    const auto bytes_of = [&](uint32_t view) {
      return image_bytes(parts_.loader->camera_of(view));
    };
    const uint64_t bytes = sizes_of(parts_.instants, StoreOptions().window, bytes_of).total;
    if (bytes <= settings_.host_memory && !parts_.residence) return;
    parts_.loader->fill_cache("train", options_.threads, progress("filling the cache"));
  }

  void begin(Steps* steps) {
    if (options_.resume) {
      steps->resume();
      parts_.seconds_before = parts_.trainer->state().seconds;
      return parts_.write("settings.json", json_of(settings_) + "\n");
    }
    place_gaussians();
    replace_run();
  }

  void place_gaussians() {
    observer_->update(0, 0, "placing the first Gaussians");
    const bool partly_away = parts_.residence != nullptr;
    StartOptions start;
    start.capacity = settings_.gaussians;
    start.count = std::min(settings_.gaussians, kMinStart);
    // Until they have children of shorter lives, most of them are needed at a time.
    if (partly_away) {
      start.count = std::min(start.count, std::max<uint64_t>(settings_.resident / 2, 1));
      start.longest = kLongestLife;
    }
    start.sh_degree = settings_.sh_degree;
    start.seed = settings_.seed;
    parts_.store->go_to(0);
    std::vector<std::string> notes;
    std::vector<Point> points =
        first_points(settings_.init, capture_, *parts_.loader, parts_.instants, *parts_.store,
                     start.count, settings_.seed, parts_.budget.holder(), &notes);
    parts_.say(notes);
    const size_t found = points.size();
    const uint64_t added = fill_up(capture_, start.count, settings_.seed, &points);
    if (added > 0) {
      parts_.say("There are only " + std::to_string(found) + " points to begin with; " +
                 std::to_string(added) + " are added near them.");
    }
    start.count = std::max<uint64_t>(start.count, points.size());
    if (partly_away) start.capacity = std::min(start.capacity, start.count);
    parts_.trainer->start(start_model(capture_, points, start));
  }

  const RunOptions& options_;
  RunObserver* observer_;
  RunParts parts_;
  Capture& capture_ = parts_.capture;
  Settings& settings_ = parts_.settings;
  std::shared_ptr<void> network_memory_, training_memory_;
  uint64_t lpips_bytes_ = 0;
  MemoryShares shares_;
};

}  // namespace

void check_options(const RunOptions& options) {
  const Settings& s = options.settings;
  if (!options.preset.empty()) check_preset(options.preset);
  check(s);
  const bool aims = s.size > 0 || options.bitrate > 0 || s.quality > 0;
  if (options.preset.empty() && (aims || s.codec == "settle")) {
    throw Error(
        L4D_ERR_INVALID_ARGUMENT,
        std::string(aims ? "a size or a quality" : "--codec settle") + " needs --encode PRESET");
  }
  if (aims) check_quality(options.preset);
  if ((s.size > 0 || options.bitrate > 0) && s.codec != "prune") {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "--size and --bitrate need --codec prune, which they choose where none is given");
  }
  std::error_code error;
  if (!options.resume && !is_init_word(s.init) && !fs::exists(s.init, error)) {
    throw Error(L4D_ERR_IO,
                "--init is " + s.init +
                    ", and there is no such file; it must be a file of points, a folder "
                    "with one for each frame, or auto, frustum or hull");
  }
}

RunReport train(const RunOptions& options, RunObserver* observer) {
  return Run(options, observer).run();
}

}  // namespace l4d::train
