// SPDX-License-Identifier: Apache-2.0
#include "training/run/run.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <system_error>

#include "eval/refit/view_encoding.h"
#include "io/camera/write_cameras.h"
#include "io/file/file.h"
#include "io/ply/scene_ply.h"
#include "l4d/render.hpp"
#include "training/capture/capture_hash.h"
#include "training/init/start.h"
#include "training/run/record/checkpoint.h"
#include "training/run/record/events.h"
#include "training/run/record/folder.h"
#include "training/run/report/report.h"
#include "training/run/setup/capacity.h"
#include "training/run/setup/memory.h"
#include "training/run/train/output.h"
#include "training/run/train/sample.h"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using io::Error;

constexpr uint64_t kLogEvery = 100;     // steps
constexpr uint64_t kRenderShare = 16;   // of --limit-memory: renders that an encode keeps
constexpr double kScores = 10;          // while training
constexpr size_t kSampleViews = 12;     // of each split, for them
constexpr uint32_t kMinSize = 8;        // pixels a side of images that are scaled
constexpr uint64_t kMinStart = 120000;  // Gaussians to begin with
// s: of the temporal standard deviations of random points, where a part of the model is away. Those
// of a longer life would be in the back end all the time.
constexpr double kLongestLife = 10;

double since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// Text, or the bytes of a stream.
template <typename Bytes>
void write_whole(const std::string& path, const Bytes& bytes) {
  io::OutputFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
}

// The steps of an encode, as those of a run.
class EncodeObserver : public eval::Observer {
 public:
  explicit EncodeObserver(RunObserver* run) : run_(run) {}
  void update(uint64_t done, uint64_t total, const char* stage) override {
    run_->update(done, total, std::string("encoding: ") + stage);
  }
  bool cancelled() const override { return run_->cancelled(); }

 private:
  RunObserver* run_;
};

class Run {
 public:
  Run(const RunOptions& options, RunObserver* observer)
      : options_(options),
        observer_(observer),
        folder_(options.folder),
        budget_("--limit-memory", options.limit_memory) {}

  RunReport run() {
    if (!options_.preset.empty()) check_preset(options_.preset);
    check(options_.settings);
    if (options_.settings.codec == "settle" && options_.preset.empty()) {
      throw Error(L4D_ERR_INVALID_ARGUMENT, "--codec settle needs --encode PRESET");
    }
    read_network();
    check_folder(options_);
    observer_->update(0, 0, "reading the capture");
    CaptureOptions reading = options_.settings.reading;
    reading.holder = budget_.holder();
    capture_ = read_capture(options_.settings.capture, reading);
    fit_memory();
    loader_ = std::make_unique<ImageLoader>(capture_, options_.settings.scale,
                                            near_of(options_.settings, capture_));
    check_scale();
    for (const std::string& note : capture_.notes) say(note);
    check_sizes(lpips_.get(), capture_, *loader_);
    open_folder();
    const l4d_camera& camera = loader_->camera(0);
    settings_ = resolved(options_.settings, capture_, camera.width, camera.height);
    settings_.host_memory = shares_.images;
    settings_.preset = options_.preset;
    settings_.capture = absolute_path(settings_.capture);
    settings_.capture_hash = hash_of(capture_);
    std::error_code error;
    if (fs::is_regular_file(settings_.init, error)) settings_.init = absolute_path(settings_.init);
    times_.begin(kImages);
    backend_ = settings_.backend == "cuda" ? make_cuda_group(devices_of(settings_.devices))
                                           : make_cpu_backend(options_.threads, shares_.renderer);
    plan_memory();
    read_images();
    trainer_ = std::make_unique<Trainer>(settings_, capture_, *loader_, instants_, store_.get(),
                                         backend_.get(), options_.threads, residence_.get());
    settings_.opacity_weight = opacity_weight_of(settings_, trainer_->has_alpha());
    times_.begin(kStart);
    try {
      begin();
      log_ = std::make_unique<Log>(file("log.jsonl"), trainer_->state().step);
      events_ = std::make_unique<EventFile>(file("events.out.tfevents.l4dtrain"), log_->entries());
      loop();
      return finish();
    } catch (const BucketError& rows) {
      fail_for_buckets(rows);
    }
  }

 private:
  std::string file(const std::string& name) const { return (fs::path(folder_) / name).string(); }

  void say(const std::string& note) {
    notes_.push_back(note);
    observer_->note(note);
  }

  // As it is stored, and as it is used.
  void read_network() {
    std::error_code error;
    if (!options_.lpips.empty()) lpips_bytes_ = fs::file_size(options_.lpips, error);
    if (error) lpips_bytes_ = 0;  // reading it says why
    network_memory_ = budget_.take(2 * lpips_bytes_, options_.lpips + ": the network of --lpips");
    lpips_ = read_lpips(options_.lpips, budget_.holder());
  }

  // Before anything large is allocated.
  void fit_memory() {
    network_memory_.reset();  // it is counted with the scores
    shares_ = share_memory(options_, capture_, lpips_.get(), lpips_bytes_, budget_.held());
    if (shares_.training > 0) training_memory_ = budget_.take(shares_.training, "the training");
  }

  // Images that were small before they are scaled are as the user has them.
  void check_scale() const {
    const double scale = options_.settings.scale;
    for (uint32_t k = 0; k < capture_.cameras.size() && scale < 1; ++k) {
      const l4d_camera& camera = loader_->camera(k);
      if (std::min(camera.width, camera.height) >= kMinSize) continue;
      char number[40];
      std::snprintf(number, sizeof(number), "%g", scale);
      throw Error(L4D_ERR_INVALID_ARGUMENT,
                  "--scale is " + std::string(number) + "; it makes images of " +
                      std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                      " pixels, which must be at least " + std::to_string(kMinSize) + " a side");
    }
  }

  void open_folder() {
    lock_ = std::make_unique<FolderLock>(folder_);
    // Again, since another training may have come and gone.
    check_folder(options_);
  }

  // All that can be refused has been refused: the files of a run that was here go. They go when the
  // new settings are on the disk, as far as these can be written, and before these have their name.
  void replace_run() {
    if (observer_->cancelled()) throw Error(L4D_ERR_CANCELLED, "cancelled before the first step");
    io::OutputFile settings(file("settings.json"));
    const std::string text = json_of(settings_) + "\n";
    settings.write(text.data(), text.size());
    remove_results(folder_);
    settings.commit();
  }

  // Decides how much of the model is in the back end.
  void plan_memory() {
    StepSize size;
    size.sh_degree = settings_.sh_degree;
    size.views = settings_.views;
    for (uint32_t k = 0; k < capture_.cameras.size(); ++k) {
      size.width = std::max(size.width, loader_->camera(k).width);
      size.height = std::max(size.height, loader_->camera(k).height);
    }
    std::vector<std::string> notes;
    settle_capacity(&settings_, backend_->cost(size), &notes);
    for (const std::string& note : notes) say(note);
    if (settings_.device_memory != 0) backend_->limit_memory(settings_.device_memory);
    remove_buckets(file("buckets"));
    if (!is_partly_away(settings_)) return;
    BucketOptions buckets;
    buckets.memory = options_.bucket_memory;
    buckets.folder = file("buckets");
    buckets.duration = capture_.duration();
    residence_ = std::make_unique<Residence>(backend_.get(), buckets, settings_.resident);
  }

  void read_images() {
    instants_ = instants_of(capture_, "train");
    if (!options_.cache.empty()) open_cache();
    StoreOptions store;
    store.memory = settings_.host_memory;
    store.threads = options_.threads;
    store.seed = settings_.seed;
    store.views_per_step = settings_.views;
    store.few = residence_ != nullptr;
    store_ = make_image_store(*loader_, instants_, store, [&](uint64_t done, uint64_t total) {
      observer_->update(done, total, "reading images");
      return observer_->cancelled();
    });
    train_sample_ =
        std::make_unique<Sample>(capture_, *loader_, "train", kSampleViews, options_.threads);
    test_sample_ =
        std::make_unique<Sample>(capture_, *loader_, "test", kSampleViews, options_.threads);
    if (cache_ && !cache_->is_writable()) say(cache_->trouble());
  }

  // If images do not fit into memory, each is read several times: all videos are decoded once, in
  // order. Otherwise reading the images fills the cache.
  void open_cache() {
    const auto is_video = [](const CaptureCamera& camera) { return camera.is_video(); };
    if (std::none_of(capture_.cameras.begin(), capture_.cameras.end(), is_video)) {
      return say("The capture has no videos, so that --cache has nothing to keep.");
    }
    observer_->update(0, 0, "opening the cache");
    cache_ = std::make_unique<FrameCache>(
        options_.cache, FrameCache::key_of(capture_, settings_.scale), options_.cache_bytes);
    loader_->use(cache_.get());
    const auto bytes_of = [&](uint32_t view) { return image_bytes(loader_->camera_of(view)); };
    const uint64_t bytes = sizes_of(instants_, StoreOptions().window, bytes_of).total;
    if (bytes <= settings_.host_memory && !residence_) return;
    loader_->fill_cache("train", options_.threads, [&](uint64_t done, uint64_t total) {
      observer_->update(done, total, "filling the cache");
      return observer_->cancelled();
    });
  }

  void begin() {
    if (options_.resume) {
      restore(load_newest());
      seconds_before_ = trainer_->state().seconds;
      return write_whole(file("settings.json"), json_of(settings_) + "\n");
    }
    place_gaussians();
    replace_run();
  }

  void place_gaussians() {
    observer_->update(0, 0, "placing the first Gaussians");
    StartOptions start;
    start.capacity = settings_.gaussians;
    start.count = std::min(settings_.gaussians, kMinStart);
    // Until they have children of shorter lives, most of them are needed at a time.
    if (residence_)
      start.count = std::min(start.count, std::max<uint64_t>(settings_.resident / 2, 1));
    start.sh_degree = settings_.sh_degree;
    start.seed = settings_.seed;
    if (residence_) start.longest = kLongestLife;
    store_->go_to(0);
    std::vector<Point> points = first_points(start.count);
    const size_t found = points.size();
    const uint64_t added = fill_up(capture_, start.count, settings_.seed, &points);
    if (added > 0) {
      say("There are only " + std::to_string(found) + " points to begin with; " +
          std::to_string(added) + " random ones are added.");
    }
    start.count = std::max<uint64_t>(start.count, points.size());
    if (residence_) start.capacity = std::min(start.capacity, start.count);
    trainer_->start(start_model(capture_, points, start));
  }

  std::vector<Point> first_points(uint64_t count) {
    const std::string& init = settings_.init;
    std::vector<std::string> notes;
    const auto noted = [&](std::vector<Point> points) {
      note_points(capture_, points, &notes);
      for (const std::string& note : notes) say(note);
      return points;
    };
    if (init == "capture") return noted(capture_.points);
    if (init == "hull" || init == "auto") {
      std::vector<Point> points =
          hull_points(capture_, *loader_, instants_, *store_, count, settings_.seed);
      if (!points.empty()) return points;
      if (init == "hull") {
        throw Error(L4D_ERR_INVALID_ARGUMENT,
                    "--init is hull, but no point is inside the alpha of all images");
      }
    }
    if (init == "frustum" || init == "auto") return random_points(capture_, count, settings_.seed);
    return noted(read_points(init, &notes));
  }

  Checkpoint load_newest() {
    std::vector<std::string> notes;
    Checkpoint checkpoint = newest_checkpoint(folder_, &notes);
    for (const std::string& note : notes) say(note);
    return checkpoint;
  }

  void restore(Checkpoint checkpoint) {
    check_resumes(folder_, checkpoint, settings_, capture_, options_.accept_changes);
    // Another capacity may hold the rows of all windows again.
    const std::string capacity = "\nresident " + std::to_string(settings_.resident) + "\n";
    if (checkpoint.settings.find(capacity) == std::string::npos) {
      checkpoint.run.windows = checkpoint.run.period = 0;
    }
    trainer_->restore(std::move(checkpoint.model), checkpoint.run);
  }

  void write_checkpoint() {
    times_.begin(kWriting);
    Checkpoint checkpoint;
    checkpoint.settings = text_of(settings_);
    checkpoint.run = trainer_->state();
    checkpoint.model = trainer_->model();
    writer_.write(checkpoint);
    last_checkpoint_ = Clock::now();
  }

  void write_preview() {
    times_.begin(kScoring);
    const Sample& sample = test_sample_->empty() ? *train_sample_ : *test_sample_;
    io::write_png(file("preview.png"), sample.preview(trainer_.get()));
    last_preview_ = Clock::now();
  }

  void loop() {
    last_checkpoint_ = last_preview_ = Clock::now();
    first_wait_ = store_->seconds_waited();
    Clock::time_point step_begin = Clock::now();
    milestone_ = static_cast<int>(trainer_->progress() * kScores);
    while (!trainer_->done()) {
      if (observer_->cancelled()) {
        write_checkpoint();
        writer_.finish();
        throw Error(L4D_ERR_CANCELLED, "cancelled at step " +
                                           std::to_string(trainer_->state().step) +
                                           "; --resume goes on from there");
      }
      step_begin = Clock::now();
      times_.begin(kSteps);
      const uint64_t step = trainer_->state().step, rows = trainer_->count();
      const bool has_stepped = within_memory(step, rows, [&] { return step_or_save(); });
      if (!has_stepped) continue;
      trainer_->state().seconds += since(step_begin);
      within_memory(trainer_->state().step, trainer_->count(), [&] {
        write_or_save();
        return true;
      });
    }
  }

  // Runs a part of the loop, which began after `step` steps with `rows` Gaussians.
  template <typename Part>
  bool within_memory(uint64_t step, uint64_t rows, const Part& part) {
    try {
      return part();
    } catch (const std::bad_alloc&) {
      fail_for_memory("out of memory", step, rows);
    } catch (const fs::filesystem_error&) {
      throw;
    } catch (const std::system_error& error) {  // a thread that got no stack
      fail_for_memory(error.what(), step, rows);
    } catch (const Error& error) {
      if (error.status() != L4D_ERR_OUT_OF_MEMORY) throw;
      fail_for_memory(error.what(), step, rows);
    } catch (const l4d::Error& error) {
      const l4d_status status = error.status();
      if (status != L4D_ERR_OUT_OF_MEMORY && status != L4D_ERR_LIMIT_EXCEEDED) throw;
      fail_for_memory(error.what(), step, rows);
    }
  }

  // Where a part of a step is done, or rows were on their way, the model is not one to go on with:
  // the checkpoints that are there stay. A step counts once it has changed Gaussians.
  [[noreturn]] void fail_for_memory(const std::string& what, uint64_t step, uint64_t rows) {
    try {
      if (trainer_->state().step == step && trainer_->model().count == rows) write_checkpoint();
      writer_.finish();
    } catch (const std::exception&) {
      // Likely for the same reason.
    }
    throw Error(L4D_ERR_OUT_OF_MEMORY, "step " + std::to_string(trainer_->state().step) + ": " +
                                           what + "; " + where_it_goes_on());
  }

  std::string where_it_goes_on() const {
    const std::vector<std::string> there = list_checkpoints(folder_);
    return there.empty() ? "there is no checkpoint to resume from"
                         : "--resume goes on from " + there.front();
  }

  // What a step leads to in files. Where one cannot be written, as on a full disk, the work so far
  // is kept if that is possible, and the message says from where it goes on.
  void write_or_save() {
    try {
      write_after_step();
    } catch (const Error& error) {
      if (error.status() != L4D_ERR_IO) throw;
      try {
        write_checkpoint();
        writer_.finish();
      } catch (const std::exception&) {
        // Likely for the same reason: the checkpoints that are there stay.
      }
      throw Error(error.status(), std::string(error.what()) + "; " + where_it_goes_on());
    }
  }

  void write_after_step() {
    for (const std::string& note : trainer_->take_notes()) say(note);
    const int now = static_cast<int>(trainer_->progress() * kScores);
    const bool scores = now != milestone_;
    milestone_ = now;
    if (scores || trainer_->state().step % kLogEvery == 0) add_to_log(scores);
    if (since(last_checkpoint_) > options_.checkpoint_seconds || observer_->wants_checkpoint()) {
      write_checkpoint();
    }
    if (since(last_preview_) > options_.preview_seconds) write_preview();
    report_progress();
  }

  // Images are read before a step changes anything. Where one is not there or damaged, the work so
  // far is kept.
  bool step_or_save() {
    try {
      return step();
    } catch (const BucketError&) {
      throw;  // no image is to blame
    } catch (const CapacityError& error) {
      write_checkpoint();
      writer_.finish();
      throw Error(error.status(),
                  std::string(error.what()) +
                      "; --resume --accept-changes with a larger --resident goes on");
    } catch (const Error& error) {
      if (error.status() != L4D_ERR_IO && error.status() != L4D_ERR_CORRUPT &&
          error.status() != L4D_ERR_FEATURE_UNSUPPORTED) {
        throw;
      }
      write_checkpoint();
      writer_.finish();
      throw Error(error.status(),
                  std::string(error.what()) + "; --resume --accept-changes goes on from step " +
                      std::to_string(trainer_->state().step) + " when the image is right");
    }
  }

  // Rows that are away cannot be kept or found again. A checkpoint of now is written if that is
  // possible; those that are there stay.
  [[noreturn]] void fail_for_buckets(const BucketError& error) {
    try {
      write_checkpoint();
      writer_.finish();
    } catch (const Error&) {
      // On a full disk, or where rows are lost.
    }
    throw Error(error.status(), std::string(error.what()) + "; " + where_it_goes_on());
  }

  MemoryUse memory_use() const { return train::memory_use(*backend_, *store_, residence_.get()); }

  // False where the training went back to a checkpoint.
  bool step() {
    try {
      const StepReport report = trainer_->advance();
      ++steps_;
      memory_.raise_to(memory_use());
      loss_ += report.loss;
      psnr_ += report.psnr;
      gaussians_ = report.count;
      relocated_ += report.density.relocated;
      born_ += report.density.born;
      skipped_ += report.skipped_rows;
      return true;
    } catch (const Diverged& diverged) {
      writer_.finish();
      if (trainer_->state().rate_factor < 1 || list_checkpoints(folder_).empty()) {
        throw TrainingFailed(diverged.what());
      }
      Checkpoint checkpoint = load_newest();
      checkpoint.run.rate_factor *= 0.5;
      checkpoint.run.lost = checkpoint.run.high_losses = 0;
      say(std::string(diverged.what()) + ": going on from step " +
          std::to_string(checkpoint.run.step) + " with half the rates");
      restore(std::move(checkpoint));
      return false;
    }
  }

  void add_to_log(bool scores) {
    times_.begin(kWriting);
    LogEntry entry;
    entry.step = trainer_->state().step;
    entry.seconds = trainer_->state().seconds;
    entry.progress = trainer_->progress();
    const double n = static_cast<double>(std::max<uint64_t>(steps_, 1));
    entry.loss = loss_ / n;
    entry.psnr = psnr_ / n;
    entry.gaussians = gaussians_;
    entry.relocated = relocated_;
    entry.born = born_;
    entry.skipped_rows = skipped_;
    entry.image_bytes = store_->bytes();
    entry.image_wait = store_->seconds_waited();
    entry.swaps = trainer_->seconds_swapping();
    entry.memory = memory_use();
    entry.stages = take_stages();
    for (double& stage : entry.stages) stage /= n;
    entry.has_score = scores;
    if (scores) {
      times_.begin(kScoring);
      entry.train = train_sample_->score(trainer_.get());
      entry.test = test_sample_->score(trainer_.get());
      last_score_ = entry.test.plain.mean_psnr;
      backend_->take_seconds();
      times_.begin(kWriting);
    }
    log_->add(entry);
    events_->add(entry);
    steps_ = relocated_ = born_ = skipped_ = 0;
    last_psnr_ = entry.psnr;
    loss_ = psnr_ = 0;
    if (scores) write_whole(file("curves.svg"), draw_curves(log_->entries()));
  }

  // ms of the steps since the last call.
  std::array<double, kStages> take_stages() {
    std::array<double, kStages> stages = backend_->take_seconds();
    for (size_t s = 0; s < kStages; ++s) {
      stages[s] *= 1000;
      stages_[s] += stages[s];
    }
    timed_steps_ += steps_;
    return stages;
  }

  void report_progress() {
    char text[120];
    std::snprintf(text, sizeof(text), "training  %.2f dB, test %.2f dB, %llu Gaussians", last_psnr_,
                  last_score_, static_cast<unsigned long long>(gaussians_));
    const uint64_t total = settings_.seconds > 0 ? 1000 : settings_.steps;
    const uint64_t done = settings_.seconds > 0 ? static_cast<uint64_t>(1000 * trainer_->progress())
                                                : trainer_->state().step;
    observer_->update(done, total, text);
  }

  RunReport finish() {
    write_checkpoint();
    observer_->update(0, 0, "writing the scene");
    times_.begin(kWriting);
    const ModelState model = trainer_->model();
    io::Scene scene = scene_of(model, capture_.timeline());
    scene.presentation = first_view(capture_, *loader_);
    io::write_l4d_ply(file("scene.ply"), scene);
    scene.presentation = as_read(scene.presentation);  // streams of both have the same bytes
    io::write_cameras(file("cameras.json"), views_of(capture_, *loader_, "train").set);
    write_preview();
    times_.begin(kWriting);
    write_whole(file("curves.svg"), draw_curves(log_->entries()));

    RunReport report = describe_capture(capture_, *loader_);
    report.settings = settings_;
    report.steps = trainer_->state().step;
    report.gaussians = model.count;
    report.memory = memory_;
    report.training_seconds = trainer_->state().seconds;
    if (settings_.backend == "cuda") report.devices = devices_of(settings_.devices);
    take_stages();
    const double timed = static_cast<double>(std::max<uint64_t>(timed_steps_, 1));
    for (size_t s = 0; s < kStages; ++s) report.stages[s] = stages_[s] / timed;
    if (lpips_) report.lpips = lpips_->network();
    const auto render = [&](uint32_t view) { return trainer_->render(view); };
    observer_->update(0, 0, "comparing with the captured images");
    times_.begin(kComparison);
    report.train = score("train", render);
    report.test = score("test", render);
    times_.begin(kEncoding);
    if (!options_.preset.empty()) encode(scene, &report);
    report.notes = notes_;
    report.seconds =
        times_.seconds(store_->seconds_waited() - first_wait_, trainer_->seconds_swapping());
    report.total_seconds = seconds_before_ + since(started_);
    write_whole(file("report.json"), json_of(report) + "\n");
    writer_.finish();
    return report;
  }

  Score score(const char* split, const RenderView& render) {
    return score_views(capture_, *loader_, views_to_score(capture_, split, kScoredInstants),
                       lpips_.get(), options_.threads, render,
                       [&] { return observer_->cancelled(); });
  }

  void encode(const io::Scene& scene, RunReport* report) {
    observer_->update(0, 0, "encoding");
    EncodeObserver hears(observer_);
    eval::ViewEncodingOptions how;
    how.preset = options_.preset;
    how.rendering.renderer = rendering_of(settings_, options_.threads);
    how.rendering.decoder.threads = options_.threads;
    how.rendering.holder = budget_.holder();
    if (options_.limit_memory > 0) how.max_render_bytes = options_.limit_memory / kRenderShare;
    how.seed = settings_.seed;
    const eval::ViewEncoding made =
        eval::encode_for_views(make_encoder(scene, options_.preset, options_.threads), scene,
                               views_of(capture_, *loader_, "train"), how, hears);
    io::write_weights_ply(file("weights.ply"), made.importance.weights);
    const std::string stream = file("scene.l4d");
    write_whole(stream, made.encoding.stream);
    report->stream_bytes = made.encoding.stream.size();
    if (made.refit) report->stream_fidelity = made.refit->checked();
    StreamViews views(stream, capture_, *loader_, rendering_of(settings_, options_.threads));
    const auto render = [&](uint32_t view) { return views.render(view); };
    const Sample& sample = test_sample_->empty() ? *train_sample_ : *test_sample_;
    io::write_png(file("stream.png"), sample.beside(trainer_.get(), render));
    report->stream_train = score("train", render);
    report->stream_test = score("test", render);
    const std::string note =
        note_of_stream(report->train.plain.mean_psnr, report->stream_train.plain.mean_psnr,
                       settings_.codec == "settle");
    if (!note.empty()) say(note);
  }

  const RunOptions& options_;
  RunObserver* observer_;
  std::string folder_;
  std::unique_ptr<FolderLock> lock_;
  Clock::time_point started_ = Clock::now();
  PartTimes times_;
  double seconds_before_ = 0;  // of training, before a resume
  double first_wait_ = 0;      // for images, before the first step
  io::MemoryBudget budget_;
  std::shared_ptr<void> network_memory_, training_memory_;
  Capture capture_;
  std::unique_ptr<FrameCache> cache_;  // outlives the loader
  std::unique_ptr<ImageLoader> loader_;
  std::unique_ptr<eval::Lpips> lpips_;
  Settings settings_;
  std::vector<Instant> instants_;
  std::unique_ptr<ImageStore> store_;
  std::unique_ptr<Sample> train_sample_, test_sample_;
  std::unique_ptr<Backend> backend_;
  std::unique_ptr<Residence> residence_;
  MemoryUse memory_;  // the largest so far
  std::unique_ptr<Trainer> trainer_;
  std::unique_ptr<Log> log_;
  std::unique_ptr<EventFile> events_;
  CheckpointWriter writer_{folder_};
  Clock::time_point last_checkpoint_, last_preview_;
  uint64_t lpips_bytes_ = 0;
  MemoryShares shares_;
  int milestone_ = 0;                     // tenths of the training that have been scored
  std::array<double, kStages> stages_{};  // ms of `timed_steps_` steps
  uint64_t timed_steps_ = 0;
  uint64_t steps_ = 0, relocated_ = 0, born_ = 0, skipped_ = 0, gaussians_ = 0;
  double loss_ = 0, psnr_ = 0, last_psnr_ = 0, last_score_ = 0;
  std::vector<std::string> notes_;
};

}  // namespace

RunReport train(const RunOptions& options, RunObserver* observer) {
  return Run(options, observer).run();
}

}  // namespace l4d::train
