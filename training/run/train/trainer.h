// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "io/ply/weights.h"
#include "training/images/store.h"
#include "training/run/setup/settings.h"
#include "training/step/backend.h"
#include "training/step/residence.h"
#include "training/step/schedule.h"

namespace l4d::train {

// The back end holds fewer rows than one window of images needs.
class CapacityError : public io::Error {
 public:
  explicit CapacityError(const std::string& what) : Error(L4D_ERR_LIMIT_EXCEEDED, what) {}
};

// What is known of a training camera beyond its capture (run/train/refine.h).
struct RefinedCamera {
  CameraChange change{};
  CameraChange m{};                 // mean of the loss's derivative
  std::array<double, 64> square{};  // and of its outer product, [8, 8]
  double updates = 0;
};

// What changes besides the model, and is part of a checkpoint.
struct RunState {
  uint64_t step = 0;         // steps done
  double seconds = 0;        // of all runs
  double loss_average = 0;   // moving average; 0 = none yet
  uint64_t high_losses = 0;  // steps in a row whose loss is above 3 x the average
  uint64_t lost = 0;         // steps in a row whose loss is not finite
  double rate_factor = 1;
  bool swept = false;               // what shows nothing has been removed
  uint64_t prunes = 0;              // done, of --codec prune and settle
  uint64_t settles = 0;             // likewise, of --codec settle
  std::vector<double> camera_loss;  // moving averages by camera; 0 = none yet
  // Of trainings whose model is not all in the back end.
  uint64_t windows = 0;  // of images that steps draw from; 0 = all that are in memory
  uint64_t period = 0;   // 1 + that of the images for which rows were last moved; 0 = none yet
  std::vector<RefinedCamera> refined;  // by camera; empty: they stay as the capture has them
};

// What a step came to.
struct StepReport {
  uint64_t step = 0;
  double progress = 0;
  double loss = 0;  // of the step's views
  double psnr = 0;  // dB, of their mean squared error
  uint64_t count = 0;
  DensityChange density;
  // Of each view, by its camera and clock; only where cameras are refined.
  std::vector<uint32_t> views;
  std::vector<ViewGradient> view_gradients;
  uint64_t skipped_rows = 0;
};

// The losses are not finite or grow without bound. `view`: where it began.
class Diverged : public std::runtime_error {
 public:
  Diverged(uint64_t step, const std::string& view)
      : std::runtime_error("the loss is not finite, or has risen without bound, at step " +
                           std::to_string(step) + ", " + view),
        step_(step) {}
  uint64_t step() const { return step_; }

 private:
  uint64_t step_;
};

// Trains a model on a capture, one step at a time. Everything that a step does follows from the
// settings, the state and the number of the step: a trainer that gets the state of another goes on
// with the same bits. The arguments are borrowed.
class Trainer {
 public:
  // settings: resolved. store: of the instants for training. residence: of the back end, if a part
  // of the model is away from it; NULL = all of it stays there.
  Trainer(const Settings& settings, const Capture& capture, const ImageLoader& loader,
          const std::vector<Instant>& instants, ImageStore* store, Backend* backend,
          uint32_t threads = 0, Residence* residence = nullptr);

  // The capacity of the model's arrays is that of the back end, unless there is a residence.
  void start(ModelState model);
  void restore(ModelState model, const RunState& state);
  ModelState model() const;
  uint64_t count() const { return residence_ ? residence_->count() : backend_->count(); }
  const RunState& state() const { return state_; }
  RunState& state() { return state_; }
  bool done() const;
  double progress() const;

  // --codec is going to remove rows. A training does not end before.
  bool has_rows_to_remove() const;
  // Removes rows that show nothing, as the last part of a training does.
  void end_early();

  // Throws Diverged, and io::Error where images cannot be read.
  StepReport advance();

  // What stands out, once each: for people.
  std::vector<std::string> take_notes();
  // That steps waited until Gaussians had moved between the back end and elsewhere.
  double seconds_swapping() const { return seconds_swapping_; }
  uint64_t steps_per_epoch() const;
  double seconds_left() const;  // where the clock decides; else 0
  const std::vector<Exposure>& exposures() const { return exposures_; }
  // How the training renders a view now.
  io::Image render(uint32_t view);
  bool has_alpha() const { return has_alpha_; }  // the images have
  // Behind what render() shows; black at first.
  void set_background(const Colour& background) { background_ = background; }

 private:
  const Instant& choose_instant(uint64_t* visit) const;
  std::vector<uint32_t> choose_views(const Instant& instant, uint32_t index, uint64_t visit) const;
  StepInput plan_step(double progress, uint64_t step);
  void renew_motion();  // what --consistency-weight pulls rows to
  void update_exposures(const StepOutput& output, const std::vector<uint32_t>& views, double f);
  void guard(const StepReport& report, const StepOutput& output,
             const std::vector<uint32_t>& views);
  void watch_cameras(const StepOutput& output, const std::vector<uint32_t>& views);
  DensityChange change_density(uint64_t step, double f);
  DensityChange relocate(uint64_t step, uint32_t cycle);
  uint64_t growth_at(uint64_t step) const;
  // Moves rows where the images in memory, or rows, have changed.
  void renew_residence();
  [[noreturn]] void fail_for_capacity() const;
  // Removes rows of the whole model. mask: [rows], of which 0 is for those that go.
  void keep(ModelState model, const std::vector<uint8_t>& mask);
  DensityChange follow_gradients(uint64_t step, double f, uint32_t cycle);
  void sweep(uint64_t step);
  // Removes rows by what images lose with them, where --codec asks for that: a share, or those that
  // a stream of a size has no room for.
  void prune(double f);
  std::vector<uint32_t> views_for_prune() const;
  // Measured from training views. time: which of several, for random numbers.
  io::Weights weights_of(const io::Scene& scene, uint64_t time) const;
  // Removes rows that the encoder drops, likewise.
  void settle(double f);
  std::string name_of(uint32_t view) const;

  const Settings settings_;
  const Capture& capture_;
  const ImageLoader& loader_;
  const std::vector<Instant>& instants_;
  ImageStore* store_;
  Backend* backend_;
  const uint32_t threads_;
  Residence* residence_;
  std::vector<TimeInterval> times_;  // of instants
  ScheduleOptions schedule_;
  uint64_t training_views_ = 0;
  bool has_alpha_ = false;
  std::vector<Exposure> exposures_;  // by camera; empty: off
  RunState state_;
  Colour background_{};
  double seconds_swapping_ = 0;
  std::vector<std::string> notes_;
};

}  // namespace l4d::train
