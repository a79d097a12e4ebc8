// SPDX-License-Identifier: Apache-2.0
// Device code of a step of training against the host's: loss, Adam, relocation, whole steps.
#include <cmath>

#include "tests/gpu/trainable_support.h"
#include "training/cuda/adam_device.h"
#include "training/cuda/loss_device.h"
#include "training/cuda/relocate_device.h"
#include "training/step/cuda_backend.h"
#include "training/step/schedule.h"
#include "training/tests/gpu/train_support.h"

namespace l4d::train {
namespace {

using l4d::test::has_device;
using l4d::test::Random;
using render::DeviceArray;
using render::relative_distance;
using render::ring_camera;
using test::Capture;
using test::expect_models;
using test::schedule_of;
using test::start_of;
using test::trained;

std::vector<float> floats(size_t n, uint64_t seed, float low, float high) {
  Random random(seed);
  std::vector<float> out(n);
  for (float& v : out) v = random.uniformf(low, high);
  return out;
}
std::vector<uint8_t> bytes(size_t n, uint64_t seed) {
  Random random(seed);
  std::vector<uint8_t> out(n);
  for (uint8_t& v : out) v = static_cast<uint8_t>(random.uniform(0, 256));
  return out;
}

// ---- loss ----

struct LossCase {
  uint32_t width, height;
  bool masked, has_alpha, exposed;
};

struct HostLoss {
  explicit HostLoss(const LossCase& c, uint64_t seed)
      : rgb(floats(size_t{3} * c.width * c.height, seed, -0.1f, 1.2f)),
        target(bytes(rgb.size(), seed + 1)),
        alpha(bytes(rgb.size() / 3, seed + 2)),
        mask(bytes(rgb.size() / 3, seed + 3)),
        exposure{1.1037f, 0.0911f,  -0.2073f, 0.0517f, 0,       0.9131f,
                 0.1097f, -0.0203f, 0.0311f,  0,       1.1973f, 0.0113f} {
    // Parts that are alike, so that S takes all values.
    for (size_t i = 0; i < rgb.size() / 2; ++i) rgb[i] = static_cast<float>(target[i]) / 250;
    for (uint8_t& v : mask) v = v < 40 ? 0 : 1;
    view.width = c.width;
    view.height = c.height;
    view.rendered = rgb.data();
    view.target = target.data();
    view.alpha = c.has_alpha ? alpha.data() : nullptr;
    view.mask = c.masked ? mask.data() : nullptr;
    view.exposure = c.exposed ? exposure.data() : nullptr;
    view.background[0] = 0.3f;
    view.background[1] = 0.6f;
    view.background[2] = 0.1f;
    view.ssim_weight = 0.2f;
    factors.resize(loss_factors_size(view));
    gradient.assign(rgb.size(), -7.0f);
    sums = loss_forward(view, factors.data());
    loss_backward(view, factors.data(), sums, 0.25, gradient.data(), by_exposure);
  }
  std::vector<float> rgb;
  std::vector<uint8_t> target, alpha, mask;
  std::vector<float> exposure, factors, gradient;
  LossView<float> view{};
  LossSums sums;
  double by_exposure[12] = {};
};

struct DeviceLoss {
  explicit DeviceLoss(const HostLoss& h)
      : rgb(h.rgb),
        target(h.target),
        alpha(h.alpha),
        mask(h.mask),
        exposure(h.exposure),
        factors(h.factors.size(), -7.0f),
        gradient(h.rgb.size(), -7.0f),
        error(h.rgb.size() / 3, -7.0f),
        partial(loss_partial_size(h.view.width, h.view.height), -7.0),
        sums(1, DeviceLossSums{}) {
    out.view = h.view;
    out.view.rendered = rgb.get();
    out.view.target = target.get();
    out.view.alpha = h.view.alpha == nullptr ? nullptr : alpha.get();
    out.view.mask = h.view.mask == nullptr ? nullptr : mask.get();
    out.view.exposure = h.view.exposure == nullptr ? nullptr : exposure.get();
    out.factors = factors.get();
    out.partial = partial.get();
    out.sums = sums.get();
    out.rgb_gradient = gradient.get();
    out.error = error.get();
    out.weight = 0.25f;
  }
  DeviceArray<float> rgb;
  DeviceArray<uint8_t> target, alpha, mask;
  DeviceArray<float> exposure, factors, gradient, error;
  DeviceArray<double> partial;
  DeviceArray<DeviceLossSums> sums;
  DeviceLossView out{};
};

TEST(DeviceLoss, IsTheHosts) {
  L4D_SKIP_WITHOUT_DEVICE();
  const LossCase cases[] = {{131, 97, false, false, false}, {64, 64, true, false, false},
                            {40, 33, true, true, true},     {7, 5, false, true, true},
                            {320, 200, false, false, true}, {1, 1, false, false, false}};
  DeviceLossBatch batch{};
  std::vector<HostLoss> host;
  std::vector<std::unique_ptr<DeviceLoss>> device;
  for (const LossCase& c : cases) {
    host.emplace_back(c, 10 * host.size());
    device.push_back(std::make_unique<DeviceLoss>(host.back()));
    batch.views[batch.count++] = device.back()->out;
  }
  const DeviceArray<uint32_t> stop(1, 0);
  std::vector<std::vector<float>> before;
  for (int round = 0; round < 2; ++round) {
    launch_loss_forward(batch, stop.get(), nullptr);
    launch_loss_backward(batch, nullptr);
    ASSERT_EQ(cudaDeviceSynchronize(), cudaSuccess);
    for (size_t k = 0; k < host.size(); ++k) {
      const HostLoss& h = host[k];
      const DeviceLossSums d = device[k]->sums.read()[0];
      EXPECT_EQ(d.values, h.sums.values) << k;
      EXPECT_NEAR(d.absolute, h.sums.absolute, 1e-5 * h.sums.absolute) << k;
      EXPECT_NEAR(d.squared, h.sums.squared, 1e-5 * h.sums.squared) << k;
      EXPECT_NEAR(d.similarity, h.sums.similarity, 1e-5 * static_cast<double>(h.sums.values)) << k;
      const std::vector<float> gradient = device[k]->gradient.read();
      const double distance = relative_distance(gradient, h.gradient);
      std::cout << "loss " << k << ": relative distance " << distance << "\n";
      EXPECT_LT(distance, 1e-4) << k;
      for (size_t e = 0; e < 12 && h.view.exposure != nullptr; ++e) {
        EXPECT_NEAR(d.by_exposure[e], h.by_exposure[e], 1e-5) << k << " " << e;
      }
      const std::vector<float> error = device[k]->error.read();
      for (size_t i = 0; i < error.size(); ++i) {
        double expected = 0;
        const bool counted = h.view.mask == nullptr || h.mask[i] != 0;
        const double a = h.view.alpha == nullptr ? 1.0 : h.alpha[i] / 255.0;
        for (size_t c = 0; c < 3 && counted; ++c) {
          const double y =
              a * h.target[3 * i + c] / 255.0 + (1 - a) * static_cast<double>(h.view.background[c]);
          expected += std::fabs(static_cast<double>(h.rgb[3 * i + c]) - y) / 3;
        }
        ASSERT_NEAR(static_cast<double>(error[i]), expected, 1e-5);
      }
      if (round == 0) {
        before.push_back(gradient);
      } else {
        EXPECT_TRUE(render::equal_bits(before[k], gradient)) << k;
      }
    }
    EXPECT_EQ(stop.read()[0], 0u);
  }
  std::vector<float> bad = host[0].rgb;
  bad[777] = std::numeric_limits<float>::quiet_NaN();
  device[0]->rgb.write(bad);
  launch_loss_forward(batch, stop.get(), nullptr);
  EXPECT_EQ(stop.read()[0], 1u);
}

// ---- Adam ----

// Arrays of a model on the host or, by upload(), on the device.
struct AdamCase {
  AdamCase(uint64_t rows, uint32_t degree, uint64_t seed) : count(rows) {
    const size_t n = static_cast<size_t>(rows), sh = size_t{3} * (degree + 1) * (degree + 1);
    const size_t widths[6] = {3, 1, 4, 8, 1, sh};
    for (size_t g = 0; g < 4; ++g) {
      for (size_t k = 0; k < 6; ++k) {
        const float low = g == 2 ? 1e-6f : -1;
        arrays[g][k] = floats(n * widths[k], seed + 10 * g + k, low, g == 2 ? 1e-3f : 1);
      }
    }
    for (float& v : arrays[0][2]) v = v * 2 - 2;
    for (float& v : arrays[0][4]) v = v * 4 - 3;  // some faint
    Random random(seed + 99);
    for (size_t i = 0; i < n; ++i) {
      shown.push_back(random.uniform(0, 1) < 0.6 ? 1 : 0);
      updates.push_back(static_cast<uint32_t>(random.uniform(0, 30)));
      prepared.push_back(40 - static_cast<uint32_t>(random.uniform(0, 10)));
      born.push_back(0);
      id.push_back(static_cast<uint32_t>(3 * i + 1));
    }
  }
  static Rows<float> rows_of(std::vector<float>* a) {
    return {a[0].data(), a[1].data(), a[2].data(), a[3].data(), a[4].data(), a[5].data()};
  }
  AdamArrays host() {
    return {rows_of(arrays[0]), rows_of(arrays[1]), rows_of(arrays[2]),
            rows_of(arrays[3]), shown.data(),       updates.data(),
            prepared.data(),    born.data(),        id.data()};
  }
  uint64_t count;
  std::vector<float> arrays[4][6];  // value, m, v, gradient
  std::vector<uint8_t> shown;
  std::vector<uint32_t> updates, prepared, born, id;
};

struct DeviceAdam {
  explicit DeviceAdam(const AdamCase& c)
      : shown(c.shown), updates(c.updates), prepared(c.prepared), born(c.born), id(c.id) {
    for (size_t g = 0; g < 4; ++g) {
      for (const auto& from : c.arrays[g]) {
        arrays[g].push_back(std::make_unique<DeviceArray<float>>(from));
      }
    }
  }
  Rows<float> rows(size_t g) const {
    const auto& a = arrays[g];
    return {a[0]->get(), a[1]->get(), a[2]->get(), a[3]->get(), a[4]->get(), a[5]->get()};
  }
  AdamArrays device() const {
    return {rows(0),       rows(1),        rows(2),    rows(3), shown.get(),
            updates.get(), prepared.get(), born.get(), id.get()};
  }
  std::vector<std::unique_ptr<DeviceArray<float>>> arrays[4];
  DeviceArray<uint8_t> shown;
  DeviceArray<uint32_t> updates, prepared, born, id;
};

AdamStep adam_step(uint64_t count, uint32_t degree, uint32_t active, bool sparse) {
  AdamStep s;
  s.seed = 5;
  s.step = 41;
  s.count = count;
  s.sh_degree = degree;
  s.active_sh_degree = active;
  s.sparse = sparse;
  s.rates = {1e-3f, 1e-3f, 1e-2f, 5e-3f, 1e-3f, 1e-3f, 1e-4f, 5e-2f, 2.5e-3f, 1e-4f};
  s.opacity_weight = 0.005f;
  s.scale_weight = 0.01f;
  s.noise = 100;
  s.duration = 4;
  s.min_log_sigma = -5;
  s.max_log_scale = 0.9f;
  return s;
}

TEST(DeviceAdam, IsTheHosts) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (const uint32_t degree : {0u, 1u, 2u, 3u}) {
    for (const bool sparse : {false, true}) {
      const uint32_t active = degree == 3 ? 2 : degree;
      AdamCase host(1000 + 7 * degree, degree, degree);
      host.arrays[3][0][3 * 17] = std::numeric_limits<float>::infinity();
      host.arrays[3][5][host.arrays[3][5].size() / 2] = std::numeric_limits<float>::quiet_NaN();
      DeviceAdam device(host);
      const DeviceArray<uint32_t> go(1, 0), stop(1, 1);
      const DeviceArray<unsigned long long> skipped(1, 0);
      const DeviceArray<ShUpdate> updates(host.count, ShUpdate{});
      AdamStep s = adam_step(host.count, degree, active, sparse);
      // A flag that says stop leaves all as it is.
      launch_adam(s, device.device(), updates.get(), stop.get(), skipped.get(), nullptr);
      EXPECT_TRUE(render::equal_bits(device.arrays[0][5]->read(), host.arrays[0][5]));
      uint64_t skips = 0;
      for (int round = 0; round < 3; ++round, ++s.step) {
        if (sparse) {
          catch_up_rows(s, host.host(), 1.0, 0, host.count);
          launch_catch_up(s, device.device(), 1.0, nullptr);
        }
        skips += adam_rows(s, host.host(), 0, host.count);
        launch_adam(s, device.device(), updates.get(), go.get(), skipped.get(), nullptr);
        for (size_t k = 0; k < 6; ++k) {
          const std::vector<float> next =
              floats(host.arrays[3][k].size(), 1000 + 10 * s.step + k, -1, 1);
          if (round == 2) continue;
          for (size_t i = 0; i < next.size(); ++i) {
            const size_t row = i / (next.size() / static_cast<size_t>(host.count));
            host.arrays[3][k][i] = sparse && host.shown[row] == 0 ? 0 : next[i];
          }
          device.arrays[3][k]->write(host.arrays[3][k]);
        }
      }
      EXPECT_EQ(skipped.read()[0], skips);
      EXPECT_GE(skips, sparse ? 0u : 2u);
      EXPECT_EQ(device.updates.read(), host.updates);
      EXPECT_EQ(device.prepared.read(), host.prepared);
      for (size_t g = 0; g < 4; ++g) {
        for (size_t k = 0; k < 6; ++k) {
          const double distance = relative_distance(device.arrays[g][k]->read(), host.arrays[g][k]);
          EXPECT_LT(distance, g == 3 ? 1e-30 : 2e-5)
              << "degree " << degree << ", sparse " << sparse << ", array " << g << " " << k;
        }
      }
    }
  }
}

// ---- relocation ----

TEST(DeviceRelocation, IsTheHosts) {
  L4D_SKIP_WITHOUT_DEVICE();
  constexpr uint64_t kCount = 5000, kCapacity = 6000;
  AdamCase host(kCapacity, 1, 3);
  std::vector<uint32_t> last_shown(kCapacity, 30);
  std::vector<float> coverage = floats(kCapacity, 1, 0, 2), error = floats(kCapacity, 2, 0, 1);
  for (size_t i = 0; i < kCapacity; ++i) {
    host.id[i] = static_cast<uint32_t>(i % 3 == 0 ? 41 + 100 * i : i);
    host.born[i] = static_cast<uint32_t>(i % 40);
    if (i % 11 == 0) host.arrays[0][4][i] = -8;
    if (i % 13 == 0) last_shown[i] = 3;
    if (i % 101 == 0) host.arrays[0][0][3 * i] = std::numeric_limits<float>::quiet_NaN();
  }
  DeviceAdam device(host);
  const DeviceArray<uint32_t> device_last(last_shown), copies(kCapacity, 0);
  const DeviceArray<float> device_coverage(coverage), device_error(error);
  const DeviceArray<double> device_sums(kCapacity, 0), partial(weight_partial_size(kCapacity), 0);
  const DeviceArray<uint64_t> children(2 * kCapacity, 0);
  const DeviceArray<DeviceDensityChange> change(1, DeviceDensityChange{});

  std::vector<double> cumulative;
  const auto as_const = [](const Rows<float>& r) {
    return Rows<const float>{r.position, r.mean_t, r.log_scale, r.rotor, r.opacity, r.sh};
  };
  accumulate_weights(as_const(host.host().value), coverage.data(), error.data(), kCount, 1,
                     &cumulative);
  launch_accumulate_weights(as_const(device.rows(0)), device_coverage.get(), device_error.get(),
                            kCount, 1, partial.get(), device_sums.get(), nullptr);
  const std::vector<double> found = device_sums.read();
  for (size_t i = 0; i < kCount; ++i) {
    ASSERT_NEAR(found[i], cumulative[i], 1e-9 * cumulative.back());
  }
  // The same sums for both, so that no draw falls on the other side of a border.
  cumulative.resize(kCapacity);
  device_sums.write(cumulative);

  DensityStep s;
  s.seed = 9;
  s.step = 41;
  s.turn = 41;
  s.count = kCount;
  s.births = 700;
  s.sh_degree = 1;
  s.next_id = 1000000;
  s.time_end = 4;
  s.unseen_since = 20;
  const auto arrays_of = [](const AdamArrays& a, uint32_t* last, float* c, float* e,
                            const double* sums) {
    DensityArrays out;
    out.value = a.value;
    out.m = a.m;
    out.v = a.v;
    out.updates = a.updates;
    out.prepared = a.prepared;
    out.born = a.born;
    out.id = const_cast<uint32_t*>(a.id);
    out.last_shown = last;
    out.coverage = c;
    out.error = e;
    out.cumulative = sums;
    out.sampled = kCount;
    return out;
  };
  const DensityChange expected = change_density(
      s,
      arrays_of(host.host(), last_shown.data(), coverage.data(), error.data(), cumulative.data()));
  const RelocationMemory memory{children.get(), copies.get(), partial.get()};
  launch_change_density(s,
                        arrays_of(device.device(), device_last.get(), device_coverage.get(),
                                  device_error.get(), device_sums.get()),
                        memory, change.get(), nullptr);
  EXPECT_EQ(change.read()[0].relocated, expected.relocated);
  EXPECT_EQ(change.read()[0].born, expected.born);
  EXPECT_GT(expected.relocated, 50u);
  EXPECT_GT(expected.born, 600u);
  const uint64_t rows = kCount + expected.born;
  EXPECT_EQ(device.id.read(), host.id);
  EXPECT_EQ(device.updates.read(), host.updates);
  EXPECT_EQ(device.born.read(), host.born);
  EXPECT_EQ(device_last.read(), last_shown);
  for (const uint32_t v : copies.read()) ASSERT_EQ(v, 0u);
  for (size_t g = 0; g < 3; ++g) {
    for (size_t k = 0; k < 6; ++k) {
      const std::vector<float> d = device.arrays[g][k]->read();
      const size_t width = d.size() / kCapacity;
      for (size_t i = 0; i < rows * width; ++i) {
        const float e = host.arrays[g][k][i];
        if (std::isnan(e) && std::isnan(d[i])) continue;
        ASSERT_NEAR(d[i], e, 1e-4f * (1 + std::fabs(e))) << g << " " << k << " " << i;
      }
    }
  }
}

// ---- whole steps ----

TEST(DeviceTraining, AStepIsTheHosts) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(6);
  for (const uint32_t degree : {0u, 1u, 2u, 3u}) {
    const auto cpu = make_cpu_backend(2), cuda = make_cuda_backend(0);
    const ScheduleOptions options = schedule_of(capture, degree);
    for (Backend* b : {cpu.get(), cuda.get()}) {
      b->load(start_of(capture.truth, 3500, degree), capture.truth.timeline);
    }
    StepInput input = capture.input(3, options, false);
    input.measure_cameras = true;
    const StepOutput e = cpu->step(input), d = cuda->step(input);
    EXPECT_TRUE(d.finite);
    for (size_t v = 0; v < e.views.size(); ++v) {
      EXPECT_NEAR(d.views[v].loss(0.2), e.views[v].loss(0.2), 1e-5);
      for (size_t k = 0; k < e.view_gradients[v].size(); ++k) {
        const double expected = e.view_gradients[v][k];
        EXPECT_NE(expected, 0);
        EXPECT_NEAR(d.view_gradients[v][k], expected, 1e-2 * std::abs(expected) + 1e-6) << k;
      }
    }
    // Adam turns a derivative into a step of fixed length: where one is next to nothing, its sign
    // is rounding. Steps are short, so values stay close.
    expect_models(cuda->save(), cpu->save(), 1e-3, "degree " + std::to_string(degree));
    const ModelState ds = cuda->save(), es = cpu->save();
    // The host's measure misses what Gaussians cover whose colour is clamped at 0.
    EXPECT_LT(relative_distance(ds.coverage, es.coverage), 5e-2);
    EXPECT_LT(relative_distance(ds.error, es.error), 5e-2);
  }
}

// What the gradient rule of density reads. The host's is an estimate from derivatives by positions
// in the world, so that sums are alike and rows are not.
TEST(DeviceTraining, SumsScreenGradients) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(6);
  const auto cpu = make_cpu_backend(2), cuda = make_cuda_backend(0);
  StepInput input = capture.input(3, schedule_of(capture, 1), false);
  input.measure_gradients = true;
  double sums[2] = {0, 0}, views[2] = {0, 0};
  Backend* const backends[2] = {cpu.get(), cuda.get()};
  for (size_t k = 0; k < 2; ++k) {
    backends[k]->load(start_of(capture.truth, 3600, 1), capture.truth.timeline);
    backends[k]->step(input);
    const ModelState state = backends[k]->save();
    for (size_t i = 0; i < state.count; ++i) {
      sums[k] += static_cast<double>(state.screen_gradient[i]);
      views[k] += state.screen_views[i];
    }
    GradientStep density;
    density.budget = state.count + 50;
    density.views = static_cast<uint32_t>(input.views.size());
    density.split_above = 0.06;
    density.time_end = io::duration(capture.truth.timeline);
    const DensityChange change = backends[k]->change_density(density);
    EXPECT_EQ(backends[k]->count(), state.count - change.relocated + change.born);
    EXPECT_TRUE(backends[k]->step(input).finite);
  }
  std::cout << "screen gradients: host " << sums[0] << ", device " << sums[1] << "\n";
  EXPECT_GT(views[0], 0);
  EXPECT_NEAR(views[1], views[0], 0.05 * views[0]);
  EXPECT_GT(3 * sums[1], sums[0]);
  EXPECT_LT(sums[1], 3 * sums[0]);
}

TEST(DeviceTraining, TrainsAsTheHostDoesAndRepeats) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(6);
  const auto cpu = make_cpu_backend(0), cuda = make_cuda_backend(0);
  for (const bool sparse : {false, true}) {
    double host = 0, device = 0, again = 0;
    trained(cpu.get(), capture, sparse, false, 300, &host);
    trained(cuda.get(), capture, sparse, false, 300, &device);
    std::cout << "sparse " << sparse << ": host " << host << " dB, device " << device << " dB\n";
    EXPECT_NEAR(device, host, 0.2);
    const ModelState first = trained(cuda.get(), capture, sparse, true, 300, &device);
    const ModelState second = trained(cuda.get(), capture, sparse, true, 300, &again);
    EXPECT_GT(first.count, capture.truth.count());
    EXPECT_EQ(device, again);
    EXPECT_EQ(first.count, second.count);
    EXPECT_TRUE(render::equal_bits(first.value.position, second.value.position));
    EXPECT_TRUE(render::equal_bits(first.value.sh, second.value.sh));
    EXPECT_TRUE(render::equal_bits(first.m.rotor, second.m.rotor));
    EXPECT_TRUE(render::equal_bits(first.coverage, second.coverage));
    // Saved and loaded, it goes on as if nothing had been.
    const StepInput next = capture.input(301, schedule_of(capture, 1), sparse);
    cuda->step(next);
    const ModelState on = cuda->save();
    cuda->load(second, capture.truth.timeline);
    cuda->step(next);
    EXPECT_TRUE(render::equal_bits(on.value.position, cuda->save().value.position));
    // Half of the rows.
    std::vector<uint8_t> mask(static_cast<size_t>(cuda->count()), 0);
    for (size_t i = 0; i < mask.size(); i += 2) mask[i] = 1;
    const uint64_t left = (cuda->count() + 1) / 2;
    cuda->keep(mask);
    EXPECT_EQ(cuda->count(), left);
    EXPECT_TRUE(cuda->step(next).finite);
  }
}

// Targets that leave give their memory to those that come.
TEST(DeviceTraining, IsTheSameWithMemoryForFewTargets) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(6);
  const auto roomy = make_cuda_backend(0), narrow = make_cuda_backend(0);
  narrow->limit_memory(1);
  double expected = 0, found = 0;
  const ModelState all = trained(roomy.get(), capture, true, true, 100, &expected);
  const ModelState few = trained(narrow.get(), capture, true, true, 100, &found);
  EXPECT_EQ(roomy->memory().targets, 12U * 3 * 96 * 64);
  EXPECT_EQ(narrow->memory().targets, 3U * 3 * 96 * 64) << "those of the last step";
  EXPECT_EQ(found, expected);
  EXPECT_TRUE(render::equal_bits(few.value.position, all.value.position));
  EXPECT_TRUE(render::equal_bits(few.m.sh, all.m.sh));
}

TEST(DeviceTraining, LeavesTheModelAloneWhereALossIsNotFinite) {
  L4D_SKIP_WITHOUT_DEVICE();
  const Capture capture(3);
  const auto cuda = make_cuda_backend(0);
  ModelState state = start_of(capture.truth, 3000, 1);
  cuda->load(state, capture.truth.timeline);
  StepInput input = capture.input(1, schedule_of(capture, 1), false);
  const double exposure[12] = {std::numeric_limits<double>::quiet_NaN()};
  input.views[1].exposure = exposure;
  const StepOutput output = cuda->step(input);
  EXPECT_FALSE(output.finite);
  const ModelState after = cuda->save();
  EXPECT_TRUE(render::equal_bits(after.value.position, state.value.position));
  EXPECT_TRUE(render::equal_bits(after.m.sh, state.m.sh));
  input.views[1].exposure = nullptr;
  EXPECT_TRUE(cuda->step(input).finite);
}

}  // namespace
}  // namespace l4d::train
