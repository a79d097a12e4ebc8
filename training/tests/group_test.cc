// SPDX-License-Identifier: Apache-2.0
// Back ends that share the views of a step, on the host.
#include <gmock/gmock.h>

#include <functional>
#include <new>

#include "l4d/l4d.hpp"
#include "training/init/start.h"
#include "training/model/state_hash.h"
#include "training/run/train/evaluate.h"
#include "training/run/train/trainer.h"
#include "training/step/group_backend.h"
#include "training/tests/host_exchange.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

// Sanitizers find in fewer steps what they find.
#ifdef L4D_SANITIZED
constexpr uint64_t kSteps = 24;
#else
constexpr uint64_t kSteps = 300;
#endif

using Members = std::vector<std::unique_ptr<PhasedBackend>>;

Members cpu_members(size_t count) {
  Members members;
  for (size_t k = 0; k < count; ++k) members.push_back(make_phased_cpu_backend(1));
  return members;
}
std::unique_ptr<Backend> cpu_group(size_t count) {
  return make_group_backend(cpu_members(count), test::make_host_exchange(2));
}

class GroupTest : public testing::Test {
 protected:
  GroupTest()
      : capture_(read_capture(test::tiny_capture(), {})),
        loader_(capture_, 1),
        instants_(instants_of(capture_, "train")),
        store_(make_image_store(loader_, instants_, {}, nullptr)) {
    settings_.gaussians = 2000;
    settings_.sh_degree = 1;
    settings_.steps = kSteps;
    settings_.views = 4;
    settings_.exposure = "on";
  }
  ModelState start() const {
    StartOptions options;
    options.count = 1500;
    options.capacity = settings_.gaussians;
    options.sh_degree = settings_.sh_degree;
    return start_model(capture_, random_points(capture_, options.count, 0), options);
  }
  std::unique_ptr<Trainer> trainer(Backend* backend) {
    return std::make_unique<Trainer>(settings_, capture_, loader_, instants_, store_.get(), backend,
                                     1);
  }
  ModelState train(Backend* backend, uint64_t steps) {
    const auto trainer = this->trainer(backend);
    trainer->start(start());
    for (uint64_t k = 0; k < steps; ++k) trainer->advance();
    return trainer->model();
  }
  // Of `views` cameras, with all that can be measured.
  StepInput input(size_t views, uint64_t step = 1) const {
    StepInput in;
    store_->go_to(step);
    ScheduleOptions options;
    options.radius = frame_of(capture_).radius;
    options.duration = capture_.duration();
    options.sh_degree = settings_.sh_degree;
    in.adam = adam_step_at(options, 0.4, 1, step, 0);
    in.measure = in.measure_gradients = true;
    for (size_t k = 0; k < views; ++k) {
      const uint32_t image = instants_[3].views[k];
      StepView view;
      view.time = capture_.views[image].time;
      view.camera = loader_.camera(capture_.views[image].camera);
      view.image = image;
      view.target = store_->image(image).rgb.data();
      in.views.push_back(view);
    }
    return in;
  }
  // PSNR of the model on training views of five instants.
  double psnr(Backend* backend) const {
    const float black[3] = {0, 0, 0};
    return score_views(
               capture_, loader_, views_to_score(capture_, "train", 5), Scorer(), 1,
               [&](uint32_t view) {
                 const CaptureView& v = capture_.views[view];
                 return backend->render(loader_.camera(v.camera), v.time, black);
               },
               nullptr)
        .plain.mean_psnr;
  }

  Capture capture_;
  ImageLoader loader_;
  std::vector<Instant> instants_;
  std::unique_ptr<ImageStore> store_;
  Settings settings_;
};

// A member that fails or goes astray where a test wants that.
class Faulty final : public PhasedBackend {
 public:
  std::function<void()> before_views, after_update;

  void load(ModelState state, const l4d_timeline& timeline) override {
    timeline_ = timeline;
    own_->load(std::move(state), timeline);
  }
  ModelState save() override { return own_->save(); }
  uint64_t count() const override { return own_->count(); }
  uint64_t capacity() const override { return own_->capacity(); }
  void render_views(const StepInput& input, ViewRange range) override {
    if (before_views) before_views();
    own_->render_views(input, range);
  }
  StepSums sums() override { return own_->sums(); }
  void update(const StepInput& input) override {
    own_->update(input);
    if (after_update) after_update();
  }
  bool finish(const StepInput& input, ViewRange range, StepOutput* output) override {
    return own_->finish(input, range, output);
  }
  DensityChange change_density(DensityStep step, uint64_t growth) override {
    return own_->change_density(step, growth);
  }
  DensityChange change_density(const GradientStep& step) override {
    return own_->change_density(step);
  }
  void renew_weights(float beta) override { own_->renew_weights(beta); }
  void set_motion(std::vector<float> motion) override { own_->set_motion(std::move(motion)); }
  void keep(const std::vector<uint8_t>& mask) override { own_->keep(mask); }
  std::vector<RowSpan> spans() override { return own_->spans(); }
  ModelState swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering) override {
    return own_->swap_rows(leaves, entering);
  }
  BackendMemory memory() const override { return own_->memory(); }
  BackendCost cost(const StepSize& size) const override { return own_->cost(size); }
  void limit_memory(uint64_t bytes) override { own_->limit_memory(bytes); }
  io::Image render(const l4d_camera& camera, double time, const float* background) override {
    return own_->render(camera, time, background);
  }
  std::array<double, kStages> take_seconds() override { return own_->take_seconds(); }

  // As a device does that computes something else than the others.
  void move_a_row() {
    ModelState state = own_->save();
    state.value.position[7] += 1e-6f;
    own_->load(std::move(state), timeline_);
  }

 private:
  std::unique_ptr<PhasedBackend> own_ = make_phased_cpu_backend(1);
  l4d_timeline timeline_{};
};

TEST(ViewsOfMember, AreSharedOutEvenly) {
  for (const size_t views : {0U, 1U, 2U, 3U, 4U, 5U, 16U}) {
    for (const size_t members : {1U, 2U, 3U, 8U}) {
      size_t next = 0;
      for (size_t k = 0; k < members; ++k) {
        const ViewRange range = views_of_member(views, k, members);
        EXPECT_EQ(range.begin, next);
        EXPECT_GE(range.count(), views / members);
        EXPECT_LE(range.count(), views / members + 1);
        next = range.end;
      }
      EXPECT_EQ(next, views);
    }
  }
}

std::vector<double> numbers_of(const SumArray& array, uint64_t rows) {
  std::vector<double> out;
  const size_t n = static_cast<size_t>(rows) * array.width;
  for (size_t i = 0; i < n; ++i) {
    switch (array.kind) {
      case SumArray::kFloat:
        out.push_back(static_cast<double>(static_cast<const float*>(array.data)[i]));
        break;
      case SumArray::kCount:
        out.push_back(static_cast<const uint32_t*>(array.data)[i]);
        break;
      case SumArray::kFlag:
        out.push_back(static_cast<const uint8_t*>(array.data)[i]);
        break;
    }
  }
  return out;
}

// Sums of shared views are those of one back end but for rounding, and the same in all members.
// Also if there are fewer views than members.
TEST_F(GroupTest, SumsAreThoseOfOneBackEnd) {
  for (const auto& [views, count] : {std::pair<size_t, size_t>(4, 2), {5, 3}, {1, 2}}) {
    const StepInput in = input(views);
    Members members = cpu_members(count), one = cpu_members(1);
    one[0]->load(start(), capture_.timeline());
    one[0]->render_views(in, {0, views});
    std::vector<StepSums> sums;
    for (size_t k = 0; k < count; ++k) {
      members[k]->load(start(), capture_.timeline());
      members[k]->render_views(in, views_of_member(views, k, count));
      sums.push_back(members[k]->sums());
    }
    test::make_host_exchange(2)->add_up(sums);
    const StepSums expected = one[0]->sums();
    ASSERT_EQ(expected.arrays.size(), 11U);
    for (size_t a = 0; a < expected.arrays.size(); ++a) {
      const std::vector<double> e = numbers_of(expected.arrays[a], expected.rows);
      const std::vector<double> found = numbers_of(sums[0].arrays[a], expected.rows);
      double apart = 0, length = 0;
      for (size_t i = 0; i < e.size(); ++i) {
        apart += std::pow(found[i] - e[i], 2);
        length += e[i] * e[i];
      }
      EXPECT_GT(length, 0) << a;
      EXPECT_LE(apart, 1e-12 * length) << "array " << a << " of " << count << " members";
      for (size_t k = 1; k < count; ++k) {
        EXPECT_EQ(numbers_of(sums[k].arrays[a], expected.rows), found) << a;
      }
    }
  }
}

// A step of a group gives losses in the order of the views, and the model of one back end.
TEST_F(GroupTest, AStepIsThatOfOneBackEnd) {
  const auto one = make_cpu_backend(1), group = cpu_group(3);
  const StepInput in = input(4);
  one->load(start(), capture_.timeline());
  group->load(start(), capture_.timeline());
  const StepOutput e = one->step(in), found = group->step(in);
  ASSERT_EQ(found.views.size(), 4U);
  for (size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(found.views[k].loss(0.2), e.views[k].loss(0.2));
    EXPECT_EQ(found.exposure_gradients[k], e.exposure_gradients[k]);
  }
  EXPECT_TRUE(found.finite);
  const ModelState a = one->save(), b = group->save();
  EXPECT_EQ(a.last_shown, b.last_shown);
  EXPECT_EQ(a.screen_views, b.screen_views);
  for (size_t i = 0; i < a.count; ++i) {
    EXPECT_NEAR(a.m.opacity[i], b.m.opacity[i], 1e-9 + 1e-4 * std::abs(a.m.opacity[i]));
    EXPECT_NEAR(a.coverage[i], b.coverage[i], 1e-9 + 1e-4 * std::abs(a.coverage[i]));
  }
}

// With density, noise and exposures, dense and sparse.
TEST_F(GroupTest, TrainsAsOneBackEndDoesAndRepeats) {
  for (const char* adam : {"dense", "sparse"}) {
    settings_.adam = adam;
    const auto one = make_cpu_backend(2);
    train(one.get(), settings_.steps);
    const double expected = psnr(one.get());
    RecordProperty(std::string(adam) + "1_db", std::to_string(expected));
    for (const size_t members : {2U, 3U}) {
      const auto group = cpu_group(members);
      const uint64_t first = hash_of(train(group.get(), settings_.steps));
      const double found = psnr(group.get());
      RecordProperty(std::string(adam) + std::to_string(members) + "_db", std::to_string(found));
      EXPECT_NEAR(found, expected, 0.05) << adam << ", " << members << " members";
      if (members == 3) continue;
      const auto again = cpu_group(members);
      EXPECT_EQ(hash_of(train(again.get(), settings_.steps)), first) << adam;
    }
  }
}

TEST_F(GroupTest, ResumesWithTheSameBits) {
  settings_.density = "gradient";
  const auto whole = cpu_group(2), half = cpu_group(2), rest = cpu_group(2);
  const uint64_t expected = hash_of(train(whole.get(), 60));
  const auto before = trainer(half.get());
  before->start(start());
  for (int k = 0; k < 33; ++k) before->advance();
  const auto after = trainer(rest.get());
  after->restore(before->model(), before->state());
  for (int k = 33; k < 60; ++k) after->advance();
  EXPECT_EQ(hash_of(after->model()), expected);
}

TEST_F(GroupTest, LeavesTheModelAloneWhereALossIsNotFinite) {
  const auto group = cpu_group(2);
  group->load(start(), capture_.timeline());
  const uint64_t before = hash_of(group->save());
  StepInput in = input(4);
  const double exposure[12] = {std::nan("")};
  in.views[3].exposure = exposure;
  EXPECT_FALSE(group->step(in).finite);
  EXPECT_EQ(hash_of(group->save()), before);
  in.views[3].exposure = nullptr;
  EXPECT_TRUE(group->step(in).finite);
  EXPECT_NE(hash_of(group->save()), before);
}

// The error of a member is that of the step, the others end theirs, and what they had added up is
// forgotten.
TEST_F(GroupTest, AMemberThatFailsEndsTheStep) {
  for (const size_t which : {0U, 2U}) {
    Members members = cpu_members(3);
    auto owned = std::make_unique<Faulty>();
    Faulty* const faulty = owned.get();
    members[which] = std::move(owned);
    const auto group = make_group_backend(std::move(members), test::make_host_exchange(1));
    const auto sound = cpu_group(3);
    group->load(start(), capture_.timeline());
    sound->load(start(), capture_.timeline());
    faulty->before_views = [] { throw Error(L4D_ERR_DEVICE, "the device is gone"); };
    EXPECT_THROW(group->step(input(4)), Error);
    faulty->before_views = nullptr;
    group->step(input(5));
    sound->step(input(5));
    EXPECT_EQ(hash_of(group->save()), hash_of(sound->save()));
    faulty->after_update = [] { throw std::bad_alloc(); };
    EXPECT_THROW(group->step(input(4, 2)), std::bad_alloc);
  }
}

TEST_F(GroupTest, NoticesModelsThatComeApart) {
  Members members = cpu_members(2);
  auto owned = std::make_unique<Faulty>();
  Faulty* const faulty = owned.get();
  members[1] = std::move(owned);
  const auto group = make_group_backend(std::move(members), test::make_host_exchange(1));
  group->load(start(), capture_.timeline());
  group->step(input(4));
  EXPECT_EQ(group->save().id.size(), start().id.size());
  faulty->move_a_row();
  group->step(input(4, 2));
  try {
    group->save();
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_DEVICE);
    EXPECT_THAT(error.what(), testing::HasSubstr("member 1"));
  }
}

TEST(Group, NeedsAMember) {
  EXPECT_THROW(make_group_backend({}, test::make_host_exchange(1)), Error);
}

}  // namespace
}  // namespace l4d::train
