// SPDX-License-Identifier: Apache-2.0
// Rows that leave a model on a device and come to it, against the same on the host.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "tests/gpu/trainable_support.h"
#include "training/model/buckets.h"
#include "training/step/cuda_backend.h"
#include "training/tests/long_capture.h"

namespace l4d::train {
namespace {

using ::l4d::test::has_device;
using ::l4d::test::Random;

constexpr l4d_timeline kTimeline = {0, 1000, 10, 1, 0};

// Rows whose numbers all differ; ids are sorted, with gaps. What splits in time go by is 0: a
// device does not gather it.
ModelState random_rows(uint64_t count, uint64_t capacity, uint32_t degree, uint32_t first_id,
                       uint32_t every, uint64_t seed) {
  Random random(seed);
  ModelState model;
  model.allocate(capacity, degree);
  for_each_column(
      [&](const std::string&, size_t numbers, auto& column) {
        for (size_t k = 0; k < count * numbers; ++k) {
          column[k] = static_cast<std::decay_t<decltype(column[k])>>(random.uniform(0, 1000000));
        }
      },
      model);
  for (size_t i = 0; i < count; ++i) {
    model.id[i] = first_id + every * static_cast<uint32_t>(i);
    model.away[i] = 0;
    model.time_gradient[i] = model.time_magnitude[i] = 0;
    model.time_visits[i] = 0;
    for (size_t k = 0; k < 4; ++k) model.value.log_scale[4 * i + k] = random.uniformf(-3, 1);
    for (size_t k = 0; k < 8; ++k) model.value.rotor[8 * i + k] = random.uniformf(-1, 1);
    model.value.mean_t[i] = random.uniformf(0, 100);
  }
  model.count = count;
  model.next_id = 1000000;
  return model;
}

void expect_same(const ModelState& a, const ModelState& b, const char* what) {
  ASSERT_EQ(a.count, b.count) << what;
  EXPECT_EQ(a.next_id, b.next_id) << what;
  for_each_column(
      [&](const std::string& name, size_t numbers, const auto& x, const auto& y) {
        const size_t bytes = static_cast<size_t>(a.count) * numbers * sizeof(uint32_t);
        EXPECT_TRUE(bytes == 0 || std::memcmp(x.data(), y.data(), bytes) == 0)
            << what << ": " << name;
      },
      a, b);
}

TEST(DeviceSwap, IsTheHosts) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    const auto device = make_cuda_backend(0), host = make_cpu_backend(1);
    // All ids are multiples of 8; those that come lie before, between and behind them.
    const ModelState model = random_rows(20000, 33000, degree, 8000, 8, degree);
    device->load(model, kTimeline);
    host->load(model, kTimeline);
    Random random(degree);
    for (uint32_t round = 1; round <= 4; ++round) {
      const uint64_t come = round == 2 ? 0 : 3000 * round;
      const ModelState entering = random_rows(come, come, degree, round, 8 * round, 70 + round);
      std::vector<uint8_t> leaves(static_cast<size_t>(host->count()));
      for (uint8_t& leaf : leaves) leaf = round != 3 && random.uniform(0, 2) < 1 ? 1 : 0;
      const ModelState of_device = device->swap_rows(leaves, entering);
      const ModelState of_host = host->swap_rows(leaves, entering);
      expect_same(of_device, of_host, "left");
      expect_same(device->save(), host->save(), "there");
      const std::vector<RowSpan> x = device->spans(), y = host->spans();
      ASSERT_EQ(x.size(), y.size());
      for (size_t i = 0; i < x.size(); ++i) {
        EXPECT_EQ(x[i].id, y[i].id);
        const float size = std::abs(y[i].begin) + std::abs(y[i].end) + 1e-3f;
        EXPECT_NEAR(x[i].begin, y[i].begin, 1e-4f * size);
        EXPECT_NEAR(x[i].end, y[i].end, 1e-4f * size);
      }
    }
  }
}

TEST(DeviceSwap, AllocatesOnce) {
  L4D_SKIP_WITHOUT_DEVICE();
  const auto device = make_cuda_backend(0);
  device->load(random_rows(1000, 1500, 3, 0, 2, 5), kTimeline);
  const std::vector<uint8_t> all(1000, 1), none;
  const ModelState left = device->swap_rows(all, ModelState());
  EXPECT_EQ(device->count(), 0U);
  const uint64_t bytes = device->memory().model;
  EXPECT_EQ(device->swap_rows(none, left).count, 0U);
  EXPECT_EQ(device->count(), 1000U);
  EXPECT_EQ(device->memory().model, bytes);
  EXPECT_THROW(device->swap_rows(std::vector<uint8_t>(1000, 0), random_rows(501, 501, 3, 1, 2, 6)),
               Error);
}

// Rows that leave and come back change no bit of a training, nor do previews of other instants.
TEST(DeviceSwap, TrainsAsWithAllRowsOnTheDevice) {
  L4D_SKIP_WITHOUT_DEVICE();
  const test::LongCapture capture(20);
  test::Listener listener;
  RunReport reports[3];
  for (const size_t k : {0U, 1U, 2U}) {
    RunOptions options = capture.run("run" + std::to_string(k), 160, k == 0 ? 0 : 1500);
    options.settings.backend = "cuda";
    options.settings.density = "off";
    if (k == 2) {
      options.bucket_memory = 100000;
      options.preview_seconds = 0;
    }
    reports[k] = train(options, &listener);
    EXPECT_TRUE(capture.scene("run0") == capture.scene("run" + std::to_string(k))) << k;
    EXPECT_NEAR(reports[k].train.plain.mean_psnr, reports[0].train.plain.mean_psnr, 1e-6) << k;
  }
  EXPECT_GT(reports[1].memory.away, 1000U);
  EXPECT_LE(reports[1].memory.resident, 1500U);
  EXPECT_LT(reports[1].memory.backend.model, reports[0].memory.backend.model);
  EXPECT_GT(reports[2].memory.bucket_files, 100000U);
}

TEST(DeviceSwap, TrainsInPartsWithRelocationAndResumes) {
  L4D_SKIP_WITHOUT_DEVICE();
  const test::LongCapture capture(20);
  test::Listener listener;
  RunOptions options = capture.run("whole", 210, 1600);
  options.settings.backend = "cuda";
  const RunReport whole = train(options, &listener);
  EXPECT_GT(whole.memory.away, 300U);
  options.folder = capture.folder / "parts";
  options.preview_seconds = 0.01;
  test::Listener first(76);
  EXPECT_THROW(train(options, &first), io::Error);
  options.resume = true;
  train(options, &listener);
  EXPECT_TRUE(capture.scene("whole") == capture.scene("parts"));
}

// --device-memory bounds the model, the renderer and targets together.
TEST(DeviceSwap, KeepsToTheMemory) {
  L4D_SKIP_WITHOUT_DEVICE();
  const test::LongCapture capture(20);
  test::Listener listener;
  const auto device = make_cuda_backend(0);
  const BackendCost cost = device->cost({1, 2, test::kWidth, test::kHeight});
  RunOptions options = capture.run("run", 120, 0);
  options.settings.backend = "cuda";
  options.settings.gaussians = 20000;
  options.settings.device_memory = cost.fixed + 1600 * cost.row;
  const RunReport report = train(options, &listener);
  EXPECT_EQ(report.settings.resident, 1600U);
  EXPECT_LE(report.memory.backend.model + report.memory.backend.renderer,
            options.settings.device_memory);
  EXPECT_LE(report.memory.backend.total(),
            options.settings.device_memory + options.settings.device_memory / 20);
}

}  // namespace
}  // namespace l4d::train
