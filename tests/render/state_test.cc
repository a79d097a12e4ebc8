// SPDX-License-Identifier: Apache-2.0
// What a renderer shows depends on what it was set to last, not on what it showed before.
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "tests/common/codec.h"
#include "tests/render/scenes.h"

namespace l4d::render {
namespace {

// Equal numbers of Gaussians that never change, elsewhere and in other colours.
io::Scene still_scene(uint64_t seed) {
  SceneBuilder builder;
  test::Random random(seed);
  for (int i = 0; i < 300; ++i) {
    const double rgb[3] = {random.uniform(), random.uniform(), random.uniform()};
    builder.add_ball(random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(-2, 2),
                     random.uniform(0.02, 0.3), random.uniform(0.1, 0.9), rgb);
  }
  return builder.scene();
}

// Half of it still; the rest fades, or moves.
io::Scene mixed_scene(uint64_t seed) {
  io::Scene scene = still_scene(seed);
  test::Random random(seed + 100);
  for (size_t i = 0; i < scene.count(); i += 2) {
    scene.log_scale[4 * i + 3] = static_cast<float>(random.uniform(-2, 0));
    scene.mean_t[i] = static_cast<float>(random.uniform(0, 2));
    if (i % 4 == 0) scene.rotor[8 * i + 4] = 0.1f;
  }
  return scene;
}

class State : public testing::TestWithParam<uint32_t> {};

// Every order of two out of five things to show, at one instant and at two.
TEST_P(State, NothingOfTheSceneBeforeIsLeft) {
  const std::vector<io::Scene> scenes = {still_scene(1), still_scene(2), mixed_scene(3),
                                         mixed_scene(4)};
  const Bytes& file = test::dynamic_file();
  DecoderHandle decoder;
  decoder.open_memory(file.data(), file.size());
  const l4d_camera camera = ring_camera(72, 50, 0.7);
  const size_t things = scenes.size() + 1;
  const auto set = [&](RendererHandle& r, size_t thing) {
    if (thing == scenes.size()) {
      r.set_decoder(decoder);
    } else {
      r.set_gaussians(scenes[thing].view(), scenes[thing].timeline);
    }
  };
  const auto shown_fresh = [&](size_t thing, double time) {
    RendererHandle r = make_renderer(GetParam());
    set(r, thing);
    r.set_time(time);
    return r.render(camera);
  };
  std::vector<std::vector<float>> want;
  for (size_t thing = 0; thing < things; ++thing) want.push_back(shown_fresh(thing, 1.25));
  for (size_t thing = 1; thing < things; ++thing) {
    ASSERT_GT(largest_difference(want[thing], want[thing - 1]), 0.1);
  }
  for (const double before : {1.25, 0.5}) {
    for (size_t first = 0; first < things; ++first) {
      for (size_t second = 0; second < things; ++second) {
        RendererHandle r = make_renderer(GetParam());
        set(r, first);
        r.set_time(before);
        r.render(camera);
        set(r, second);
        r.set_time(1.25);
        EXPECT_TRUE(equal_bits(r.render(camera), want[second]))
            << first << " then " << second << ", time before " << before;
      }
    }
  }
}

// The caller may fill the same arrays anew, so that not even an address tells scenes apart.
TEST_P(State, ArraysThatWereFilledAnewAreReadAnew) {
  io::Scene scene = mixed_scene(5);
  const l4d_camera camera = ring_camera(72, 50, 0.7);
  RendererHandle r = make_renderer(GetParam());
  r.set_gaussians(scene.view(), scene.timeline);
  r.set_time(1);
  const std::vector<float> before = r.render(camera);
  const io::Scene other = mixed_scene(6);
  std::copy(other.position.begin(), other.position.end(), scene.position.begin());
  std::copy(other.sh.begin(), other.sh.end(), scene.sh.begin());
  r.set_gaussians(scene.view(), scene.timeline);
  r.set_time(1);
  RendererHandle fresh = make_renderer(GetParam());
  fresh.set_gaussians(scene.view(), scene.timeline);
  fresh.set_time(1);
  const std::vector<float> want = fresh.render(camera);
  EXPECT_TRUE(equal_bits(r.render(camera), want));
  EXPECT_GT(largest_difference(before, want), 0.1);
}

INSTANTIATE_TEST_SUITE_P(Paths, State, testing::Values(L4D_BACKEND_REFERENCE, L4D_BACKEND_CPU),
                         [](const testing::TestParamInfo<uint32_t>& path) {
                           return std::string(path.param == L4D_BACKEND_CPU ? "fast" : "reference");
                         });

}  // namespace
}  // namespace l4d::render
