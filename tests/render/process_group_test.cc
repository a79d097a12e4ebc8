// SPDX-License-Identifier: Apache-2.0
// l4d_measure_importance by several ranks, here threads: weights do not depend on how many there
// are, neither where sums are full nor where there are so many that sums of sums could be.
#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

#include "tests/render/scenes.h"

namespace l4d::render {
namespace {

// Adds arrays up over `count` threads.
class Meeting {
 public:
  explicit Meeting(uint32_t count) : count_(count) {}
  void sum(int64_t* values, uint64_t n) {
    std::unique_lock<std::mutex> lock(mutex_);
    if (arrived_ == 0) total_.assign(static_cast<size_t>(n), 0);
    ASSERT_EQ(total_.size(), n) << "ranks call in one order";
    for (size_t i = 0; i < n; ++i) {
      // As MPI does: what is full must not reach the sign.
      ASSERT_FALSE(__builtin_add_overflow(total_[i], values[i], &total_[i]));
    }
    const uint64_t round = round_;
    if (++arrived_ == count_) {
      arrived_ = 0;
      result_ = total_;
      ++round_;
      all_.notify_all();
    }
    all_.wait(lock, [&] { return round_ != round; });
    std::copy(result_.begin(), result_.end(), values);
  }

 private:
  const uint32_t count_;
  std::mutex mutex_;
  std::condition_variable all_;
  uint32_t arrived_ = 0;
  uint64_t round_ = 0;
  std::vector<int64_t> total_, result_;
};

using Weights = std::vector<std::vector<float>>;

Weights measure_alone(const io::Scene& scene, const l4d_camera& camera, uint32_t metric,
                      const l4d_process_group& group) {
  const RendererHandle r = make_renderer(L4D_BACKEND_CPU, 1);
  const l4d_gaussians gaussians = scene.view();
  r.check(l4d_renderer_set_gaussians(r.get(), &gaussians, &scene.timeline));
  std::vector<l4d_view> views;
  for (int t = 0; t < 24; ++t) views.push_back({t / 20.0, 0, 0});
  l4d_measure_options options = L4D_INIT(l4d_measure_options);
  options.metric = metric;
  options.agreement = 2;
  options.group = &group;
  Weights weights(L4D_WEIGHT_COUNT, std::vector<float>(scene.count()));
  std::vector<float*> to;
  for (std::vector<float>& w : weights) to.push_back(w.data());
  r.check(l4d_measure_importance(r.get(), &camera, 1, views.data(), views.size(), &options,
                                 to.data(), scene.count(), nullptr));
  return weights;
}

// Of each rank.
std::vector<Weights> measure_by(const io::Scene& scene, const l4d_camera& camera, uint32_t metric,
                                uint32_t count) {
  Meeting meeting(count);
  std::vector<Weights> out(count);
  std::vector<std::thread> threads;
  for (uint32_t rank = 0; rank < count; ++rank) {
    threads.emplace_back([&, rank] {
      l4d_process_group group = L4D_INIT(l4d_process_group);
      group.rank = rank;
      group.count = count;
      group.user = &meeting;
      group.sum = [](void* user, int64_t* values, uint64_t n) {
        static_cast<Meeting*>(user)->sum(values, n);
        return testing::Test::HasFatalFailure() ? 1 : 0;
      };
      out[rank] = measure_alone(scene, camera, metric, group);
    });
  }
  for (std::thread& t : threads) t.join();
  return out;
}

void expect_the_same(const io::Scene& scene, const l4d_camera& camera) {
  for (const uint32_t kind : {L4D_SENSITIVITY_SUM, L4D_SENSITIVITY_GAUSS_NEWTON}) {
    const Weights one = measure_by(scene, camera, kind, 1)[0];
    for (const uint32_t count : {2u, 5u, 20u}) {
      for (const Weights& many : measure_by(scene, camera, kind, count)) {
        EXPECT_EQ(one, many) << "measure " << kind << ", " << count << " ranks";
      }
    }
  }
}

TEST(ProcessGroup, WeightsDoNotDependOnTheirNumber) {
  expect_the_same(synth(1500), ring_camera(64, 44, 0.7));
}

// A telescope: what moves by a hair crosses many pixels, and squares are beyond what sums hold.
TEST(ProcessGroup, FullSumsAreFullForAll) {
  SceneBuilder builder;
  const double rgb[3] = {0.9, 0.2, 0.6};
  for (int i = 0; i < 40; ++i) {
    builder.add_ball(1e-7 * (i % 8 - 4), 1e-7 * (i / 8 - 2), 1, 1e-7 + 1e-8 * i, 0.7, rgb);
  }
  const l4d_camera camera = axis_camera(64, 44, 4e7);
  expect_the_same(builder.scene(), camera);
  const Weights w = measure_by(builder.scene(), camera, L4D_SENSITIVITY_GAUSS_NEWTON, 1)[0];
  // The root of 2^59 units over 24 views of 64 x 44 pixels and 3 coordinates.
  const float most = std::sqrt(0x1p39f / (3.0f * 24 * 64 * 44));
  EXPECT_FLOAT_EQ(*std::max_element(w[L4D_WEIGHT_POSITION].begin(), w[L4D_WEIGHT_POSITION].end()),
                  most);
}

}  // namespace
}  // namespace l4d::render
