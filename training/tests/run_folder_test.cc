// SPDX-License-Identifier: Apache-2.0
// What happens to the files of a run when a training does not begin, or ends early.
#include <gmock/gmock.h>

#include <map>

#include "training/run/protocol.h"
#include "training/run/report/report.h"
#include "training/step/cuda_backend.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::Listener;
using test::small_run;
using testing::HasSubstr;

// The bytes of all files below a folder, by path.
std::map<std::string, std::string> files_in(const std::string& folder) {
  std::map<std::string, std::string> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files[entry.path().string()] = test::bytes_of(entry.path());
  }
  return files;
}

// The message of a training that fails with the status; "" where it does not.
std::string failure_of(const RunOptions& options, RunObserver* observer, l4d_status status) {
  try {
    train(options, observer);
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), status) << error.what();
    return error.what();
  }
  return "";
}

std::string copy_of_capture(const std::string& place) {
  fs::copy(test::small_capture(), place, fs::copy_options::recursive);
  return place;
}

struct Refused {
  const char* message;
  l4d_status status;
  void (*change)(Settings* settings);
};
const Refused kRefused[] = {
    {"missing.ply", L4D_ERR_IO, [](Settings* s) { s->init = "missing.ply"; }},
    {"no point is inside", L4D_ERR_INVALID_ARGUMENT, [](Settings* s) { s->init = "hull"; }},
    {"--host-memory", L4D_ERR_LIMIT_EXCEEDED, [](Settings* s) { s->host_memory = 1000; }},
    {"--device-memory", L4D_ERR_LIMIT_EXCEEDED, [](Settings* s) { s->device_memory = 1000; }},
};

// A training that replaces a run leaves its files alone until its first step.
TEST(RunFolder, ARefusedTrainingLeavesTheRunThatWasThere) {
  const Folder folder;
  RunOptions options = small_run(folder / "run", 4);
  options.preset = "tiny";
  options.settings.capture = copy_of_capture(folder / "capture");
  Listener listener;
  train(options, &listener);
  options.force = true;
  options.settings.seed = 1;
  const auto before = files_in(folder / "run");
  ASSERT_GE(before.size(), 11U);
  const auto expect_refused = [&](const RunOptions& changed, Listener* observer, l4d_status status,
                                  const char* message) {
    EXPECT_THAT(failure_of(changed, observer, status), HasSubstr(message));
    EXPECT_TRUE(before == files_in(folder / "run")) << message;
  };
  for (const Refused& refused : kRefused) {
    RunOptions changed = options;
    refused.change(&changed.settings);
    expect_refused(changed, &listener, refused.status, refused.message);
  }
  if (!has_cuda_backend()) {
    RunOptions changed = options;
    changed.settings.backend = "cuda";
    try {
      train(changed, &listener);
      ADD_FAILURE() << "there is no device";
    } catch (const std::exception&) {
      EXPECT_TRUE(before == files_in(folder / "run"));
    }
  }
  Listener stops(0);
  expect_refused(options, &stops, L4D_ERR_CANCELLED, "cancelled");
  std::ofstream(folder / "capture/images/cam03/0004.png") << "no image";
  expect_refused(options, &listener, L4D_ERR_CORRUPT, "0004.png");

  fs::copy(test::small_capture(), folder / "capture",
           fs::copy_options::recursive | fs::copy_options::overwrite_existing);
  train(options, &listener);
  EXPECT_FALSE(before == files_in(folder / "run"));
}

// A training that did not begin needs no `force` when it is tried again, nor does one that was
// killed while it placed Gaussians.
TEST(RunFolder, ATrainingThatDidNotBeginLeavesNothing) {
  const Folder folder;
  RunOptions options = small_run(folder / "run", 4);
  options.settings.init = "hull";
  Listener listener;
  EXPECT_THAT(failure_of(options, &listener, L4D_ERR_INVALID_ARGUMENT), HasSubstr("hull"));
  EXPECT_FALSE(fs::exists(folder / "run"));
  options.settings.init = "frustum";
  fs::create_directories(folder / "run/buckets");
  std::ofstream(folder / "run/buckets/notes.txt") << "mine";
  EXPECT_THAT(failure_of(options, &listener, L4D_ERR_INVALID_ARGUMENT),
              HasSubstr("something else"));
  fs::rename(folder / "run/buckets/notes.txt", folder / "run/buckets/table.rows");
  EXPECT_THAT(failure_of(options, &listener, L4D_ERR_INVALID_ARGUMENT),
              HasSubstr("something else"));
  fs::rename(folder / "run/buckets/table.rows", folder / "run/buckets/3-1-8.rows");
  EXPECT_EQ(train(options, &listener).steps, 4u);
}

// Throws after some steps, where a step leads to files and reports.
class Exhausted : public Listener {
 public:
  explicit Exhausted(int steps) : steps_left_(steps) {}
  void update(uint64_t, uint64_t, const std::string& stage) override {
    if (stage.rfind("training", 0) == 0 && --steps_left_ == 0) throw std::bad_alloc();
  }

 private:
  int steps_left_;
};

TEST(RunFolder, WhereMemoryRunsOutTheWorkIsKept) {
  const Folder folder;
  RunOptions options = small_run(folder / "whole", 30);
  Listener listener;
  train(options, &listener);
  options.folder = folder / "parts";
  Exhausted exhausted(20);
  EXPECT_THAT(failure_of(options, &exhausted, L4D_ERR_OUT_OF_MEMORY),
              AllOf(HasSubstr("step 20: out of memory; --resume goes on from"),
                    HasSubstr("checkpoint-0000000020")));
  options.resume = true;
  train(options, &listener);
  EXPECT_TRUE(test::bytes_of(folder / "whole/scene.ply") ==
              test::bytes_of(folder / "parts/scene.ply"));
}

// A capture may move, and has to be the same or accepted.
TEST(RunFolder, TheCaptureOfARunMayMove) {
  const Folder folder;
  RunOptions options = small_run(folder / "run", 20);
  options.settings.capture = copy_of_capture(folder / "old");
  Listener stops(10), listener;
  EXPECT_THAT(failure_of(options, &stops, L4D_ERR_CANCELLED), HasSubstr("step 10"));
  try {
    evaluate_run(folder / "run", "", {}, "", &listener);
    ADD_FAILURE() << "the training has not ended";
  } catch (const io::Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("has not ended"), HasSubstr("--resume` goes on")));
  }
  fs::rename(folder / "old", folder / "new");
  options.settings.capture = folder / "new";
  options.resume = true;
  const RunReport trained = train(options, &listener);

  fs::rename(folder / "new", folder / "newer");
  try {
    evaluate_run(folder / "run", "", {}, "", &listener);
    ADD_FAILURE() << "the capture has moved";
  } catch (const io::Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("--capture"));
  }
  listener.notes.clear();
  const RunReport moved = evaluate_run(folder / "run", folder / "newer", {}, "", &listener);
  EXPECT_NEAR(moved.train.plain.mean_psnr, trained.train.plain.mean_psnr, 0.01);
  for (const uint32_t instants : {2U, 0U}) {  // of a camera that tests
    RunOptions how;
    how.scored_instants = instants;
    EXPECT_EQ(evaluate_run(folder / "run", folder / "newer", how, "", &listener).test.plain.views,
              instants != 0 ? instants : trained.test_images);
  }
  EXPECT_EQ(listener.notes, "");

  fs::copy_file(folder / "newer/images/cam03/0005.png", folder / "newer/images/cam03/0004.png",
                fs::copy_options::overwrite_existing);
  evaluate_run(folder / "run", folder / "newer", {}, "", &listener);
  EXPECT_THAT(listener.notes, HasSubstr("has changed"));
  options.settings.capture = folder / "newer";
  EXPECT_THAT(failure_of(options, &listener, L4D_ERR_INVALID_ARGUMENT),
              HasSubstr("--accept-changes"));
  options.accept_changes = true;
  const RunReport accepted = train(options, &listener);
  EXPECT_EQ(accepted.steps, 20u);
  EXPECT_EQ(accepted.settings.capture, std::string(folder / "newer"));
}

// All scenes of a folder in one table; what has ended is not trained again.
TEST(RunFolder, ProtocolsTrainAllScenes) {
  EXPECT_EQ(protocol_of("dnerf").background[1], 1);
  EXPECT_THROW(protocol_of("n4dv"), io::Error);
  const Folder folder;
  fs::create_directories(folder / "data/notes");
  copy_of_capture(folder / "data/first");
  copy_of_capture(folder / "data/second");
  RunOptions options = small_run("", 5);
  Listener listener;
  const Protocol protocol{"tiny", 32, "0:4", {}};
  const auto run = [&] {
    return run_protocol(protocol, folder / "data", folder / "runs", options, &listener);
  };
  const std::vector<ProtocolScene> scenes = run();
  ASSERT_EQ(scenes.size(), 2U);
  EXPECT_EQ(scenes[0].report.width, 32U);
  EXPECT_EQ(scenes[0].report.test.plain.views, scenes[0].report.test_images);
  const std::string table = table_of(scenes);
  EXPECT_THAT(table,
              AllOf(HasSubstr("| scene | PSNR | SSIM | DSSIM | test images |"),
                    HasSubstr("\n| first |"), HasSubstr("\n| second |"), HasSubstr("\n| mean |")));
  const std::string before = test::bytes_of(folder / "runs/first/scene.ply");
  options.settings.seed = 9;
  EXPECT_NEAR(run()[0].report.test.plain.mean_psnr, scenes[0].report.test.plain.mean_psnr, 0.01);
  EXPECT_TRUE(test::bytes_of(folder / "runs/first/scene.ply") == before);
}

}  // namespace
}  // namespace l4d::train
