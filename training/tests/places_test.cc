// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/places.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "training/run/train/output.h"
#include "training/step/backend.h"
#include "training/sync/shift.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

io::Image noise(uint32_t width, uint32_t height, int32_t dx, int32_t dy, float gain) {
  io::Image image(width, height);
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const double u = static_cast<double>(x) - dx, v = static_cast<double>(y) - dy;
      const double value = 0.5 + 0.2 * std::sin(0.7 * u + 0.3 * v) * std::cos(0.31 * v * v / 9 - u);
      for (size_t c = 0; c < 3; ++c) {
        image.rgb[3 * (size_t{y} * width + x) + c] = static_cast<float>(value) * gain;
      }
    }
  }
  return image;
}

TEST(Shift, IsThatOfTheImage) {
  for (const uint32_t scale : {1U, 2U}) {
    const uint32_t width = 200 * scale, height = 90;
    const io::Image one = noise(width, height, 0, 0, 1);
    const Shift none = shift_between(one, noise(width, height, 0, 0, 0.5f), {}, 10);
    EXPECT_NEAR(std::hypot(none.x, none.y), 0, 0.02);
    EXPECT_GT(none.unmoved, 0.99);
    const Shift moved = shift_between(noise(width, height, 6, -4, 0.7f), one, {}, 10 * scale);
    EXPECT_NEAR(moved.x, 6, 0.2);
    EXPECT_NEAR(moved.y, -4, 0.2);
    EXPECT_GT(moved.correlation, moved.unmoved + 0.2);
  }
  // What does not count is not looked at.
  io::Image spoiled = noise(200, 90, 6, -4, 1);
  std::vector<uint8_t> mask(size_t{200} * 90, 1);
  for (uint32_t y = 0; y < 90; ++y) {
    for (uint32_t x = 0; x < 80; ++x) {
      mask[y * 200 + x] = 0;
      spoiled.rgb[3 * (y * 200 + x)] = x % 2 == 0 ? 90.0f : -90.0f;
    }
  }
  EXPECT_NEAR(shift_between(spoiled, noise(200, 90, 0, 0, 1), mask, 10).x, 6, 0.2);
}

// Waves of 48 pixels, moved by 17: the best of up to 9 lies at the border, and says nothing.
TEST(Shift, IsNoneAtTheBorderOfWhatIsTried) {
  const auto waves = [](double shift) {
    io::Image image(192, 40);
    for (size_t i = 0; i < image.rgb.size(); ++i) {
      const double x = static_cast<double>(i / 3 % 192) - shift;
      const double y = static_cast<double>(i / 3 / 192);
      image.rgb[i] = static_cast<float>(0.5 + 0.3 * std::sin(2 * 3.14159265358979 * x / 48) +
                                        0.1 * std::sin(0.9 * y + y * y / 40));
    }
    return image;
  };
  const Shift found = shift_between(waves(17), waves(0), {}, 9);
  EXPECT_EQ(found.x, 0);
  EXPECT_EQ(found.correlation, found.unmoved);
}

// The tiny capture by lenses of so many times the focal length.
std::string capture_by_lenses(const test::Folder& folder, double longer) {
  nlohmann::json cameras =
      nlohmann::json::parse(test::bytes_of(test::tiny_capture() + "/cameras.json"));
  for (nlohmann::json& camera : cameras["cameras"]) {
    for (const size_t k : {0U, 1U}) camera["K"][k][k] = longer * camera["K"][k][k].get<double>();
  }
  std::ofstream(folder / "cameras.json") << cameras;
  RenderCaptureOptions options;
  options.camera_file = folder / "cameras.json";
  options.frames = 1;
  render_capture(folder / "capture", test::tiny_truth(), options);
  return folder / "capture";
}

class Places : public testing::TestWithParam<double> {};

TEST_P(Places, OfTurnedCamerasAreNamedAndNoOthers) {
  const test::Folder folder;
  const Capture truth = read_capture(capture_by_lenses(folder, GetParam()), {});
  for (const double degrees : {0.0, 2.0}) {
    Capture capture = truth;
    test::turn(&capture.cameras[6].source.camera, degrees);
    const ImageLoader loader(capture, 1);
    const std::unique_ptr<Backend> backend = make_cpu_backend(1);
    backend->load(model_of(test::tiny_truth()), capture.timeline());
    constexpr float kBlack[3] = {0, 0, 0};
    const std::map<uint32_t, std::string> notes = notes_of_places(
        capture, loader, 1, {0, 0, 0},
        [&](uint32_t view) {
          return backend->render(loader.camera_of(view), capture.views[view].time, kBlack);
        },
        nullptr);
    if (degrees == 0) {
      EXPECT_TRUE(notes.empty()) << notes.begin()->second;
    } else {
      EXPECT_THAT(notes, testing::ElementsAre(
                             testing::Pair(6, testing::HasSubstr("amera 6 sees things 2."))));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Lenses, Places, testing::Values(1.0, 2.5));

}  // namespace
}  // namespace l4d::train
