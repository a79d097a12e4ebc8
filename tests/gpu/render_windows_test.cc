// SPDX-License-Identifier: Apache-2.0
// Flat windows on a device: a slice holds the very Gaussians that the host's slice holds.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cmath>

#include "io/ply/scene_ply.h"
#include "io/sequence/sequence.h"
#include "render/cuda/frame/device_frame.h"
#include "render/frame/scene.h"
#include "tests/common/codec.h"
#include "tests/gpu/decode_support.h"
#include "tests/gpu/trainable_support.h"
#include "tests/render/unlimited.h"

namespace l4d::render {
namespace {

// A scene in a store, and its slices.
class DeviceSlices {
 public:
  explicit DeviceSlices(const io::Scene& scene)
      : count_(static_cast<uint32_t>(scene.count())),
        arrays_(scene, scene.count(), 3 * scene.sh_coefficients(), 0.0f) {
    must(cuda::use_device(0));
    const l4d_gaussians g = arrays_.view(scene);
    StoreShape shape = shape_of(g, scene.timeline);
    shape.sh_degree = scene.sh_degree;
    must(store.reserve(shape));
    must(store.store_scene(g));
    must(frame_.create());
    FrameCapacity capacity;
    capacity.width = capacity.height = 16;
    capacity.visible = count_;
    capacity.instances = 1 << 20;
    must(frame_.reserve(capacity));
    must(frame_.reserve_slices(store));
  }
  // What is visible at `time`, in ascending order.
  std::vector<uint32_t> ids(double time) {
    const float black[3] = {0, 0, 0};
    must(frame_.draw(store, time, ring_camera(16, 16, 0.5), black, false, {}, nullptr));
    FrameStats stats{};
    must(frame_.stats(nullptr, &stats));
    const auto slots = read(frame_.memory().visible, stats.visible);
    const auto all = read(store.resident().id, count_);
    std::vector<uint32_t> out;
    for (const uint32_t slot : slots) out.push_back(all[slot & kSlotMask]);
    std::sort(out.begin(), out.end());
    return out;
  }

  SceneStore store;

 private:
  static void must(const Status& status) { ASSERT_TRUE(status.ok()) << status.message(); }
  static std::vector<uint32_t> read(const uint32_t* from, size_t count) {
    std::vector<uint32_t> out(count);
    test::cuda_check(
        cudaMemcpy(out.data(), from, count * sizeof(uint32_t), cudaMemcpyDeviceToHost));
    return out;
  }
  const uint32_t count_;
  const TrainableArrays arrays_;
  DeviceFrame frame_;
};

void expect_slices_of_the_host(const io::Scene& scene) {
  Scene host;
  ASSERT_TRUE(host.prepare(scene.view(), scene.timeline, 2, unlimited()).ok());
  DeviceSlices device(scene);
  const double end = host.time_end();
  const auto compare = [&](double time) {
    Frame<float> frame;
    ASSERT_TRUE(
        host.slice(std::clamp(time, scene.timeline.time_begin, end), 2, unlimited(), &frame).ok());
    std::vector<uint32_t> expected(frame.id.begin(),
                                   frame.id.begin() + static_cast<std::ptrdiff_t>(frame.count()));
    std::sort(expected.begin(), expected.end());
    ASSERT_EQ(device.ids(time), expected) << time;
  };
  for (const double frame : {0.0, 1.0, 2.0, 29.0, 30.0, 31.0, 118.0, 119.0, 120.0}) {
    // As a player computes it; where the frame begins by the rule; and in between.
    for (const double border : {frame, frame - kFrameSlack, frame + 0.4}) {
      const double time = time_of_frame(scene.timeline, border);
      compare(time);
      compare(std::nextafter(time, -1e300));
      compare(std::nextafter(time, 1e300));
    }
  }
  compare(-1e6);
  compare(end + 1e6);
}

TEST(DeviceWindows, SlicesHoldWhatTheHostsHold) {
  L4D_SKIP_WITHOUT_DEVICE();
  io::Scene scene = with_windows(synth(6000, 4));
  expect_slices_of_the_host(scene);
  scene.timeline.fps_num = 30000;
  scene.timeline.fps_den = 1001;
  scene.timeline.time_begin = 1000.7;
  for (float& t : scene.mean_t) t += 1000.7f;
  expect_slices_of_the_host(scene);
}

// Every Gaussian in one frame alone: at each instant the device shows those of its frame.
TEST(DeviceWindows, TileTime) {
  L4D_SKIP_WITHOUT_DEVICE();
  io::Scene scene = synth(1200, 4);
  const uint32_t frames = scene.timeline.num_frames;
  for (uint32_t i = 0; i < scene.count(); ++i) {
    scene.window.insert(scene.window.end(), {i % frames, i % frames + 1});
    scene.opacity[i] = 0.5f;
  }
  DeviceSlices device(scene);
  for (uint32_t k = 0; k < frames; ++k) {
    std::vector<uint32_t> expected;
    for (uint32_t i = k; i < scene.count(); i += frames) expected.push_back(i);
    for (const double part : {0.0, 0.5, 0.999}) {
      EXPECT_EQ(device.ids((k + part) / 30.0), expected) << k << " and " << part;
    }
  }
}

TEST(DeviceWindows, ScenesWithoutThemHaveNoMemoryForThem) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(500, 4);
  const DeviceSlices without(scene), with(with_windows(scene));
  EXPECT_EQ(without.store.resident().window, nullptr);
  EXPECT_NE(with.store.resident().window, nullptr);
  EXPECT_EQ(with.store.slot_bytes(), without.store.slot_bytes() + 8);
}

// Frames of splats that became one scene and a stream.
TEST(DeviceWindows, SequencesOfFrames) {
  L4D_SKIP_WITHOUT_DEVICE();
  io::SequenceOptions sequence;
  sequence.fps = 10;
  for (uint32_t k = 0; k < 24; ++k) {
    test::Random random(3);
    io::Splats splats;
    for (int i = 0; i < 200; ++i) {
      const double phase = random.uniform(0, 6) + 0.25 * k;
      const double place[3] = {random.uniform(-2, 2) + std::sin(phase),
                               random.uniform(-2, 1) + std::cos(phase), random.uniform(-2, 2)};
      for (const double x : place) {
        splats.position.push_back(static_cast<float>(x));
        splats.sh.push_back(random.uniformf(-1, 1));
      }
      for (const float c : {0.04f, 0.0f, 0.0f, 0.01f, 0.0f, 0.0025f}) {
        splats.covariance.push_back(c);
      }
      splats.opacity.push_back(0.8f);
    }
    sequence.paths.push_back(test::temporary_path("_frame.ply"));
    io::write_3dgs_ply(sequence.paths.back(), splats);
  }
  io::SequenceReport report;
  const io::Scene scene = io::read_sequence(sequence, &report);
  ASSERT_GT(report.windows, 200u);
  expect_slices_of_the_host(scene);

  const EncoderHandle encoder;
  const l4d_gaussians view = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
  const Bytes file = encoder.encode();
  for (const l4d_query& query : {test::all_query(), test::time_query(1.1)}) {
    const GaussianArrays expected = test::decode(file, query, L4D_BACKEND_REFERENCE);
    const test::DeviceResult found = test::decode_on_device(file, query);
    ASSERT_EQ(found.status, L4D_OK) << found.detail;
    EXPECT_TRUE(test::same_bits("mean_t", found.arrays.mean_t, expected.mean_t));
    EXPECT_TRUE(test::same_bits("position", found.arrays.position, expected.position));
    EXPECT_EQ(found.arrays.window, expected.window);
  }
}

}  // namespace
}  // namespace l4d::render
