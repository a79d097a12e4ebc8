// SPDX-License-Identifier: Apache-2.0
// Trainings whose model does not fit in the back end.
#include <gmock/gmock.h>

#include <numeric>

#include "training/run/record/checkpoint.h"
#include "training/run/setup/capacity.h"
#include "training/tests/long_capture.h"

namespace l4d::train {
namespace {

using test::kCameras;
using test::kHeight;
using test::kWidth;
using test::Listener;
using test::LongCapture;

const LongCapture& long_capture() {
  static const LongCapture capture(20);
  return capture;
}

// Rows that leave and come back change no bit, in memory or in files, whatever is shown meanwhile.
TEST(TrainingInParts, IsAsWithAllRowsInTheBackEnd) {
  const LongCapture& capture = long_capture();
  Listener listener;
  RunOptions options = capture.run("all", 160, 0);
  options.settings.density = "off";
  const RunReport all = train(options, &listener);
  EXPECT_EQ(all.memory.away, 0U);
  const std::string whole = capture.scene("all");
  ASSERT_FALSE(whole.empty());

  options = capture.run("memory", 160, 1500);
  options.settings.density = "off";
  const RunReport parts = train(options, &listener);
  EXPECT_TRUE(whole == capture.scene("memory"));
  EXPECT_EQ(parts.gaussians, all.gaussians);
  EXPECT_GT(parts.memory.away, 1000U);
  EXPECT_LE(parts.memory.resident, 1500U);
  EXPECT_LT(parts.memory.backend.model, all.memory.backend.model / 2);
  EXPECT_EQ(parts.train.plain.mean_psnr, all.train.plain.mean_psnr);

  options = capture.run("files", 160, 1500);
  options.settings.density = "off";
  options.bucket_memory = 100000;
  options.preview_seconds = 0;  // after each step: another instant is shown
  const RunReport files = train(options, &listener);
  EXPECT_TRUE(whole == capture.scene("files"));
  EXPECT_GT(files.memory.bucket_files, 100000U);
  EXPECT_FALSE(std::filesystem::exists(capture.folder / "files/buckets"));
}

// With relocation, births and pruning, too, files and memory are alike, and a run that is
// interrupted goes on with the same bits.
TEST(TrainingInParts, RepeatsAndResumes) {
  const LongCapture& capture = long_capture();
  Listener listener;
  RunOptions options = capture.run("density", 210, 1600);
  options.settings.codec = "prune";
  const RunReport whole = train(options, &listener);
  EXPECT_GT(whole.memory.away, 800U);
  EXPECT_LE(whole.memory.resident, 1600U);
  // Rows that were away have not been taken for dead: what is left is what prune leaves.
  EXPECT_GT(whole.gaussians, 800U);
  EXPECT_LE(whole.gaussians, 1700U);
  // Each second belongs to one part.
  const auto& seconds = whole.seconds;
  for (const double part : seconds) EXPECT_GE(part, 0);
  EXPECT_GT(seconds[kSwaps], 0);
  EXPECT_NEAR(std::accumulate(seconds.begin(), seconds.end(), 0.0), whole.total_seconds, 0.05);
  EXPECT_NEAR(seconds[kSteps] + seconds[kImageWait] + seconds[kSwaps], whole.training_seconds,
              0.05);

  options = capture.run("interrupted", 210, 1600);
  options.settings.codec = "prune";
  options.bucket_memory = 0;
  options.preview_seconds = 0.05;
  for (const uint64_t steps : {53U, 76U}) {
    Listener first(steps);
    EXPECT_THROW(train(options, &first), io::Error);
    options.resume = true;
  }
  train(options, &listener);
  EXPECT_TRUE(capture.scene("density") == capture.scene("interrupted"));
}

// Ten times the length takes no more of the back end.
TEST(TrainingInParts, HasAMemoryThatLengthDoesNotRaise) {
  const LongCapture brief(2);
  Listener listener;
  RunOptions options = brief.run("run", 60, 0);
  options.settings.gaussians = 1000;
  options.settings.host_memory = uint64_t{1} << 30;
  const RunReport short_report = train(options, &listener);
  RunOptions long_options = long_capture().run("long", 240, 1000);
  long_options.settings.host_memory = uint64_t{3} * 8 * (kCameras - 1) * kWidth * kHeight * 4;
  long_options.settings.gaussians = 10000;
  const RunReport long_report = train(long_options, &listener);
  EXPECT_GE(long_report.gaussians, 2 * short_report.gaussians);
  EXPECT_LE(static_cast<double>(long_report.memory.backend.total()),
            1.2 * static_cast<double>(short_report.memory.backend.total()));
}

// Fewer windows come first, then no growth, and at last an error that names both numbers.
TEST(TrainingInParts, DrawsFromFewerWindowsWhereCapacityLacks) {
  const LongCapture& capture = long_capture();
  Listener listener;
  RunOptions options = capture.run("tight", 60, 450);
  options.settings.gaussians = 2200;
  const RunReport report = train(options, &listener);
  EXPECT_THAT(listener.notes, testing::HasSubstr("windows of images"));
  EXPECT_LE(report.memory.resident, 450U);
  // A run that goes on has no more windows than before.
  options = capture.run("tight-parts", 60, 450);
  options.settings.gaussians = 2200;
  Listener first(31);
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  train(options, &listener);
  EXPECT_TRUE(capture.scene("tight") == capture.scene("tight-parts"));

  options = capture.run("too-tight", 60, 60);
  options.settings.density = "off";
  try {
    train(options, &listener);
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_LIMIT_EXCEEDED);
    EXPECT_THAT(error.what(), testing::HasSubstr("the back end holds 60"));
  }
  // Nothing is lost: with a larger capacity it goes on as if it had begun with that.
  options.settings.resident = 1500;
  options.resume = true;
  EXPECT_THROW(train(options, &listener), io::Error);
  options.accept_changes = true;
  train(options, &listener);
  options = capture.run("wide", 60, 1500);
  options.settings.density = "off";
  train(options, &listener);
  EXPECT_TRUE(capture.scene("too-tight") == capture.scene("wide"));
}

// A back end that holds one Gaussian has it from the beginning.
TEST(TrainingInParts, BeginsWithOneGaussianAtLeast) {
  Listener listener;
  RunOptions options = long_capture().run("one", 2, 1);
  options.settings.init = "frustum";
  EXPECT_EQ(train(options, &listener).gaussians, 1U);
}

// Removes a folder after 40 steps, and cancels the training then if `cancels` is set.
class Vandal : public Listener {
 public:
  explicit Vandal(std::string folder, bool cancels = false)
      : folder_(std::move(folder)), cancels_(cancels) {}
  void update(uint64_t done, uint64_t total, const std::string& stage) override {
    Listener::update(done, total, stage);
    if (stage.rfind("training", 0) == 0 && ++steps_ == 40) std::filesystem::remove_all(folder_);
  }
  bool cancelled() override { return cancels_ && steps_ >= 40; }

 private:
  std::string folder_;
  bool cancels_;
  uint64_t steps_ = 0;
};

// Rows in files that are gone end a training with the name of the file; checkpoints stay.
TEST(TrainingInParts, GoesOnFromACheckpointWhereRowsAreLost) {
  const LongCapture& capture = long_capture();
  RunOptions options = capture.run("lost", 160, 1500);
  options.bucket_memory = 0;
  options.checkpoint_seconds = 0;
  Vandal vandal(capture.folder / "lost/buckets");
  try {
    train(options, &vandal);
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_IO);
    EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("cannot be read"),
                                             testing::HasSubstr("--resume goes on from")));
  }
  options.resume = true;
  options.checkpoint_seconds = 300;
  Listener listener;
  train(options, &listener);
  options = capture.run("found", 160, 1500);
  train(options, &listener);
  EXPECT_TRUE(capture.scene("lost") == capture.scene("found"));
}

// A checkpoint needs all rows, so it meets lost ones before a step does.
TEST(TrainingInParts, NamesTheCheckpointBeforeIfOneCannotBeMade) {
  const LongCapture& capture = long_capture();
  RunOptions options = capture.run("lost-before-a-checkpoint", 160, 1500);
  options.bucket_memory = 0;
  options.checkpoint_seconds = 0;
  Vandal vandal(capture.folder / "lost-before-a-checkpoint/buckets", true);
  try {
    train(options, &vandal);
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_IO);
    EXPECT_THAT(error.what(), testing::AllOf(testing::HasSubstr("cannot be read"),
                                             testing::HasSubstr("--resume goes on from")));
  }
}

TEST(Capacity, FollowsTheMemory) {
  Settings base;
  base.gaussians = 100000;
  const BackendCost cost{1000, 5000000, 0};
  std::vector<std::string> notes;
  const auto settled = [&](uint64_t bytes, uint64_t free) {
    Settings s = base;
    s.device_memory = bytes;
    notes.clear();
    settle_capacity(&s, {cost.row, cost.fixed, free}, &notes);
    return s;
  };
  EXPECT_EQ(settled(0, 0).resident, 100000U);
  EXPECT_EQ(settled(0, 0).adam, "dense");
  EXPECT_EQ(settled(105000000, 0).resident, 100000U);
  EXPECT_EQ(settled(65000000, 0).resident, 60000U);
  EXPECT_EQ(settled(65000000, 0).adam, "sparse");
  EXPECT_EQ(notes.size(), 1U);
  base.adam = "sparse";
  EXPECT_EQ(settled(65000000, 0).adam, "sparse");
  EXPECT_EQ(notes.size(), 1U);
  base.adam = "auto";
  EXPECT_EQ(settled(0, 110000000).resident, 50000U);
  EXPECT_EQ(settled(0, 500000000).resident, 100000U);
  const auto status = [&](const char* adam, const char* density, uint64_t bytes) -> l4d_status {
    Settings s = base;
    s.adam = adam;
    s.density = density;
    s.device_memory = bytes;
    try {
      settle_capacity(&s, cost, &notes);
    } catch (const io::Error& error) {
      return error.status();
    }
    return L4D_OK;
  };
  EXPECT_EQ(status("dense", "relocate", 65000000), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status("auto", "gradient", 65000000), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(status("auto", "gradient", 205000000), L4D_OK);
  EXPECT_EQ(status("auto", "off", 5900000), L4D_ERR_LIMIT_EXCEEDED);
}

}  // namespace
}  // namespace l4d::train
