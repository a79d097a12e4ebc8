// SPDX-License-Identifier: Apache-2.0
// Rows that leave a model on a device and come to it, against the same on the host.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "tests/gpu/live_support.h"
#include "training/model/buckets.h"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

using test::has_device;
using test::Random;

// Rows whose numbers all differ; ids are sorted, with gaps.
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
    device->load(model, l4d_timeline{});
    host->load(model, l4d_timeline{});
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
  device->load(random_rows(1000, 1500, 3, 0, 2, 5), l4d_timeline{});
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

}  // namespace
}  // namespace l4d::train
