// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "io/file/file.h"
#include "training/run/record/checkpoint.h"
#include "training/run/record/events.h"
#include "training/run/record/folder.h"
#include "training/run/report/run_report.h"
#include "training/run/setup/run_options.h"
#include "training/run/train/refine.h"
#include "training/run/train/sample.h"

namespace l4d::train {

// What a training consists of, from its first step to its report.
struct RunParts {
  using Clock = std::chrono::steady_clock;

  RunParts(const RunOptions& run_options, RunObserver* run_observer)
      : options(run_options),
        observer(run_observer),
        budget("--limit-memory", run_options.limit_memory) {}

  std::string file(const std::string& name) const {
    return (std::filesystem::path(options.folder) / name).string();
  }
  // Text, or the bytes of a stream.
  template <typename Bytes>
  void write(const std::string& name, const Bytes& bytes) const {
    io::OutputFile out(file(name));
    out.write(bytes.data(), bytes.size());
    out.commit();
  }
  void say(const std::string& note) {
    notes.push_back(note);
    observer->note(note);
  }
  void say(const std::vector<std::string>& all) {
    for (const std::string& note : all) say(note);
  }
  // What previews show.
  const Sample& sample() const { return test_sample->empty() ? *train_sample : *test_sample; }

  const RunOptions& options;
  RunObserver* observer;
  std::unique_ptr<FolderLock> lock;
  Clock::time_point started = Clock::now();
  PartTimes times;
  double seconds_before = 0;  // of training, before a resume
  double first_wait = 0;      // for images, before the first step
  io::MemoryBudget budget;
  Capture capture;
  std::unique_ptr<FrameCache> cache;  // outlives the loader
  std::unique_ptr<ImageLoader> loader;
  std::unique_ptr<eval::Lpips> lpips;
  Settings settings;
  std::vector<Instant> instants;
  std::unique_ptr<ImageStore> store;
  std::unique_ptr<Sample> train_sample, test_sample;
  std::unique_ptr<Backend> backend;
  std::unique_ptr<Residence> residence;
  std::unique_ptr<Trainer> trainer;
  std::unique_ptr<Refinement> refinement;  // null: cameras stay as the capture has them
  std::vector<std::string> notes;
};

// The steps of a run, and the checkpoints, logs and previews that they lead to.
class Steps {
 public:
  explicit Steps(RunParts* parts) : parts_(*parts), trainer_(*parts->trainer) {}

  // Gives the trainer the newest checkpoint.
  void resume() { restore(load_newest()); }
  // Until the training is done.
  void run();
  void write_checkpoint();
  void write_preview();
  // The scene so far, for players: fast and not small.
  void write_stream();
  std::string curves() const { return draw_curves(log_->entries()); }
  void write_curves() const { parts_.write("curves.svg", curves()); }
  void finish_writing() { writer_.finish(); }
  // Adds what the steps took.
  void describe(RunReport* report);
  // Rows that are away cannot be kept or found again. A checkpoint of now is written if that is
  // possible; those that are there stay.
  [[noreturn]] void fail_for_buckets(const BucketError& error);

 private:
  using Clock = RunParts::Clock;

  Checkpoint load_newest();
  void restore(Checkpoint checkpoint);
  void save();
  template <typename Part>
  bool within_memory(uint64_t step, uint64_t rows, const Part& part);
  [[noreturn]] void fail_for_memory(const std::string& what, uint64_t step, uint64_t rows);
  bool step();
  bool step_or_save();
  // Whether scores have the figure of --stop-at.
  bool reaches_figure(const LogEntry& entry) const;
  void end_early();
  void write_after_step();
  void write_or_save();
  void add_to_log(bool scores);
  std::array<double, kStages> take_stages();
  // Says of each camera once that it is elsewhere than the capture says.
  void look_for_places();
  void report_progress();

  RunParts& parts_;
  Trainer& trainer_;
  std::unique_ptr<Log> log_;
  std::unique_ptr<EventFile> events_;
  CheckpointWriter writer_{parts_.options.folder};
  Clock::time_point last_checkpoint_, last_preview_;
  double stream_seconds_ = 0;             // that the last one took
  int milestone_ = 0;                     // tenths of the training that have been scored
  std::map<uint32_t, int> elsewhere_;     // how many looks have found cameras elsewhere
  MemoryUse memory_;                      // the largest so far
  std::array<double, kStages> stages_{};  // ms of `timed_steps_` steps
  uint64_t timed_steps_ = 0;
  LogEntry sums_;  // over steps_, since the last entry
  uint64_t steps_ = 0;
  double last_psnr_ = 0, last_score_ = 0;
  bool ends_early_ = false;
};

// Writes what a run leaves at its end: the scene, its stream if there is a preset, and the report.
RunReport write_results(RunParts* parts, Steps* steps);

}  // namespace l4d::train
