// SPDX-License-Identifier: Apache-2.0
// Several back ends that share the views of a step, on one device.
#include <limits>

#include "training/model/state_hash.h"
#include "training/step/cuda_backend.h"
#include "training/tests/gpu/train_support.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

using l4d::test::has_device;
using test::Capture;
using test::expect_models;
using test::schedule_of;
using test::start_of;
using test::trained;

constexpr Transport kTransports[] = {Transport::kDirect, Transport::kCopies};

// Also where there are fewer views than members.
TEST(DeviceGroup, AStepIsTheHosts) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(6);
  for (const size_t members : {2U, 3U, 5U}) {
    const auto cpu = make_cpu_backend(2);
    StepInput input = capture.input(3, schedule_of(capture, 3), false);
    input.measure_gradients = true;
    cpu->load(start_of(capture.truth, 3501, 3), capture.truth.timeline);
    const StepOutput e = cpu->step(input);
    std::vector<uint64_t> hashes;
    for (const Transport transport : kTransports) {
      const auto group = make_cuda_group(std::vector<uint32_t>(members, 0), transport);
      group->load(start_of(capture.truth, 3501, 3), capture.truth.timeline);
      const StepOutput found = group->step(input);
      EXPECT_TRUE(found.finite);
      ASSERT_EQ(found.views.size(), e.views.size());
      for (size_t v = 0; v < e.views.size(); ++v) {
        EXPECT_NEAR(found.views[v].loss(0.2), e.views[v].loss(0.2), 1e-5);
      }
      // As DeviceTraining.AStepIsTheHosts has it. `save` compares the models of the members.
      const ModelState state = group->save();
      expect_models(state, cpu->save(), 1e-3, std::to_string(members) + " members");
      EXPECT_LT(render::relative_distance(state.coverage, cpu->save().coverage), 5e-2);
      hashes.push_back(hash_of(state));
      EXPECT_GT(group->take_seconds()[kExchange], 0);
    }
    EXPECT_EQ(hashes[0], hashes[1]) << "copies add up as kernels do";
  }
}

// The moments after one step are shares of the sums of derivatives: those of a group differ from
// those of one device by rounding alone, and so do sums of what views show.
TEST(DeviceGroup, SumsAreThoseOfOneDevice) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(6);
  StepInput input = capture.input(3, schedule_of(capture, 3), false);
  input.measure_gradients = true;
  const auto one = make_cuda_backend(0);
  one->load(start_of(capture.truth, 3500, 3), capture.truth.timeline);
  one->step(input);
  const ModelState e = one->save();
  for (const Transport transport : kTransports) {
    const auto group = make_cuda_group({0, 0}, transport);
    group->load(start_of(capture.truth, 3500, 3), capture.truth.timeline);
    group->step(input);
    const ModelState found = group->save();
    EXPECT_EQ(found.last_shown, e.last_shown);
    EXPECT_EQ(found.screen_views, e.screen_views);
    EXPECT_LT(render::relative_distance(found.screen_gradient, e.screen_gradient), 1e-6);
    EXPECT_LT(render::relative_distance(found.coverage, e.coverage), 1e-6);
    EXPECT_LT(render::relative_distance(found.error, e.error), 1e-6);
    EXPECT_LT(render::relative_distance(found.m.position, e.m.position), 1e-5);
    EXPECT_LT(render::relative_distance(found.m.rotor, e.m.rotor), 1e-5);
    EXPECT_LT(render::relative_distance(found.m.sh, e.m.sh), 1e-6);
  }
}

// With noise, births and relocation, dense and sparse; all members have equal models at the end, or
// `save` fails.
TEST(DeviceGroup, TrainsAndRepeats) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(6);
  for (const bool sparse : {false, true}) {
    const auto one = make_cuda_backend(0);
    double expected = 0, found = 0, again = 0;
    trained(one.get(), capture, sparse, false, 300, &expected);
    const auto group = make_cuda_group({0, 0}), other = make_cuda_group({0, 0});
    trained(group.get(), capture, sparse, false, 300, &found);
    EXPECT_NEAR(found, expected, 0.2);
    const ModelState first = trained(group.get(), capture, sparse, true, 300, &found);
    const ModelState second = trained(other.get(), capture, sparse, true, 300, &again);
    EXPECT_GT(first.count, capture.truth.count());
    EXPECT_EQ(found, again);
    EXPECT_EQ(hash_of(first), hash_of(second));
    // Saved and loaded, it goes on as if nothing had been.
    const StepInput next = capture.input(301, schedule_of(capture, 1), sparse);
    group->step(next);
    other->load(first, capture.truth.timeline);
    other->step(next);
    EXPECT_EQ(hash_of(group->save()), hash_of(other->save()));
  }
}

TEST(DeviceGroup, LeavesTheModelAloneWhereALossIsNotFinite) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(3);
  for (const Transport transport : kTransports) {
    const auto group = make_cuda_group({0, 0}, transport);
    group->load(start_of(capture.truth, 3000, 1), capture.truth.timeline);
    const uint64_t before = hash_of(group->save());
    StepInput input = capture.input(1, schedule_of(capture, 1), false);
    const double exposure[12] = {std::numeric_limits<double>::quiet_NaN()};
    input.views[2].exposure = exposure;
    EXPECT_FALSE(group->step(input).finite);
    EXPECT_EQ(hash_of(group->save()), before);
    input.views[2].exposure = nullptr;
    EXPECT_TRUE(group->step(input).finite);
  }
}

// The view of one member needs more memory than there is at first: all members repeat the step.
TEST(DeviceGroup, RepeatsAStepWhoseViewsDidNotFit) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(3);
  ModelState large = start_of(capture.truth, 3000, 1);
  for (size_t i = 0; i < large.value.log_scale.size(); ++i) {
    if (i % 4 != 3) large.value.log_scale[i] += 3.0f;
  }
  StepInput input = capture.input(1, schedule_of(capture, 1), false);
  const std::vector<uint8_t> grey(size_t{3} * 1600 * 1200, 90);
  input.views[2].camera = render::ring_camera(1600, 1200, 0.3);
  input.views[2].target = grey.data();
  input.views[2].image = 1000;
  const auto one = make_cuda_backend(0), group = make_cuda_group({0, 0});
  one->load(large, capture.truth.timeline);
  group->load(large, capture.truth.timeline);
  const StepOutput e = one->step(input), found = group->step(input);
  EXPECT_TRUE(e.finite);
  EXPECT_TRUE(found.finite);
  ASSERT_EQ(found.views.size(), 3U);
  for (size_t v = 0; v < 3; ++v) {
    EXPECT_NEAR(found.views[v].loss(0.2), e.views[v].loss(0.2), 1e-6);
  }
  EXPECT_LT(render::relative_distance(group->save().m.sh, one->save().m.sh), 1e-5);
}

// A whole run, interrupted and resumed.
TEST(DeviceGroup, ResumesARunWithTheSameBits) {
  L4D_SKIP_WITHOUT_DEVICE();
  const test::Folder folder;
  RunOptions options = test::tiny_run(folder / "whole", 120);
  options.settings.backend = "cuda";
  options.settings.devices = "0,0";
  options.settings.views = 5;
  test::Listener listener;
  const RunReport report = train(options, &listener);
  EXPECT_EQ(report.devices, std::vector<uint32_t>({0, 0}));
  EXPECT_GT(report.stages[kExchange], 0);
  const std::string whole = test::bytes_of(folder / "whole/scene.ply");
  ASSERT_FALSE(whole.empty());

  options.folder = folder / "parts";
  test::Listener first(47);
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  options.settings.devices = "0";
  EXPECT_THROW(train(options, &listener), io::Error);
  options.settings.devices = "0,0";
  train(options, &listener);
  EXPECT_TRUE(whole == test::bytes_of(folder / "parts/scene.ply"));
}

TEST(DeviceGroup, RefusesDevicesThatAreNotThere) {
  L4D_SKIP_WITHOUT_DEVICE();
  EXPECT_THROW(make_cuda_group({}), Error);
  EXPECT_THROW(make_cuda_group({0, 4000}), Error);
  EXPECT_THROW(make_cuda_group(std::vector<uint32_t>(9, 0)), Error);
}

}  // namespace
}  // namespace l4d::train
