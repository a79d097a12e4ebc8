// SPDX-License-Identifier: Apache-2.0
// Playing a stream from a cache of buckets shows what the whole scene shows.
#include <cuda_runtime_api.h>

#include <chrono>
#include <iostream>
#include <memory>
#include <thread>

#include "l4d/cuda_player.h"
#include "tests/common/codec.h"
#include "tests/common/stream_editor.h"
#include "tests/gpu/decode_support.h"
#include "tests/gpu/render_support.h"

namespace l4d::render {
namespace {

using test::cuda_check;

io::Scene long_scene(double seconds, uint64_t gaussians) {
  io::SynthOptions options;
  options.seconds = seconds;
  options.gaussians = gaussians;
  options.seed = 21;
  return io::synthesize(options);
}

Bytes encode(const io::Scene& scene, const char* preset, double page_size = 512) {
  const EncoderHandle e;
  e.check(l4d_encoder_set_preset(e.get(), preset));
  e.check(l4d_encoder_set(e.get(), L4D_ENC_PAGE_SIZE, L4D_ALL_COMPONENTS, page_size));
  // So that small scenes have fine layers too.
  e.check(l4d_encoder_set(e.get(), L4D_ENC_MERGE_COUNT, L4D_ALL_COMPONENTS, 0));
  e.check(l4d_encoder_set(e.get(), L4D_ENC_MERGE_FRACTION, L4D_ALL_COMPONENTS, 0));
  // The presets of the paper drop what weights call unseen; there are none here.
  e.check(l4d_encoder_set(e.get(), L4D_ENC_PRUNE_WEIGHT, L4D_ALL_COMPONENTS, -1));
  const l4d_gaussians g = scene.view();
  e.check(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, &scene.placement));
  return e.encode();
}

struct Destroy {
  void operator()(l4d_cuda_player* p) const { l4d_cuda_player_destroy(p); }
};

// A player of a stream in memory, its decoder, and an image.
class Playing {
 public:
  Playing(const Bytes& bytes, const l4d_camera& camera, const l4d_cuda_player_options& options)
      : camera_(camera) {
    decoder_.open_memory(bytes.data(), bytes.size());
    l4d_cuda_player* p = nullptr;
    EXPECT_EQ(l4d_cuda_player_create(decoder_.get(), &options, &p), L4D_OK)
        << l4d_decoder_error_message(decoder_.get());
    player_.reset(p);
    cuda_check(cudaMalloc(&rgb_, 3 * pixels() * sizeof(float)));
    cuda_check(cudaStreamCreate(&stream_));
    check(l4d_cuda_player_reserve(get(), camera.width, camera.height, 1 << 20));
  }
  ~Playing() {
    player_.reset();
    cudaFree(rgb_);
    cudaStreamDestroy(stream_);
  }
  Playing(const Playing&) = delete;
  Playing& operator=(const Playing&) = delete;

  l4d_cuda_player* get() const { return player_.get(); }
  void check(l4d_status status) const {
    EXPECT_EQ(status, L4D_OK) << l4d_cuda_player_error_message(get());
  }
  cudaStream_t stream() const { return stream_; }
  l4d_status launch(double time) const {
    l4d_cuda_image image;
    l4d_cuda_image_init(&image);
    image.rgb = static_cast<float*>(rgb_);
    return l4d_cuda_player_render(get(), time, &camera_, &image, stream_);
  }
  std::vector<float> render(double time) const {
    check(launch(time));
    l4d_cuda_frame_stats stats;
    l4d_cuda_frame_stats_init(&stats);
    check(l4d_cuda_player_get_stats(get(), stream_, &stats));
    std::vector<float> out(3 * pixels());
    cuda_check(cudaMemcpy(out.data(), rgb_, out.size() * sizeof(float), cudaMemcpyDeviceToHost));
    return out;
  }
  l4d_cuda_player_counters counters() const {
    l4d_cuda_player_counters c;
    l4d_cuda_player_counters_init(&c);
    check(l4d_cuda_player_get_counters(get(), &c));
    return c;
  }

 private:
  size_t pixels() const { return size_t{camera_.width} * camera_.height; }
  const l4d_camera camera_;
  DecoderHandle decoder_;
  std::unique_ptr<l4d_cuda_player, Destroy> player_;
  void* rgb_ = nullptr;
  cudaStream_t stream_ = nullptr;
};

l4d_gaussians view_of(const GaussianArrays& a) {
  l4d_gaussians g;
  l4d_gaussians_init(&g);
  g.count = a.count();
  g.sh_degree = a.sh_degree;
  g.flags = a.flags;
  g.position = a.position.data();
  g.mean_t = a.mean_t.data();
  g.log_scale = a.log_scale.data();
  g.rotor = a.rotor.data();
  g.opacity = a.opacity.data();
  g.sh = a.sh.data();
  return g;
}

l4d_cuda_player_options exact_options() {
  l4d_cuda_player_options options;
  l4d_cuda_player_options_init(&options);
  options.sh_format = L4D_CUDA_SH_FLOAT32;
  return options;
}

class Player : public test::OnDevice<testing::TestWithParam<const char*>> {};

TEST_P(Player, ShowsTheWholeSceneAtAnyTime) {
  const io::Scene scene = long_scene(20, 15000);
  const Bytes bytes = encode(scene, GetParam());
  const l4d_camera camera = ring_camera(200, 150, 1.1);
  const Playing playing(bytes, camera, exact_options());
  // The whole of what was decoded, on the host.
  const GaussianArrays all = test::decode(bytes, test::all_query());
  RendererHandle expected = make_renderer(L4D_BACKEND_CPU);
  expected.set_gaussians(view_of(all), scene.timeline);
  test::Random random(4);
  for (int k = 0; k < 24; ++k) {
    // Steps forward, with leaps between them, past the end too.
    const double time = k % 4 == 3 ? random.uniform(-1, 21) : 0.05 * k;
    expected.set_time(std::min(std::max(time, 0.0), 20.0));
    const ImageDifference d =
        difference_of(playing.render(time), expected.render(camera), 1.0 / 255);
    EXPECT_LE(d.beyond, 4u) << time << ", largest " << d.largest;
  }
}

// An image is the same whatever was played before, at any window and with or without reading ahead.
TEST_P(Player, ImagesDependOnTheTimeAlone) {
  const Bytes bytes = encode(long_scene(20, 15000), GetParam());
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  l4d_cuda_player_options options = exact_options();
  const Playing forward(bytes, camera, options);
  std::vector<std::vector<float>> images;
  for (int k = 0; k < 60; ++k) images.push_back(forward.render(k / 3.0));
  EXPECT_LT(forward.counters().gaussians_decoded, 15000u * 3 / 2);
  for (const uint32_t read_ahead : {0u, 1u}) {
    options.read_ahead = read_ahead;
    const Playing other(bytes, camera, options);
    for (int k = 59; k >= 0; --k) {
      EXPECT_EQ(difference_of(other.render(k / 3.0), images[static_cast<size_t>(k)], 0).beyond, 0u)
          << k;
    }
    test::Random random(5);
    for (int k = 0; k < 40; ++k) {
      const uint32_t at = random.below(60);
      if (k % 5 == 0) other.check(l4d_cuda_player_seek(other.get(), random.uniform(0, 20)));
      EXPECT_EQ(difference_of(other.render(at / 3.0), images[at], 0).beyond, 0u) << at;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Presets, Player,
                         testing::Values("default", "indexed", "paper-small", "lossless"),
                         [](const auto& preset) {
                           std::string name = preset.param;
                           name.erase(std::remove(name.begin(), name.end(), '-'), name.end());
                           return name;
                         });

TEST(PlayerMemory, StaysThatOfTheInstantsAtHand) {
  L4D_SKIP_WITHOUT_DEVICE();
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  // As many Gaussians per second in a scene 8 times as long.
  uint64_t store[2] = {};
  for (int k = 0; k < 2; ++k) {
    const double seconds = k == 0 ? 10 : 80;
    io::SynthOptions o;
    o.seconds = seconds;
    o.static_gaussians = 20000;
    o.gaussians = 20000 + static_cast<uint64_t>(4000 * seconds);
    const Bytes bytes = encode(io::synthesize(o), "default");
    const Playing playing(bytes, camera, exact_options());
    for (double t = 0; t < seconds; t += 1.0 / 12) playing.render(t);
    store[k] = playing.counters().store_bytes;
    const uint64_t all = o.gaussians * 268;
    EXPECT_LT(store[k], k == 0 ? all : all / 3);
  }
  EXPECT_LT(static_cast<double>(store[1]), 1.2 * static_cast<double>(store[0]));
}

// The player's thread takes memory for the next window between a frame and its statistics.
TEST(PlayerMemory, GrowsBetweenAFrameAndItsStatistics) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Bytes bytes = encode(long_scene(20, 15000), "default");
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  const Playing playing(bytes, camera, exact_options());
  uint64_t store = 0, grown = 0;
  for (int k = 0; k < 20; ++k) {
    playing.check(playing.launch(k));
    const uint64_t before = playing.counters().store_bytes;
    for (int wait = 0; wait < 50 && playing.counters().store_bytes == before; ++wait) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    grown += playing.counters().store_bytes > before;
    store = std::max(store, before);
    l4d_cuda_frame_stats stats;
    l4d_cuda_frame_stats_init(&stats);
    playing.check(l4d_cuda_player_get_stats(playing.get(), playing.stream(), &stats));
    EXPECT_GT(stats.visible, 0u);
  }
  std::cout << "grown " << grown << " times, to " << store << " bytes\n";
  EXPECT_GT(grown, 0u);
}

TEST(PlayerMemory, BudgetsKeepWhatFitsAndRefuseWhatDoesNot) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Bytes bytes = encode(long_scene(10, 20000), "default");
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  l4d_cuda_player_options options = exact_options();
  options.memory_bytes = 256 << 20;  // small buckets have a chunk each
  const Playing all(bytes, camera, options);
  const auto play = [&] {
    // In steps shorter than a window, so that none is passed over.
    for (int k = 0; k < 160; ++k) all.render(k / 16.0);
    return all.counters();
  };
  const l4d_cuda_player_counters first = play();
  EXPECT_EQ(first.gaussians_decoded, 20000u);
  EXPECT_EQ(first.resident_gaussians, 20000u);
  const l4d_cuda_player_counters second = play();
  EXPECT_EQ(second.gaussians_decoded, 20000u);  // the second time nothing is decoded
  EXPECT_GT(second.buckets_found, first.buckets_found);
  EXPECT_LE(second.store_bytes, options.memory_bytes);

  options.memory_bytes = 2000 * 268;
  const Playing little(bytes, camera, options);
  EXPECT_EQ(little.launch(1), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_STRNE(l4d_cuda_player_error_message(little.get()), "");
}

TEST(PlayerFaults, DamageIsToldAndTheRestPlays) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = long_scene(10, 20000);
  Bytes bytes = encode(scene, "default");
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  const Playing whole(bytes, camera, exact_options());
  // In a page that some times need, and the beginning does not.
  Bytes damaged;
  for (size_t at = bytes.size() - 100; damaged.empty(); at -= 700) {
    ASSERT_GT(at, bytes.size() / 10);
    Bytes changed = bytes;
    changed[at] ^= 0x40;
    DecoderHandle host;
    host.open_memory(changed.data(), changed.size());
    l4d_splat_buffers splats;
    l4d_splat_buffers_init(&splats);
    const auto shows = [&](double time) {
      return l4d_decoder_slice(host.get(), time, &splats) == L4D_OK;
    };
    if (!shows(0.5)) continue;
    for (int k = 0; k <= 50 && damaged.empty(); ++k) {
      if (!shows(k / 5.0)) damaged = changed;
    }
  }
  const Playing playing(damaged, camera, exact_options());
  int failed = 0;
  for (int k = 0; k <= 50; ++k) {
    const double time = k / 5.0;
    const l4d_status status = playing.launch(time);
    if (status == L4D_OK) {
      EXPECT_EQ(difference_of(playing.render(time), whole.render(time), 0).beyond, 0u) << time;
      continue;
    }
    ++failed;
    EXPECT_EQ(status, L4D_ERR_CHECKSUM);
    EXPECT_STRNE(l4d_cuda_player_error_message(playing.get()), "");
  }
  EXPECT_GT(failed, 0);
  EXPECT_LT(failed, 51);
}

TEST(PlayerFaults, ArgumentsAreChecked) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Bytes bytes = encode(long_scene(4, 3000), "default");
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  const Playing playing(bytes, camera, exact_options());
  EXPECT_EQ(playing.launch(std::nan("")), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_cuda_player_seek(playing.get(), std::nan("")), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_cuda_player_reserve(playing.get(), 20000, 10, 10), L4D_ERR_INVALID_ARGUMENT);
  l4d_cuda_player* out = nullptr;
  DecoderHandle empty;
  EXPECT_EQ(l4d_cuda_player_create(empty.get(), nullptr, &out), L4D_ERR_INVALID_STATE);
  l4d_cuda_player_options bad = exact_options();
  bad.window = -1;
  DecoderHandle open;
  open.open_memory(bytes.data(), bytes.size());
  EXPECT_EQ(l4d_cuda_player_create(open.get(), &bad, &out), L4D_ERR_INVALID_ARGUMENT);
  bad = exact_options();
  bad.device = 4000;
  EXPECT_EQ(l4d_cuda_player_create(open.get(), &bad, &out), L4D_ERR_DEVICE);
  EXPECT_EQ(out, nullptr);
}

}  // namespace
}  // namespace l4d::render
