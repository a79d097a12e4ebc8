// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <cmath>

#include "training/init/start.h"
#include "training/run/train/trainer.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

// A back end whose losses are what a test wants; it renders nothing and trains nothing.
class Scripted final : public Backend {
 public:
  // Loss of a view by step and camera.
  std::function<double(uint64_t step, const StepView& view)> loss;

  void load(ModelState state, const l4d_timeline&) override { state_ = std::move(state); }
  ModelState save() override { return state_; }
  uint64_t count() const override { return state_.count; }
  uint64_t capacity() const override { return state_.capacity(); }
  StepOutput step(const StepInput& input) override {
    StepOutput output;
    for (const StepView& view : input.views) {
      LossSums sums;
      sums.values = 1;
      sums.absolute = loss(input.adam.step, view);
      sums.similarity = 1 - sums.absolute;
      output.finite = output.finite && std::isfinite(sums.absolute);
      output.views.push_back(sums);
      output.exposure_gradients.push_back({});
    }
    return output;
  }
  DensityChange change_density(DensityStep, uint64_t) override { return {}; }
  DensityChange change_density(const GradientStep&) override { return {}; }
  void renew_weights(float) override {}
  void set_motion(std::vector<float>) override {}
  void keep(const std::vector<uint8_t>&) override {}
  std::vector<RowSpan> spans() override { return {}; }
  ModelState swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering) override {
    return train::swap_rows(&state_, leaves, entering);
  }
  BackendMemory memory() const override { return {}; }
  BackendCost cost(const StepSize&) const override { return {}; }
  void limit_memory(uint64_t) override {}
  io::Image render(const l4d_camera& camera, double, const float*) override {
    return io::Image(camera.width, camera.height);
  }
  std::array<double, kStages> take_seconds() override { return {}; }

 private:
  ModelState state_;
};

class GuardTest : public testing::Test {
 protected:
  GuardTest()
      : capture_(read_capture(test::tiny_capture(), {})),
        loader_(capture_, 1),
        instants_(instants_of(capture_, "train")),
        store_(make_image_store(loader_, instants_, {}, nullptr)) {
    settings_.gaussians = 20;
    settings_.steps = 3000;
    settings_.views = 2;
    settings_.exposure = "off";
  }
  void begin() {
    trainer_ =
        std::make_unique<Trainer>(settings_, capture_, loader_, instants_, store_.get(), &backend_);
    StartOptions start;
    start.count = start.capacity = 20;
    start.sh_degree = settings_.sh_degree;
    trainer_->start(start_model(capture_, random_points(capture_, 20, 0), start));
  }
  // The step at which the training diverges; 0: none up to `steps`.
  uint64_t diverges(uint64_t steps) {
    for (uint64_t k = 0; k < steps; ++k) {
      try {
        trainer_->advance();
      } catch (const Diverged& diverged) {
        message_ = diverged.what();
        return diverged.step();
      }
    }
    return 0;
  }

  Capture capture_;
  ImageLoader loader_;
  std::vector<Instant> instants_;
  std::unique_ptr<ImageStore> store_;
  Settings settings_;
  Scripted backend_;
  std::unique_ptr<Trainer> trainer_;
  std::string message_;
};

TEST_F(GuardTest, ThreeLossesThatAreNotFiniteEndATraining) {
  backend_.loss = [](uint64_t step, const StepView& view) {
    const bool lost = step == 5 || step == 6 || (step >= 9 && view.image % 2 == 1);
    return lost ? std::nan("") : 0.1;
  };
  begin();
  const uint64_t step = diverges(400);
  // Two in a row at 5 and 6 are forgiven.
  EXPECT_GE(step, 11U);
  EXPECT_THAT(message_, testing::HasSubstr("step " + std::to_string(step)));
  EXPECT_THAT(message_, testing::ContainsRegex("camera [0-9]+, frame [0-9]+"));
}

TEST_F(GuardTest, LossesOutOfBoundsEndATraining) {
  backend_.loss = [](uint64_t step, const StepView&) {
    return step < 100 ? 0.1 : step < 250 ? 0.5 : step < 300 ? 0.1 : 0.4;
  };
  begin();
  // 150 high losses are a bad phase; 200 are not.
  EXPECT_EQ(diverges(1000), 499U);
}

TEST_F(GuardTest, LossesThatRiseSlowlyDoNot) {
  backend_.loss = [](uint64_t step, const StepView&) {
    return 0.1 + 0.0005 * static_cast<double>(step);
  };
  begin();
  EXPECT_EQ(diverges(1500), 0U);
}

TEST_F(GuardTest, ACameraWithALargeErrorIsReported) {
  const l4d_camera odd = loader_.camera(5);
  backend_.loss = [&](uint64_t, const StepView& view) {
    const bool is_odd =
        std::equal(odd.world_to_camera, odd.world_to_camera + 12, view.camera.world_to_camera);
    return is_odd ? 0.2 : 0.05;
  };
  begin();
  std::vector<std::string> notes;
  for (int k = 0; k < 2010; ++k) {
    trainer_->advance();
    for (const std::string& note : trainer_->take_notes()) notes.push_back(note);
  }
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_THAT(notes[0], testing::HasSubstr("camera 5"));
  EXPECT_THAT(notes[0], testing::HasSubstr("synchronised"));
}

// Every training image is used about equally often, and a step has cameras of one instant.
TEST_F(GuardTest, StepsUseAllImagesAlike) {
  std::map<uint64_t, int> uses;
  std::set<uint64_t> of_step;
  uint64_t last = 0;
  backend_.loss = [&](uint64_t step, const StepView& view) {
    if (step != last) of_step.clear();
    last = step;
    EXPECT_TRUE(of_step.insert(view.image).second);
    ++uses[view.image];
    return 0.1;
  };
  begin();
  const uint64_t epoch = trainer_->steps_per_epoch();
  EXPECT_EQ(epoch, 140U);
  for (uint64_t k = 0; k < 5 * epoch; ++k) trainer_->advance();
  EXPECT_EQ(uses.size(), 280U);
  for (const auto& [image, n] : uses) EXPECT_EQ(n, 5) << image;
}

}  // namespace
}  // namespace l4d::train
