// SPDX-License-Identifier: Apache-2.0
// Playing a stream from a cache of buckets shows what the whole scene shows.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "l4d/experimental/cuda_player.h"
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
  e.check(l4d_encoder_set(e.get(), L4D_ENC_PAGE_SIZE, page_size));
  // So that small scenes have fine layers too.
  e.check(l4d_encoder_set(e.get(), L4D_ENC_MERGE_COUNT, 0));
  e.check(l4d_encoder_set(e.get(), L4D_ENC_MERGE_FRACTION, 0));
  // The presets of the paper drop what weights call unseen; there are none here.
  e.check(l4d_encoder_set(e.get(), L4D_ENC_PRUNE_WEIGHT, -1));
  const l4d_gaussians g = scene.view();
  e.check(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, &scene.placement));
  return e.encode();
}

struct Destroy {
  void operator()(l4d_cuda_player* p) const { l4d_cuda_player_destroy(p); }
};

l4d_reader reader_of(const Bytes& bytes) {
  l4d_reader r = L4D_INIT(l4d_reader);
  r.user = const_cast<Bytes*>(&bytes);
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    const Bytes& b = *static_cast<const Bytes*>(user);
    if (offset >= b.size()) return 0;
    n = std::min(n, b.size() - static_cast<size_t>(offset));
    std::copy_n(b.data() + offset, n, static_cast<unsigned char*>(dst));
    return static_cast<int64_t>(n);
  };
  r.size = [](void* user) -> int64_t {
    return static_cast<int64_t>(static_cast<const Bytes*>(user)->size());
  };
  return r;
}

// A player of a stream in memory, and an image.
class Playing {
 public:
  // Of `bytes`, unless the options name a link.
  Playing(const Bytes& bytes, const l4d_camera& camera, l4d_cuda_player_options options)
      : camera_(camera), reader_(reader_of(bytes)) {
    if (options.uri == nullptr) options.reader = &reader_;
    l4d_cuda_player* p = nullptr;
    EXPECT_EQ(l4d_cuda_player_create(&options, &p), L4D_OK) << l4d_last_error_message();
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
  void check(l4d_status status) const { EXPECT_EQ(status, L4D_OK) << l4d_last_error_message(); }
  cudaStream_t stream() const { return stream_; }
  l4d_status launch(double time) const {
    l4d_cuda_image image = L4D_INIT(l4d_cuda_image);
    image.rgb = static_cast<float*>(rgb_);
    return l4d_cuda_player_render(get(), time, &camera_, &image, stream_);
  }
  std::vector<float> render(double time) const {
    check(launch(time));
    l4d_cuda_frame_stats stats = L4D_INIT(l4d_cuda_frame_stats);
    check(l4d_cuda_player_get_stats(get(), stream_, &stats));
    std::vector<float> out(3 * pixels());
    cuda_check(cudaMemcpy(out.data(), rgb_, out.size() * sizeof(float), cudaMemcpyDeviceToHost));
    return out;
  }
  l4d_cuda_player_counters counters() const {
    l4d_cuda_player_counters c = L4D_INIT(l4d_cuda_player_counters);
    check(l4d_cuda_player_get_counters(get(), &c));
    return c;
  }

 private:
  size_t pixels() const { return size_t{camera_.width} * camera_.height; }
  const l4d_camera camera_;
  const l4d_reader reader_;
  std::unique_ptr<l4d_cuda_player, Destroy> player_;
  void* rgb_ = nullptr;
  cudaStream_t stream_ = nullptr;
};

l4d_gaussians view_of(const GaussianArrays& a) {
  l4d_gaussians g = L4D_INIT(l4d_gaussians);
  g.count = a.count();
  g.sh_degree = a.sh_degree;
  g.flags = a.flags;
  g.position = a.position.data();
  g.mean_t = a.mean_t.data();
  g.log_scale = a.log_scale.data();
  g.rotor = a.rotor.data();
  g.opacity = a.opacity.data();
  g.sh = a.sh.data();
  g.window = a.window.empty() ? nullptr : a.window.data();
  return g;
}

l4d_cuda_player_options exact_options() {
  l4d_cuda_player_options options = L4D_INIT(l4d_cuda_player_options);
  options.sh_float32 = 1;
  return options;
}

class Player : public test::OnDevice<testing::TestWithParam<const char*>> {};

void expect_the_whole_scene_at_any_time(const io::Scene& scene, const char* preset) {
  const Bytes bytes = encode(scene, preset);
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

TEST_P(Player, ShowsTheWholeSceneAtAnyTime) {
  expect_the_whole_scene_at_any_time(long_scene(20, 15000), GetParam());
}

TEST_P(Player, ShowsFlatWindows) {
  expect_the_whole_scene_at_any_time(with_windows(long_scene(20, 30000)), GetParam());
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
  for (const uint32_t no_read_ahead : {0u, 1u}) {
    options.no_read_ahead = no_read_ahead;
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

// Answers the requests of a player.
class Link {
 public:
  Link(const Bytes& bytes, l4d_cuda_player* player) : bytes_(bytes), player_(player) {}
  ~Link() { stop(); }
  void step() const {
    l4d_playback_item items[16];
    uint32_t count = 0;
    EXPECT_EQ(l4d_cuda_player_take(player_, items, 16, &count), L4D_OK);
    for (uint32_t i = 0; i < count; ++i) {
      if (items[i].kind != L4D_ITEM_REQUEST) continue;
      const uint64_t size = items[i].size == 0 ? bytes_.size() - items[i].offset : items[i].size;
      l4d_answer answer = L4D_INIT(l4d_answer);
      answer.status = 206;
      answer.offset = items[i].offset;
      answer.total_bytes = bytes_.size();
      EXPECT_EQ(l4d_cuda_player_answered(player_, items[i].id, &answer), L4D_OK);
      EXPECT_EQ(l4d_cuda_player_received(player_, items[i].id, bytes_.data() + items[i].offset,
                                         static_cast<size_t>(size)),
                L4D_OK);
      EXPECT_EQ(l4d_cuda_player_finished(player_, items[i].id, L4D_TRANSFER_ENDED), L4D_OK);
    }
    if (count == 0) std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
  void start() {
    thread_ = std::thread([this] {
      while (!stop_) step();
    });
  }
  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }

 private:
  const Bytes& bytes_;
  l4d_cuda_player* const player_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

// A link shows what the file shows, from another thread or from the one that draws.
TEST_P(Player, ShowsTheSameOverALink) {
  const Bytes bytes = encode(long_scene(20, 15000), GetParam());
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  const Playing file(bytes, camera, exact_options());
  l4d_cuda_player_options options = exact_options();
  options.uri = "a.l4d";
  const Playing blocking(bytes, camera, options);
  Link link(bytes, blocking.get());
  link.start();
  options.no_wait = 1;
  const Playing polling(bytes, camera, options);
  const Link own(bytes, polling.get());
  test::Random random(6);
  for (int k = 0; k < 40; ++k) {
    const double time = k % 4 == 3 ? random.uniform(0, 20) : k / 8.0;
    const std::vector<float> expected = file.render(time);
    EXPECT_EQ(difference_of(blocking.render(time), expected, 0).beyond, 0u) << time;
    while (polling.launch(time) == L4D_ERR_NEED_DATA) own.step();
    EXPECT_EQ(difference_of(polling.render(time), expected, 0).beyond, 0u) << time;
  }
  l4d_playback_state state = L4D_INIT(l4d_playback_state);
  blocking.check(l4d_cuda_player_get_state(blocking.get(), &state));
  EXPECT_GT(state.requests, 0u);
  EXPECT_EQ(state.end, 20);
}

// Base colours come first, and detail takes their place while frames show them.
TEST_P(Player, EndsUpInFullDetail) {
  const Bytes bytes = encode(long_scene(5, 15000), GetParam());
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  const Playing file(bytes, camera, exact_options());
  l4d_cuda_player_options options = exact_options();
  options.uri = "a.l4d";
  options.automatic = 1;
  options.no_wait = 1;
  const Playing playing(bytes, camera, options);
  const Link link(bytes, playing.get());
  const auto is_whole = [&] {
    l4d_playback_state s = L4D_INIT(l4d_playback_state);
    playing.check(l4d_cuda_player_get_state(playing.get(), &s));
    return s.ready != 0 && s.rung + 1 == s.num_rungs;
  };
  for (const double time : {0.5, 2.0, 4.5}) {
    for (bool shown = false; !shown;) {
      const l4d_status status = playing.launch(time);
      ASSERT_TRUE(status == L4D_OK || status == L4D_ERR_NEED_DATA) << l4d_last_error_message();
      shown = status == L4D_OK && is_whole();
      if (!shown) link.step();
    }
    EXPECT_EQ(difference_of(playing.render(time), file.render(time), 0).beyond, 0u) << time;
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
    // All of the short scene may be at hand, and a store grows by a sixteenth more than it needs.
    EXPECT_LT(store[k], k == 0 ? all + all / 16 : all / 3);
  }
  EXPECT_LT(static_cast<double>(store[1]), 1.2 * static_cast<double>(store[0]));
}

// The player's thread takes memory for what comes next between a frame and its statistics.
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
    l4d_cuda_frame_stats stats = L4D_INIT(l4d_cuda_frame_stats);
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
  l4d_playback_options playback = L4D_INIT(l4d_playback_options);
  playback.max_units = 1 << 20;  // small buckets have a chunk each
  options.playback = &playback;
  const Playing all(bytes, camera, options);
  const auto play = [&] {
    for (int k = 0; k < 160; ++k) all.render(k / 16.0);
    // What lies ahead of the last frame is still coming.
    for (int wait = 0; wait < 5000 && all.counters().gaussians_decoded < 20000; ++wait) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return all.counters();
  };
  const l4d_cuda_player_counters first = play();
  EXPECT_EQ(first.gaussians_decoded, 20000u);
  EXPECT_EQ(first.resident_gaussians, 20000u);
  const l4d_cuda_player_counters second = play();
  EXPECT_EQ(second.gaussians_decoded, 20000u);  // the second time nothing is decoded
  EXPECT_EQ(second.buckets_decoded, first.buckets_decoded);
  EXPECT_EQ(second.store_bytes, first.store_bytes);

  playback.max_units = 2000;
  const Playing little(bytes, camera, options);
  EXPECT_EQ(little.launch(1), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_STRNE(l4d_last_error_message(), "");
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
    l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
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
    EXPECT_STRNE(l4d_last_error_message(), "");
  }
  EXPECT_GT(failed, 0);
  EXPECT_LT(failed, 51);
}

// Their threads launch the same kernels with different sizes of shared memory.
TEST(PlayerFaults, NoneOfSeveralPlayersDisturbsAnother) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Bytes much = encode(long_scene(10, 20000), "default", 2048);
  const Bytes little = encode(long_scene(4, 3000), "tiny", 64);
  const l4d_camera camera = ring_camera(160, 120, 2.1);
  std::vector<std::thread> threads;
  std::array<std::string, 8> failures;
  for (size_t k = 0; k < failures.size(); ++k) {
    threads.emplace_back([&, k] {
      for (int round = 0; round < 20 && failures[k].empty(); ++round) {
        const Playing playing(k % 2 == 0 ? much : little, camera, exact_options());
        for (const double time : {0.1, 3.5, 1.7, 2.9}) {
          if (playing.launch(time) == L4D_OK) continue;
          failures[k] = std::string(l4d_last_error_message()) + ".";
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const std::string& failure : failures) EXPECT_EQ(failure, "");
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
  const auto create = [&](const l4d_cuda_player_options& options) {
    const l4d_status status = l4d_cuda_player_create(&options, &out);
    EXPECT_EQ(out, nullptr);
    return status;
  };
  l4d_cuda_player_options bad = exact_options();
  EXPECT_EQ(create(bad), L4D_ERR_INVALID_ARGUMENT) << "neither a file nor a link";
  const l4d_reader reader = reader_of(bytes);
  bad.reader = &reader;
  bad.uri = "a.l4d";
  EXPECT_EQ(create(bad), L4D_ERR_INVALID_ARGUMENT);
  bad.uri = nullptr;
  bad.automatic = 2;
  EXPECT_EQ(create(bad), L4D_ERR_INVALID_ARGUMENT);
  bad.automatic = 0;
  bad.device = 4000;
  EXPECT_EQ(create(bad), L4D_ERR_DEVICE);
  bad.device = 0;
  const Bytes garbage(1000, 7);
  const l4d_reader other = reader_of(garbage);
  bad.reader = &other;
  EXPECT_EQ(create(bad), L4D_ERR_NOT_L4D);
  EXPECT_EQ(l4d_cuda_player_set_rate(playing.get(), 1000), L4D_ERR_INVALID_ARGUMENT);
  uint32_t count = 7;
  EXPECT_EQ(l4d_cuda_player_take(playing.get(), nullptr, 1, &count), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_cuda_player_take(playing.get(), nullptr, 0, &count), L4D_OK);
  EXPECT_EQ(count, 0u);
}

}  // namespace
}  // namespace l4d::render
