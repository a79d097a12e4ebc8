// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdio>
#include <utility>

#include "training/run/run.h"
#include "training/run/run_parts.h"
#include "training/run/setup/memory.h"
#include "training/run/train/output.h"
#include "training/run/train/places.h"

namespace l4d::train {
namespace {

using io::Error;

constexpr uint64_t kLogEvery = 100;  // steps
constexpr double kScores = 10;       // while training
constexpr int kLooks = 2;            // that say so, since one may be chance
constexpr int kPlacesUntil = 5;  // of them: as long as cameras are looked for that are elsewhere
constexpr double kStreamPause = 10;  // between two streams, of the time that one takes

double since(RunParts::Clock::time_point begin) {
  return std::chrono::duration<double>(RunParts::Clock::now() - begin).count();
}

// Of the scores while training: of test views, if there are any.
double figure_of(const LogEntry& entry) {
  return (entry.test.plain.views > 0 ? entry.test : entry.train).plain.mean_psnr;
}

[[noreturn]] void fail(const Error& error, const std::string& advice) {
  throw Error(error.status(), std::string(error.what()) + "; " + advice);
}

}  // namespace

void Steps::run() {
  log_ = std::make_unique<Log>(parts_.file("log.jsonl"), trainer_.state().step);
  events_ =
      std::make_unique<EventFile>(parts_.file("events.out.tfevents.l4dtrain"), log_->entries());
  last_checkpoint_ = last_preview_ = Clock::now();
  parts_.first_wait = parts_.store->seconds_waited();
  milestone_ = static_cast<int>(trainer_.progress() * kScores);
  if (parts_.options.watch) {
    write_stream();
    parts_.say("`l4dcodec view " + parts_.file("preview.l4d") + "` shows the scene as it becomes");
  }
  // A run that has ended at this step, and is resumed with the same figure, has ended.
  const std::vector<LogEntry>& before = log_->entries();
  ends_early_ = !before.empty() && before.back().step == trainer_.state().step &&
                reaches_figure(before.back());
  while (!trainer_.done() && !ends_early_) {
    if (parts_.observer->cancelled()) {
      save();
      throw Error(L4D_ERR_CANCELLED, "cancelled at step " + std::to_string(trainer_.state().step) +
                                         "; --resume goes on from there");
    }
    const Clock::time_point begin = Clock::now();
    parts_.times.begin(kSteps);
    const uint64_t step = trainer_.state().step, rows = trainer_.count();
    const bool has_stepped = within_memory(step, rows, [&] { return step_or_save(); });
    if (!has_stepped) continue;
    trainer_.state().seconds += since(begin);
    within_memory(trainer_.state().step, trainer_.count(), [&] {
      write_or_save();
      return true;
    });
  }
  write_checkpoint();  // of before rows are removed, so that a higher figure goes on from there
  if (trainer_.done()) return;
  within_memory(trainer_.state().step, trainer_.count(), [&] {
    end_early();
    return true;
  });
}

bool Steps::reaches_figure(const LogEntry& entry) const {
  const double wanted = parts_.settings.stop_at;
  return wanted > 0 && entry.has_score && !trainer_.has_rows_to_remove() &&
         figure_of(entry) >= wanted;
}

void Steps::end_early() {
  const LogEntry& last = log_->entries().back();
  char text[160];
  std::snprintf(text, sizeof(text),
                "The training ends after step %llu, at %.0f %%: %s views have %.2f dB, and "
                "--stop-at is %g",
                static_cast<unsigned long long>(last.step), 100 * trainer_.progress(),
                last.test.plain.views > 0 ? "test" : "training", figure_of(last),
                parts_.settings.stop_at);
  parts_.say(text);
  trainer_.end_early();
}

// ---- one step ----------------------------------------------------------------------------------

// False where the training went back to a checkpoint.
bool Steps::step() {
  try {
    const StepReport report = trainer_.advance();
    if (parts_.refinement) parts_.refinement->advance(report);
    ++steps_;
    memory_.raise_to(memory_use(*parts_.backend, *parts_.store, parts_.residence.get()));
    sums_.loss += report.loss;
    sums_.psnr += report.psnr;
    sums_.gaussians = report.count;
    sums_.relocated += report.density.relocated;
    sums_.born += report.density.born;
    sums_.skipped_rows += report.skipped_rows;
    return true;
  } catch (const Diverged& diverged) {
    writer_.finish();
    if (trainer_.state().rate_factor < 1 || list_checkpoints(parts_.options.folder).empty()) {
      throw TrainingFailed(diverged.what());
    }
    Checkpoint checkpoint = load_newest();
    checkpoint.run.rate_factor *= 0.5;
    checkpoint.run.lost = checkpoint.run.high_losses = 0;
    parts_.say(std::string(diverged.what()) + ": going on from step " +
               std::to_string(checkpoint.run.step) + " with half the rates");
    restore(std::move(checkpoint));
    return false;
  }
}

// Images are read before a step changes anything. Where one is not there or damaged, the work so
// far is kept.
bool Steps::step_or_save() {
  try {
    return step();
  } catch (const BucketError&) {
    throw;  // no image is to blame
  } catch (const CapacityError& error) {
    save();
    fail(error, "--resume --accept-changes with a larger --resident goes on");
  } catch (const Error& error) {
    if (error.status() != L4D_ERR_IO && error.status() != L4D_ERR_CORRUPT &&
        error.status() != L4D_ERR_FEATURE_UNSUPPORTED) {
      throw;
    }
    save();
    fail(error, "--resume --accept-changes goes on from step " +
                    std::to_string(trainer_.state().step) + " when the image is right");
  }
}

// Runs a part of the loop, which began after `step` steps with `rows` Gaussians.
template <typename Part>
bool Steps::within_memory(uint64_t step, uint64_t rows, const Part& part) {
  try {
    return part();
  } catch (...) {
    fail_for_memory(lack_of_memory(), step, rows);
  }
}

// Where a part of a step is done, or rows were on their way, the model is not one to go on with:
// the checkpoints that are there stay. A step counts once it has changed Gaussians.
void Steps::fail_for_memory(const std::string& what, uint64_t step, uint64_t rows) {
  try {
    if (trainer_.state().step == step && trainer_.model().count == rows) write_checkpoint();
    writer_.finish();
  } catch (const std::exception&) {
    // Likely for the same reason.
  }
  throw Error(L4D_ERR_OUT_OF_MEMORY, "step " + std::to_string(trainer_.state().step) + ": " + what +
                                         "; " + where_it_goes_on(parts_.options.folder));
}

void Steps::fail_for_buckets(const BucketError& error) {
  try {
    save();
  } catch (const Error&) {
    // On a full disk, or where rows are lost.
  }
  fail(error, where_it_goes_on(parts_.options.folder));
}

// ---- what steps lead to in files ---------------------------------------------------------------

Checkpoint Steps::load_newest() {
  std::vector<std::string> notes;
  Checkpoint checkpoint = newest_checkpoint(parts_.options.folder, &notes);
  parts_.say(notes);
  return checkpoint;
}

void Steps::restore(Checkpoint checkpoint) {
  check_resumes(parts_.options.folder, checkpoint, parts_.settings, parts_.capture,
                parts_.options.accept_changes);
  // Another capacity may hold the rows of all windows again.
  const std::string capacity = "\nresident " + std::to_string(parts_.settings.resident) + "\n";
  if (checkpoint.settings.find(capacity) == std::string::npos) {
    checkpoint.run.windows = checkpoint.run.period = 0;
  }
  trainer_.restore(std::move(checkpoint.model), checkpoint.run);
  if (parts_.refinement) parts_.refinement->use_changes();
}

void Steps::write_checkpoint() {
  parts_.times.begin(kWriting);
  writer_.write({text_of(parts_.settings), trainer_.state(), trainer_.model()});
  last_checkpoint_ = Clock::now();
}

void Steps::save() {
  write_checkpoint();
  writer_.finish();
}

void Steps::write_preview() {
  parts_.times.begin(kScoring);
  io::write_png(parts_.file("preview.png"), parts_.sample().preview(&trainer_));
  if (parts_.options.watch) write_stream();
  last_preview_ = Clock::now();
}

void Steps::write_stream() {
  const Clock::time_point begin = Clock::now();
  io::Scene scene = scene_of(trainer_.model(), parts_.capture.timeline());
  scene.presentation = first_view(parts_.capture, *parts_.loader);
  EncoderHandle encoder = make_encoder(scene, "tiny", parts_.options.threads);
  encoder.set(L4D_ENC_EFFORT, 1);
  encoder.set(L4D_ENC_DROP_INVALID, 1);  // a preview ends no training
  parts_.write("preview.l4d", encoder.encode());
  stream_seconds_ = since(begin);
}

// Where a file cannot be written, as on a full disk, the work so far is kept if that is possible,
// and the message says from where it goes on.
void Steps::write_or_save() {
  try {
    write_after_step();
  } catch (const Error& error) {
    if (error.status() != L4D_ERR_IO) throw;
    try {
      save();
    } catch (const std::exception&) {
      // Likely for the same reason: the checkpoints that are there stay.
    }
    fail(error, where_it_goes_on(parts_.options.folder));
  }
}

void Steps::write_after_step() {
  parts_.say(trainer_.take_notes());
  const int now = static_cast<int>(trainer_.progress() * kScores);
  const bool scores = now != milestone_;
  milestone_ = now;
  if (scores || trainer_.state().step % kLogEvery == 0) add_to_log(scores);
  if (scores && now <= kPlacesUntil) look_for_places();
  if (since(last_checkpoint_) > parts_.options.checkpoint_seconds ||
      parts_.observer->wants_checkpoint()) {
    write_checkpoint();
  }
  const double pause = std::max(parts_.options.preview_seconds, kStreamPause * stream_seconds_);
  if (since(last_preview_) > pause) write_preview();
  report_progress();
}

void Steps::add_to_log(bool scores) {
  parts_.times.begin(kWriting);
  LogEntry entry = sums_;
  entry.step = trainer_.state().step;
  entry.seconds = trainer_.state().seconds;
  entry.progress = trainer_.progress();
  const double n = static_cast<double>(std::max<uint64_t>(steps_, 1));
  entry.loss /= n;
  entry.psnr /= n;
  entry.image_bytes = parts_.store->bytes();
  entry.image_wait = parts_.store->seconds_waited();
  entry.swaps = trainer_.seconds_swapping();
  entry.memory = memory_use(*parts_.backend, *parts_.store, parts_.residence.get());
  entry.stages = take_stages();
  for (double& stage : entry.stages) stage /= n;
  entry.has_score = scores;
  if (scores) {
    parts_.times.begin(kScoring);
    entry.train = parts_.train_sample->score(&trainer_);
    entry.test = parts_.test_sample->score(&trainer_);
    last_score_ = entry.test.plain.mean_psnr;
    parts_.backend->take_seconds();
    parts_.times.begin(kWriting);
    ends_early_ = entry.ends_early = !trainer_.done() && reaches_figure(entry);
  }
  log_->add(entry);
  events_->add(entry);
  last_psnr_ = entry.psnr;
  sums_ = {};
  sums_.gaussians = entry.gaussians;
  steps_ = 0;
  if (scores) write_curves();
}

void Steps::look_for_places() {
  parts_.times.begin(kScoring);
  const auto render = [&](uint32_t view) { return trainer_.render(view); };
  try {
    for (const auto& [camera, note] : notes_of_places(
             parts_.capture, *parts_.loader, parts_.options.threads, parts_.options.background,
             render, [&] { return parts_.observer->cancelled(); })) {
      if (++elsewhere_[camera] == kLooks) parts_.say(note);
    }
  } catch (const BucketError&) {
    throw;  // no image is to blame
  } catch (const Error&) {
    // An image that cannot be read: the step that wants it says so and keeps the work.
  }
}

// ms of the steps since the last call.
std::array<double, kStages> Steps::take_stages() {
  std::array<double, kStages> stages = parts_.backend->take_seconds();
  for (size_t s = 0; s < kStages; ++s) {
    stages[s] *= 1000;
    stages_[s] += stages[s];
  }
  timed_steps_ += steps_;
  return stages;
}

void Steps::report_progress() {
  char text[120];
  std::snprintf(text, sizeof(text), "training  %.2f dB, test %.2f dB, %llu Gaussians", last_psnr_,
                last_score_, static_cast<unsigned long long>(sums_.gaussians));
  const bool timed = parts_.settings.seconds > 0;
  parts_.observer->update(
      timed ? static_cast<uint64_t>(1000 * trainer_.progress()) : trainer_.state().step,
      timed ? 1000 : parts_.settings.steps, text);
}

void Steps::describe(RunReport* report) {
  report->steps = trainer_.state().step;
  report->training_seconds = trainer_.state().seconds;
  report->memory = memory_;
  take_stages();
  const double timed = static_cast<double>(std::max<uint64_t>(timed_steps_, 1));
  for (size_t s = 0; s < kStages; ++s) report->stages[s] = stages_[s] / timed;
}

}  // namespace l4d::train
