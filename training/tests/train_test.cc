// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include "training/run/record/checkpoint.h"
#include "training/run/report/report.h"
#include "training/run/run.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

using test::Folder;
using test::Listener;
using test::small_run;
using test::tiny_run;
using ::testing::HasSubstr;

// Thousands of steps: what sanitizers would find there, they find in the shorter tests below.
#ifdef L4D_SANITIZED
#define L4D_SKIP_LONG_TRAINING() GTEST_SKIP() << "quality is measured without sanitizers"
#else
#define L4D_SKIP_LONG_TRAINING() static_cast<void>(0)
#endif

// Two test cameras of 64 x 48 pixels: from one seed to the next their PSNR lies between 20.5 and 25
// dB (six seeds, mean 23.0, deviation 1.5), and another processor is like another seed.
TEST(TrainingNightly, FromRandomPoints) {
  L4D_SKIP_LONG_TRAINING();
  constexpr uint64_t kSeeds = 3;
  double test_db = 0;
  for (uint64_t seed = 0; seed < kSeeds; ++seed) {
    const Folder folder;
    Listener listener;
    RunOptions options = tiny_run(folder / "run", 4200);
    options.settings.seed = seed;
    const RunReport report = train(options, &listener);
    EXPECT_GE(report.train.plain.mean_psnr, 35) << "seed " << seed;
    EXPECT_LE(report.gaussians, 2000U);
    test_db += report.test.plain.mean_psnr / kSeeds;
    for (const char* name : {"scene.ply", "cameras.json", "report.json", "log.jsonl", "curves.svg",
                             "preview.png", "settings.json", "events.out.tfevents.l4dtrain"}) {
      EXPECT_TRUE(std::filesystem::exists(folder / ("run/" + std::string(name)))) << name;
    }
  }
  RecordProperty("test_db", std::to_string(test_db));
  EXPECT_GE(test_db, 21);
}

TEST(TrainingNightly, FromTruePoints) {
  L4D_SKIP_LONG_TRAINING();
  const Folder folder;
  test::write_true_points(folder / "points.ply");
  RunOptions options = tiny_run(folder / "run", 2000);
  options.settings.init = folder / "points.ply";
  Listener listener;
  const RunReport report = train(options, &listener);
  RecordProperty("train_db", std::to_string(report.train.plain.mean_psnr));
  RecordProperty("test_db", std::to_string(report.test.plain.mean_psnr));
  EXPECT_GE(report.train.plain.mean_psnr, 36);
  EXPECT_GE(report.test.plain.mean_psnr, 25);
}

// The same bits from one run, from one that is cancelled and resumed, and for any number of
// threads.
TEST(Training, ResumesWithTheSameBits) {
  const Folder folder;
  RunOptions options = small_run(folder / "whole", 120);
  options.settings.exposure = "on";
  options.settings.refine_times = 2;
  options.settings.refine_cameras = 1;
  Listener listener;
  options.threads = 1;
  train(options, &listener);
  const std::string whole = test::bytes_of(folder / "whole/scene.ply");
  ASSERT_FALSE(whole.empty());

  options.folder = folder / "parts";
  options.threads = 2;
  Listener first(47);
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  const RunReport report = train(options, &listener);
  EXPECT_TRUE(whole == test::bytes_of(folder / "parts/scene.ply"));
  const std::string refined = test::bytes_of(folder / "whole/refined.json");
  EXPECT_TRUE(refined == test::bytes_of(folder / "parts/refined.json"));
  ASSERT_EQ(report.refined.size(), 4U);
  EXPECT_EQ(std::count_if(
                report.notes.begin(), report.notes.end(),
                [](const std::string& note) { return note.rfind("Only 4 cameras train", 0) == 0; }),
            1);
  EXPECT_NE(report.refined[0].second, CameraChange{});
  // The run is compared with the cameras that it has found.
  const RunReport again = evaluate_run(folder / "parts", "", options, "", &listener);
  EXPECT_NEAR(again.train.plain.mean_psnr, report.train.plain.mean_psnr, 1e-4);
}

// A figure that test views reach ends a training at the next of ten scores, as if its steps were
// over. What is resumed with a higher figure goes on with the same bits.
TEST(Training, EndsAtAFigure) {
  const Folder folder;
  RunOptions options = small_run(folder / "whole", 50);
  Listener listener;
  train(options, &listener);
  EXPECT_EQ(test::bytes_of(folder / "whole/log.jsonl").find("ends_early"), std::string::npos);

  options.folder = folder / "run";
  options.preset = "tiny";
  options.settings.stop_at = 1;
  Listener first(3), second;
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  for (const uint64_t runs : {1U, 2U}) {
    second.notes.clear();
    const RunReport report = train(options, &second);
    EXPECT_EQ(report.steps, 5U) << runs;
    EXPECT_GT(report.stream_bytes, 0U);
    const std::string note = "The training ends after step 5, at 10 %: test views have ";
    EXPECT_THAT(second.notes, HasSubstr(note));
    EXPECT_THAT(report.notes, testing::Contains(testing::StartsWith(note)));
    EXPECT_THAT(test::bytes_of(folder / "run/log.jsonl"), HasSubstr("\"ends_early\":true"));
  }
  options.settings.stop_at = 99;
  EXPECT_EQ(train(options, &second).steps, 50U);
  EXPECT_TRUE(test::bytes_of(folder / "run/scene.ply") ==
              test::bytes_of(folder / "whole/scene.ply"));
}

// Without test views it is that of training views. Rows that --codec is to remove go first.
TEST(Training, EndsAtAFigureOfTrainingViews) {
  const Folder folder;
  std::filesystem::copy(test::small_capture(), folder / "capture",
                        std::filesystem::copy_options::recursive);
  std::string cameras = test::bytes_of(folder / "capture/cameras.json");
  for (size_t at; (at = cameras.find("\"test\"")) != std::string::npos;) {
    cameras.replace(at, 6, "\"train\"");
  }
  std::ofstream(folder / "capture/cameras.json") << cameras;
  RunOptions options = test::run_on(folder / "capture", folder / "run", 20);
  options.settings.codec = "prune";
  options.settings.stop_at = 1;
  Listener listener;
  const RunReport report = train(options, &listener);
  EXPECT_EQ(report.test_images, 0U);
  EXPECT_EQ(report.steps, 18U);
  EXPECT_THAT(listener.notes, HasSubstr("at 90 %: training views have "));
}

// Likewise where lives are split, from a checkpoint in the middle of what is summed up for that.
TEST(Training, SplitsLivesWithTheSameBits) {
  const Folder folder;
  RunOptions options = small_run(folder / "off", 350);
  // Half of the rows are free, for halves.
  options.settings.gaussians = 400;
  options.settings.backend = "cpu";  // only the host splits lives
  options.settings.init = folder / "points.ply";
  std::ofstream(options.settings.init)
      << "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
         "property float z\nend_header\n0 0 0\n";
  Listener listener;
  train(options, &listener);
  options.folder = folder / "whole";
  options.settings.temporal_split = "on";
  train(options, &listener);
  const std::string whole = test::bytes_of(folder / "whole/scene.ply");
  EXPECT_FALSE(whole == test::bytes_of(folder / "off/scene.ply"));
  options.folder = folder / "parts";
  options.threads = 2;
  Listener first(247);
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  train(options, &listener);
  EXPECT_TRUE(whole == test::bytes_of(folder / "parts/scene.ply"));
  for (const auto& [key, value] : {std::make_pair("gradient", "on"), {"relocate", "maybe"}}) {
    options.settings.density = key;
    options.settings.temporal_split = value;
    EXPECT_THROW(train(options, &listener), io::Error);
  }
}

// A tenth of the rows goes five times, and none comes back; a run that is interrupted between two
// of these times goes on with the same bits.
TEST(Training, PrunesForTheCodec) {
  const Folder folder;
  RunOptions options = small_run(folder / "off", 100);
  Listener listener;
  const uint64_t all = train(options, &listener).gaussians;
  options.folder = folder / "prune";
  options.settings.codec = "prune";
  const uint64_t left = train(options, &listener).gaussians;
  EXPECT_LE(static_cast<double>(left), 0.62 * static_cast<double>(all));
  EXPECT_GE(static_cast<double>(left), 0.5 * static_cast<double>(all));

  options.folder = folder / "parts";
  Listener first(72);
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  train(options, &listener);
  EXPECT_TRUE(test::bytes_of(folder / "prune/scene.ply") ==
              test::bytes_of(folder / "parts/scene.ply"));
}

// The encoder in the loop removes rows in addition, and a run that is interrupted between its two
// encodes goes on with the same bits.
TEST(Training, SettlesOnWhatTheEncoderKeeps) {
  const Folder folder;
  // After 100 steps, how much of a scene the encoder keeps is chance.
  RunOptions options = small_run(folder / "prune", 200);
  options.settings.codec = "prune";
  options.preset = "small";
  Listener listener;
  const RunReport pruned = train(options, &listener);
  options.folder = folder / "settle";
  options.settings.codec = "settle";
  const RunReport settled = train(options, &listener);
  EXPECT_LT(settled.gaussians, pruned.gaussians);
  EXPECT_LT(settled.stream_bytes, pruned.stream_bytes);
  EXPECT_GT(settled.stream_test.plain.mean_psnr, pruned.stream_test.plain.mean_psnr - 1);
  EXPECT_EQ(settled.settings.preset, "small");

  // A stream that lost much says so.
  EXPECT_EQ(note_of_stream(40, 37.1, false), "");
  EXPECT_EQ(note_of_stream(37, 40, false), "");
  EXPECT_THAT(note_of_stream(40, 33.5, false), HasSubstr("has 6.5 dB less"));
  EXPECT_THAT(note_of_stream(40, 33.5, false), HasSubstr("--codec settle"));
  EXPECT_THAT(note_of_stream(40, 33.5, true), HasSubstr("a preset of more bytes"));
  const std::string note =
      note_of_stream(pruned.train.plain.mean_psnr, pruned.stream_train.plain.mean_psnr, false);
  EXPECT_EQ(std::count(pruned.notes.begin(), pruned.notes.end(), note), note.empty() ? 0 : 1);

  options.folder = folder / "parts";
  Listener first(154);
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  train(options, &listener);
  EXPECT_TRUE(test::bytes_of(folder / "settle/scene.ply") ==
              test::bytes_of(folder / "parts/scene.ply"));

  options.resume = false;
  options.folder = folder / "without";
  options.preset.clear();
  EXPECT_THROW(train(options, &listener), io::Error);
}

// Both rules of density, in every step and all rows at once, keep to the budget, make a model that
// shows something, and resume.
TEST(Training, ChangesDensityByAnyRule) {
  const Folder folder;
  using Rule = std::pair<const char*, uint32_t>;
  for (const auto& [rule, every] :
       {Rule("relocate", 50), Rule("gradient", 1), Rule("gradient", 20)}) {
    const std::string name = rule + std::to_string(every);
    RunOptions options = small_run(folder / name, 120);
    options.settings.density = rule;
    options.settings.density_every = every;
    Listener listener;
    const RunReport report = train(options, &listener);
    EXPECT_LE(report.gaussians, 2000U) << name;
    EXPECT_GE(report.gaussians, 500U) << name;
    EXPECT_GE(report.train.plain.mean_psnr, 16) << name;
    options.folder = folder / (name + "parts");
    Listener first(45);
    EXPECT_THROW(train(options, &first), io::Error);
    options.resume = true;
    train(options, &listener);
    EXPECT_TRUE(test::bytes_of(folder / (name + "/scene.ply")) ==
                test::bytes_of(folder / (name + "parts/scene.ply")))
        << name;
  }
}

TEST(Training, RefusesToReplaceOrMixRuns) {
  const Folder folder;
  RunOptions options = small_run(folder / "run", 6);
  Listener listener;
  train(options, &listener);
  EXPECT_THROW(train(options, &listener), io::Error);
  options.resume = true;
  options.settings.seed = 5;
  try {
    train(options, &listener);
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_INVALID_ARGUMENT);
    EXPECT_THAT(error.what(), testing::HasSubstr("\"seed 0\", and now it is \"seed 5\""));
  }
  options.resume = false;
  options.force = true;
  const RunReport replaced = train(options, &listener);
  EXPECT_EQ(replaced.steps, 6u);
  EXPECT_EQ(replaced.settings.seed, 5u);
}

// A damaged checkpoint is named, and the one before it is used; without one the error is about it.
TEST(Training, GoesOnFromTheCheckpointBefore) {
  const Folder folder;
  RunOptions options = small_run(folder / "run", 40);
  options.checkpoint_seconds = 0;  // after each step
  Listener listener;
  train(options, &listener);
  const std::string whole = test::bytes_of(folder / "run/scene.ply");
  const std::vector<std::string> all = list_checkpoints(folder / "run");
  ASSERT_EQ(all.size(), 2U);
  std::string bytes = test::bytes_of(all[0]);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  std::ofstream(all[0], std::ios::binary) << bytes;
  options.resume = true;
  Listener resumed;
  train(options, &resumed);
  EXPECT_THAT(resumed.notes, testing::HasSubstr("checksum"));
  EXPECT_TRUE(whole == test::bytes_of(folder / "run/scene.ply"));

  for (const std::string& path : list_checkpoints(folder / "run")) {
    std::ofstream(path, std::ios::binary) << "L4DTRN01 and no more";
  }
  try {
    train(options, &listener);
    FAIL();
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_CORRUPT);
  }
}

// No byte of a checkpoint can change, and none can be missing, without being noticed.
TEST(Checkpoint, NoticesEveryDamage) {
  Checkpoint checkpoint;
  checkpoint.settings = "steps 5\n";
  checkpoint.model.allocate(3, 1);
  checkpoint.model.count = 2;
  checkpoint.model.exposures.resize(2);
  checkpoint.model.motion = {1, 2, 3, 4, 5, 6, 0, 0, 0};
  checkpoint.run.step = 4;
  checkpoint.run.camera_loss = {0.5, 0.25};
  checkpoint.run.refined.resize(2);
  const std::vector<uint8_t> bytes = pack_checkpoint(checkpoint);
  const Checkpoint again = unpack_checkpoint("a", bytes);
  EXPECT_EQ(again.model.capacity(), 3U);
  EXPECT_EQ(again.model.motion, checkpoint.model.motion);
  EXPECT_EQ(again.run.step, 4U);
  EXPECT_TRUE(pack_checkpoint(again) == bytes);
  for (size_t n = 0; n < bytes.size(); ++n) {
    EXPECT_THROW(unpack_checkpoint("a", {bytes.begin(), bytes.begin() + static_cast<ptrdiff_t>(n)}),
                 io::Error);
    std::vector<uint8_t> damaged = bytes;
    damaged[n] = static_cast<uint8_t>(damaged[n] ^ 4);
    EXPECT_THROW(unpack_checkpoint("a", damaged), io::Error) << n;
  }
}

}  // namespace
}  // namespace l4d::train
