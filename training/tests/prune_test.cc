// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/prune.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "eval/views/importance.h"
#include "io/image/metrics.h"
#include "training/run/train/output.h"
#include "training/step/backend.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

TEST(Prune, TakesTheLeast) {
  EXPECT_EQ(most_important({5, 1, 4, 1, 3}, 0.41), (std::vector<uint8_t>{1, 0, 1, 0, 1}));
  EXPECT_EQ(most_important({5, 1, 4, 1, 3}, 0.2), (std::vector<uint8_t>{1, 1, 1, 0, 1}));
  EXPECT_EQ(most_important({5, 1}, 1), (std::vector<uint8_t>{1, 0}));
  EXPECT_TRUE(most_important({}, 0.5).empty());
}

TEST(Prune, LeavesWhatASizeHasRoomFor) {
  EXPECT_EQ(share_over(1000, 1000, 3), 0);
  EXPECT_EQ(share_over(1000, 250, 1), 0.75);
  // Alike at each of those that are left.
  EXPECT_NEAR(share_over(8000, 1000, 3), 0.5, 1e-12);
}

// The estimate against images: removing the three tenths with the least predicted loss changes them
// less than removing those of the least opacity, and much less than removing the other end.
TEST(Prune, PredictsWhatImagesLose) {
  const Capture capture = read_capture(test::tiny_capture(), {});
  const ImageLoader loader(capture, 1);
  const ModelState model = model_of(test::tiny_truth());
  std::vector<uint32_t> views;
  for (uint32_t k = 0; k < capture.views.size(); k += 5) views.push_back(k);
  const std::vector<float> loss =
      loss_without(model, capture, loader, views, rendering_of({}, 1), 3);
  ASSERT_EQ(loss.size(), model.count);
  const auto error_without = [&](const std::vector<float>& values) {
    const std::unique_ptr<Backend> whole = make_cpu_backend(1), part = make_cpu_backend(1);
    whole->load(model, capture.timeline());
    part->load(model, capture.timeline());
    part->keep(most_important(values, 0.3));
    constexpr float kBlack[3] = {0, 0, 0};
    double sum = 0;
    for (const uint32_t view : views) {
      const l4d_camera& camera = loader.camera_of(view);
      const double time = capture.views[view].time;
      sum += io::mse(whole->render(camera, time, kBlack), part->render(camera, time, kBlack));
    }
    return sum;
  };
  std::vector<float> reversed(loss), opacity(model.value.opacity);
  for (float& v : reversed) v = -v;
  const double least = error_without(loss);
  RecordProperty("faint_over_least", std::to_string(error_without(opacity) / least));
  RecordProperty("most_over_least", std::to_string(error_without(reversed) / least));
  EXPECT_LT(1.5 * least, error_without(opacity));
  EXPECT_LT(20 * least, error_without(reversed));
}

// The encoder keeps what it is worth to code, and no more of it with a preset for fewer bytes.
TEST(Prune, AsksTheEncoder) {
  const Capture capture = read_capture(test::tiny_capture(), {});
  const ImageLoader loader(capture, 1);
  io::Scene scene = scene_of(model_of(test::tiny_truth()), capture.timeline());
  const eval::CameraViews views = views_of(capture, loader, "train");
  const io::Weights weights =
      eval::measure_importance(rendering_of({}, 1), scene, views,
                               eval::measure_options(0, views.views.size(), 0))
          .weights;
  const std::vector<uint8_t> small = trial_encode(scene, weights, "small", 1).kept;
  const std::vector<uint8_t> tiny = trial_encode(scene, weights, "tiny", 1).kept;
  ASSERT_EQ(small.size(), scene.count());
  const auto kept = std::count(small.begin(), small.end(), 1);
  EXPECT_LT(std::count(tiny.begin(), tiny.end(), 1), kept);
  EXPECT_LT(kept, 3000);
  EXPECT_GT(kept, 300);
  // Those that go weigh less.
  double gone = 0, stays = 0;
  for (size_t i = 0; i < small.size(); ++i) {
    (small[i] != 0 ? stays : gone) += static_cast<double>(weights.opacity[i]);
  }
  EXPECT_LT(5 * gone / static_cast<double>(3000 - kept), stays / static_cast<double>(kept));
}

}  // namespace
}  // namespace l4d::train
