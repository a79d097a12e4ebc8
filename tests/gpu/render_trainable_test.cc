// SPDX-License-Identifier: Apache-2.0
// Scenes that change from step to step: pictures, gradients and statistics against those of the
// CPU renderer, and against the device's renderer of scenes that stay.
#include "tests/gpu/trainable_support.h"

namespace l4d::render {
namespace {

constexpr const char* kArrays[6] = {"position", "mean_t", "log_scale", "rotor", "opacity", "sh"};
constexpr float kFiller = std::numeric_limits<float>::quiet_NaN();

std::vector<float> random_numbers(size_t count, uint64_t seed, float low, float high) {
  test::Random random(seed);
  std::vector<float> out(count);
  for (float& v : out) v = random.uniformf(low, high);
  return out;
}

// What the reference says of a view.
struct Expected {
  std::vector<float> image;
  std::vector<std::vector<float>> gradients;  // added to
  std::vector<float> coverage, error_coverage;
};

class Reference {
 public:
  explicit Reference(const io::Scene& scene)
      : scene_(scene), gaussians_(scene_.view()), renderer_(make_renderer(L4D_BACKEND_REFERENCE)) {
    renderer_.set_gaussians(gaussians_, scene_.timeline);
    const float background[3] = {0.2f, 0.1f, 0.4f};
    renderer_.check(l4d_renderer_set_background(renderer_.get(), background));
    const size_t n = scene.count(), widths[6] = {3, 1, 4, 8, 1, 3 * scene.sh_coefficients()};
    for (const size_t width : widths) sums.gradients.emplace_back(n * width, 0.0f);
    sums.coverage.assign(n, 0);
    sums.error_coverage.assign(n, 0);
  }
  std::vector<float> render(const l4d_camera& camera, double time) {
    renderer_.set_time(time);
    return renderer_.render(camera);
  }
  void add(const l4d_camera& camera, double time, const std::vector<float>& upstream,
           const std::vector<float>& error) {
    renderer_.set_time(time);
    auto& a = sums.gradients;
    back(camera, upstream, a[0].data(), a[1].data(), a[2].data(), a[3].data(), a[4].data(),
         a[5].data());
    // The derivative by a channel's base colour of a weighted sum of pixels is the weighted
    // coverage times the SH basis; no colour is clamped in these scenes.
    const size_t pixels = error.size(), width = 3 * scene_.sh_coefficients();
    std::vector<float> weights(3 * pixels, 0.0f), by_sh(scene_.count() * width, 0.0f);
    for (size_t p = 0; p < pixels; ++p) {
      weights[3 * p] = 1;
      weights[3 * p + 1] = error[p];
    }
    back(camera, weights, nullptr, nullptr, nullptr, nullptr, nullptr, by_sh.data());
    for (size_t i = 0; i < scene_.count(); ++i) {
      sums.coverage[i] += by_sh[width * i] / 0.28209479f;
      sums.error_coverage[i] += by_sh[width * i + 1] / 0.28209479f;
    }
  }
  Expected sums;

 private:
  void back(const l4d_camera& camera, const std::vector<float>& upstream, float* position,
            float* mean_t, float* log_scale, float* rotor, float* opacity, float* sh) {
    l4d_gradients g = L4D_INIT(l4d_gradients);
    g.count = scene_.count();
    g.position = position;
    g.mean_t = mean_t;
    g.log_scale = log_scale;
    g.rotor = rotor;
    g.opacity = opacity;
    g.sh = sh;
    renderer_.check(l4d_renderer_backward(renderer_.get(), &camera, upstream.data(), &g));
  }
  io::Scene scene_;
  l4d_gaussians gaussians_;
  RendererHandle renderer_;
};

// Colours well above 0.
io::Scene bright(io::Scene scene) {
  const size_t width = 3 * scene.sh_coefficients();
  for (size_t i = 0; i < scene.count(); ++i) {
    for (size_t k = 0; k < width; ++k) scene.sh[width * i + k] *= k < 3 ? 1.0f : 0.1f;
    for (size_t k = 0; k < 3; ++k) scene.sh[width * i + k] = std::fabs(scene.sh[width * i + k]);
  }
  return scene;
}

void expect_close(const std::vector<float>& device, const std::vector<float>& expected, double most,
                  const std::string& what) {
  double size = 0;
  for (const float v : expected) size = std::max(size, std::fabs(static_cast<double>(v)));
  EXPECT_GT(size, 0) << what;
  const double distance = relative_distance(device, expected);
  std::cout << what << ": relative distance " << distance << "\n";
  EXPECT_LT(distance, most) << what;
}

void compare(const io::Scene& scene, size_t capacity, uint32_t sh_stride, const std::string& name) {
  const size_t n = scene.count();
  const std::vector<l4d_camera> cameras = {ring_camera(131, 97, 0.8), ring_camera(131, 97, 2.9),
                                           ring_camera(120, 90, 4.1), ring_camera(131, 97, 5.5)};
  const std::vector<double> times = {1.1, 1.1, 1.1, 2.3};
  const TrainableArrays arrays(scene, capacity, sh_stride, kFiller);
  const DeviceArray<uint32_t> count(1, static_cast<uint32_t>(n));
  const TrainableHandle trainable = make_trainable();
  const l4d_gaussians g = arrays.view(scene);
  l4d_cuda_trainable_rows rows = L4D_INIT(l4d_cuda_trainable_rows);
  rows.count = count.get();
  rows.sh_stride = sh_stride;
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, &rows));
  reserve(trainable, cameras[0], capacity, 1 << 18, 4);
  check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
  TrainableViews views(cameras, times);
  views.forward(trainable);

  Reference reference(scene);
  for (size_t v = 0; v < 4; ++v) {
    const ImageDifference d =
        difference_of(views.rgb[v]->read(), reference.render(cameras[v], times[v]), 1.0 / 255);
    EXPECT_LE(d.beyond, 2u) << name << ", view " << v;
    const size_t pixels = size_t{cameras[v].width} * cameras[v].height;
    const std::vector<float> upstream = random_numbers(3 * pixels, 5 + v, -1, 2);
    const std::vector<float> error = random_numbers(pixels, 15 + v, 0, 1);
    views.upstream[v]->write(upstream);
    views.error[v]->write(error);
    reference.add(cameras[v], times[v], upstream, error);
  }
  const TrainableArrays sums(io::Scene{}, capacity, sh_stride, 0.0f);
  const DeviceArray<uint8_t> shown(capacity, 0);
  const DeviceArray<uint32_t> seen(capacity, 0);
  const DeviceArray<float> coverage(capacity, 0), error_coverage(capacity, 0), screen(capacity, 0);
  l4d_cuda_trainable_statistics statistics = L4D_INIT(l4d_cuda_trainable_statistics);
  statistics.shown = shown.get();
  statistics.views = seen.get();
  statistics.coverage = coverage.get();
  statistics.error_coverage = error_coverage.get();
  statistics.screen_gradient = screen.get();
  views.backward(trainable, sums.gradients(), &statistics);
  const auto found = sums.read(n, 3 * scene.sh_coefficients());
  for (size_t k = 0; k < 6; ++k) {
    expect_close(found[k], reference.sums.gradients[k], 2e-3, name + ", " + kArrays[k]);
  }
  const auto first_rows = [&](const DeviceArray<float>& a) { return gather(a.read(), 1, 1, n); };
  expect_close(first_rows(coverage), reference.sums.coverage, 1e-3, name + ", coverage");
  expect_close(first_rows(error_coverage), reference.sums.error_coverage, 1e-3,
               name + ", error coverage");
  const std::vector<uint8_t> flags = shown.read();
  const std::vector<uint32_t> number = seen.read();
  const std::vector<float> covers = coverage.read(), pulls = screen.read();
  size_t unlike = 0;
  for (size_t i = 0; i < capacity; ++i) {
    EXPECT_EQ(flags[i] != 0, covers[i] > 0);
    EXPECT_EQ(flags[i] != 0, number[i] > 0);
    EXPECT_LE(number[i], 4u);
    EXPECT_TRUE(pulls[i] >= 0 && (flags[i] != 0 || pulls[i] == 0)) << pulls[i];
    if (i < n) unlike += (flags[i] != 0) != (reference.sums.coverage[i] > 0);
    if (i >= n) {
      EXPECT_EQ(flags[i], 0u);
    }
  }
  EXPECT_LE(unlike, n / 500);
  const l4d_cuda_trainable_report report = report_of(trainable);
  EXPECT_EQ(report.views, 4u);
  EXPECT_EQ(report.skipped, 0u);
  EXPECT_EQ(report.rows, n);
  EXPECT_GT(report.instances, 0u);
  EXPECT_LE(report.instances, report.required_instances);
}

TEST(TrainableScene, PicturesGradientsAndStatisticsAreTheReferences) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (const uint32_t degree : {0u, 1u, 2u, 3u}) {
    const uint32_t tight = (3 * (degree + 1) * (degree + 1) + 3) / 4 * 4;
    for (const uint32_t stride : {tight, 48u}) {
      if (stride == 48 && degree == 2) continue;
      compare(bright(with_degree(synth(5000, 2), degree)), 5000 + 777 * degree, stride,
              "degree " + std::to_string(degree) + ", stride " + std::to_string(stride));
    }
  }
}

TEST(TrainableScene, LogitsAndMeanTimes) {
  L4D_SKIP_WITHOUT_DEVICE();
  io::Scene scene = bright(synth(4000, 5));
  io::opacity_to_logit(scene);
  io::positions_to_mean_time(scene);
  compare(scene, 4100, 48, "logits and mean times");
}

TEST(TrainableScene, FlatWindows) {
  L4D_SKIP_WITHOUT_DEVICE();
  compare(bright(with_windows(synth(12000, 6))), 12500, 48, "windows");
}

// The screen gradient is the derivative by a shift of the whole image. Of one Gaussian: that of
// moving it across the view.
TEST(TrainableScene, ScreenGradientIsTheShiftOfTheImage) {
  L4D_SKIP_WITHOUT_DEVICE();
  SceneBuilder builder;
  const double rgb[3] = {0.9, 0.4, 0.7};
  builder.add_ball(0.1, -0.05, 4, 0.15, 0.8, rgb);
  const io::Scene scene = builder.scene();
  const l4d_camera camera = axis_camera(96, 64, 80);
  TrainableViews views({camera}, {1.0});
  const std::vector<float> upstream = random_numbers(3 * 96 * 64, 3, -1, 1);
  views.upstream[0]->write(upstream);
  const TrainableArrays arrays(scene, 1, 4, 0), sums(io::Scene{}, 1, 4, 0);
  const TrainableHandle trainable = make_trainable();
  const l4d_gaussians g = arrays.view(scene);
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, nullptr));
  reserve(trainable, camera, 1, 1000, 1);
  const DeviceArray<float> screen(1, 0.0f);
  l4d_cuda_trainable_statistics statistics = L4D_INIT(l4d_cuda_trainable_statistics);
  statistics.screen_gradient = screen.get();
  check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
  views.forward(trainable);
  views.backward(trainable, sums.gradients(), &statistics);
  // dx/dX = fx / z of the position, where the covariance's change is next to nothing.
  const auto by = sums.read(1, 3)[0];
  const double pixel = 80.0 / 4;
  const double expected =
      std::hypot(48 * static_cast<double>(by[0]) / pixel, 32 * static_cast<double>(by[1]) / pixel);
  EXPECT_NEAR(static_cast<double>(screen.read()[0]), expected, 0.03 * expected);
}

// A refresh shows what the arrays and the count hold then, and only then.
TEST(TrainableScene, FollowsItsArrays) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(3000, 7), other = synth(3000, 8);
  const l4d_camera camera = ring_camera(120, 90, 1.0);
  const TrainableArrays arrays(scene, 3000, 48, 0);
  const DeviceArray<uint32_t> count(1, 3000u);
  const TrainableHandle trainable = make_trainable();
  const l4d_gaussians g = arrays.view(scene);
  l4d_cuda_trainable_rows rows = L4D_INIT(l4d_cuda_trainable_rows);
  rows.count = count.get();
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, &rows));
  const TrainableViews views({camera}, {1.0});
  EXPECT_EQ(l4d_cuda_trainable_forward(trainable.get(), views.views.data(), 1, nullptr),
            L4D_ERR_INVALID_STATE);
  check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
  EXPECT_EQ(l4d_cuda_trainable_forward(trainable.get(), views.views.data(), 1, nullptr),
            L4D_ERR_INVALID_STATE);
  reserve(trainable, camera, 3000, 1 << 18, 1);
  const auto picture = [&] {
    views.forward(trainable);
    return views.rgb[0]->read();
  };
  Reference first(scene), second(other);
  EXPECT_LE(difference_of(picture(), first.render(camera, 1), 1.0 / 255).beyond, 2u);
  arrays.position.write(other.position);
  arrays.mean_t.write(other.mean_t);
  arrays.log_scale.write(other.log_scale);
  arrays.rotor.write(other.rotor);
  arrays.opacity.write(other.opacity);
  arrays.sh.write(spread(other.sh, 48, 48, 3000, 0));
  check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
  EXPECT_LE(difference_of(picture(), second.render(camera, 1), 1.0 / 255).beyond, 2u);
  // Fewer rows; and as many as the capacity has where the count is beyond it.
  count.write({1000u});
  check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
  io::Scene part = other;
  part.resize(1000);
  Reference third(part);
  EXPECT_LE(difference_of(picture(), third.render(camera, 1), 1.0 / 255).beyond, 2u);
  EXPECT_EQ(report_of(trainable).rows, 1000u);
  count.write({99999u});
  check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
  EXPECT_LE(difference_of(picture(), second.render(camera, 1), 1.0 / 255).beyond, 2u);
  // SH of a lower degree, in place.
  check(l4d_cuda_trainable_set_sh_degree(trainable.get(), 1));
  Reference fourth(with_degree(other, 1));
  EXPECT_LE(difference_of(picture(), fourth.render(camera, 1), 1.0 / 255).beyond, 2u);
  EXPECT_EQ(l4d_cuda_trainable_set_sh_degree(trainable.get(), 4), L4D_ERR_INVALID_ARGUMENT);
}

// The same bits as the device's renderer has for scenes that stay, but for still rows; and in each
// run, however many views share the device.
TEST(TrainableScene, RepeatsBitForBitAndAgreesWithTheDeviceRenderer) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(30000, 4);
  std::vector<l4d_camera> cameras;
  for (int v = 0; v < 6; ++v) cameras.push_back(ring_camera(320, 240, v));
  const std::vector<double> times = {1, 1, 1, 1, 1, 1};
  const TrainableArrays arrays(scene, scene.count(), 48, 0);
  const TrainableHandle trainable = make_trainable();
  const l4d_gaussians g = arrays.view(scene);
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, nullptr));
  reserve(trainable, cameras[0], scene.count(), 1 << 20, 6);
  TrainableViews together(cameras, times);
  const size_t pixels = size_t{320} * 240;
  std::vector<std::vector<float>> upstream;
  for (size_t v = 0; v < 6; ++v) {
    upstream.push_back(random_numbers(3 * pixels, v, -1, 2));
    together.upstream[v]->write(upstream[v]);
  }
  std::vector<std::vector<std::vector<float>>> rounds;
  for (int round = 0; round < 3; ++round) {
    const TrainableArrays sums(io::Scene{}, scene.count(), 48, 0);
    check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
    if (round < 2) {
      together.forward(trainable);
      together.backward(trainable, sums.gradients(), nullptr);
    } else {  // one by one
      for (size_t v = 0; v < 6; ++v) {
        TrainableViews one({cameras[v]}, {1.0});
        one.upstream[0]->write(upstream[v]);
        one.forward(trainable);
        EXPECT_TRUE(equal_bits(one.rgb[0]->read(), together.rgb[v]->read()));
        one.backward(trainable, sums.gradients(), nullptr);
        // `together` added its own twice.
        std::vector<double> by_view = one.view_gradient[0]->read();
        for (double& number : by_view) number *= 2;
        EXPECT_EQ(together.view_gradient[v]->read(), by_view);
      }
    }
    rounds.push_back(sums.read(scene.count(), 48));
  }
  for (size_t k = 0; k < 6; ++k) {
    EXPECT_TRUE(equal_bits(rounds[0][k], rounds[1][k])) << kArrays[k];
    EXPECT_TRUE(equal_bits(rounds[0][k], rounds[2][k])) << kArrays[k];
  }
  RendererHandle device = make_device();
  device.set_gaussians(scene.view(), scene.timeline);
  device.set_time(1.0);
  const float background[3] = {0.2f, 0.1f, 0.4f};
  device.check(l4d_renderer_set_background(device.get(), background));
  const size_t n = scene.count(), widths[6] = {3, 1, 4, 8, 1, 48};
  std::vector<std::vector<float>> old;
  for (const size_t width : widths) old.emplace_back(n * width, 0.0f);
  l4d_gradients out = L4D_INIT(l4d_gradients);
  out.count = n;
  out.position = old[0].data();
  out.mean_t = old[1].data();
  out.log_scale = old[2].data();
  out.rotor = old[3].data();
  out.opacity = old[4].data();
  out.sh = old[5].data();
  for (size_t v = 0; v < 6; ++v) {
    const ImageDifference d =
        difference_of(together.rgb[v]->read(), device.render(cameras[v]), 1e-4);
    EXPECT_LE(d.beyond, 2u);
    std::vector<double> by_view(9, 0.0);
    out.view = by_view.data();
    device.check(l4d_renderer_backward(device.get(), &cameras[v], upstream[v].data(), &out));
    const std::vector<double> twice = together.view_gradient[v]->read();
    for (size_t k = 0; k < 9; ++k) {
      EXPECT_NEAR(twice[k] / 2, by_view[k], 1e-3 * std::abs(by_view[k])) << k;
    }
  }
  for (size_t k = 0; k < 6; ++k) {
    expect_close(rounds[0][k], old[k], 1e-3, std::string("device renderer, ") + kArrays[k]);
  }
}

// A view without room adds nothing and is counted; the flag stays until a scene is set.
TEST(TrainableScene, CountsViewsWithoutRoom) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(9000, 8);
  const l4d_camera camera = ring_camera(200, 150, 2.0),
                   away = call_on(200, 150, 180, std::vector<double>{40, 0, 0}.data(),
                                  std::vector<double>{80, 0, 0}.data());
  const TrainableArrays arrays(scene, 9000, 48, 0), sums(io::Scene{}, 9000, 48, 0);
  const TrainableHandle trainable = make_trainable();
  const l4d_gaussians g = arrays.view(scene);
  const DeviceArray<uint32_t> overflow(1, 0);
  l4d_cuda_trainable_rows rows = L4D_INIT(l4d_cuda_trainable_rows);
  rows.overflow = overflow.get();
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, &rows));
  reserve(trainable, camera, 9000, 5000, 2);
  TrainableViews views({camera, away}, {1.0, 1.0});
  views.upstream[0]->write(random_numbers(3 * 200 * 150, 1, 0, 1));
  const DeviceArray<uint8_t> shown(9000, 0);
  l4d_cuda_trainable_statistics statistics = L4D_INIT(l4d_cuda_trainable_statistics);
  statistics.shown = shown.get();
  const auto step = [&] {
    check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
    views.forward(trainable);
    views.backward(trainable, sums.gradients(), &statistics);
  };
  l4d_cuda_trainable_report report = L4D_INIT(l4d_cuda_trainable_report);
  EXPECT_EQ(l4d_cuda_trainable_get_report(trainable.get(), 0, &report), L4D_ERR_INVALID_STATE);
  step();
  report = report_of(trainable);
  EXPECT_EQ(report.views, 2u);
  EXPECT_EQ(report.skipped, 1u);
  EXPECT_GT(report.required_instances, 5000u);
  EXPECT_EQ(report.instances, 5000u);
  EXPECT_EQ(overflow.read()[0], 1u);
  overflow.write({0});
  for (const auto& array : sums.read(9000, 48)) {
    for (const float v : array) ASSERT_EQ(v, 0);
  }
  for (const uint8_t v : shown.read()) ASSERT_EQ(v, 0);
  for (const double v : views.view_gradient[0]->read()) ASSERT_EQ(v, 0);
  reserve(trainable, camera, 9000, report.required_instances, 2);
  step();
  report = report_of(trainable);
  EXPECT_EQ(report.views, 4u);
  EXPECT_EQ(report.skipped, 1u);
  EXPECT_EQ(overflow.read()[0], 0u);
  const std::vector<float> by_position = sums.read(9000, 48)[0];
  EXPECT_GT(*std::max_element(by_position.begin(), by_position.end()), 0);
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, nullptr));
  EXPECT_EQ(report_of(trainable).skipped, 0u);
}

// A step is a CUDA graph: it neither allocates nor waits.
TEST(TrainableScene, StepsAreCapturedIntoGraphs) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(5000, 3);
  const std::vector<l4d_camera> cameras = {ring_camera(160, 120, 0), ring_camera(160, 120, 2)};
  const TrainableArrays arrays(scene, 5000, 48, 0), sums(io::Scene{}, 5000, 48, 0);
  const TrainableHandle trainable = make_trainable();
  const l4d_gaussians g = arrays.view(scene);
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, nullptr));
  reserve(trainable, cameras[0], 5000, 1 << 18, 2);
  TrainableViews views(cameras, {0.7, 0.7});
  for (size_t v = 0; v < 2; ++v) {
    views.upstream[v]->write(random_numbers(3 * 160 * 120, v, -1, 1));
  }
  cudaStream_t stream;
  ASSERT_EQ(cudaStreamCreate(&stream), cudaSuccess);
  cudaGraph_t graph = nullptr;
  cudaGraphExec_t replay = nullptr;
  ASSERT_EQ(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal), cudaSuccess);
  check(l4d_cuda_trainable_refresh(trainable.get(), stream));
  views.forward(trainable, stream);
  views.backward(trainable, sums.gradients(), nullptr, stream);
  ASSERT_EQ(cudaStreamEndCapture(stream, &graph), cudaSuccess);
  ASSERT_EQ(cudaGraphInstantiate(&replay, graph, 0), cudaSuccess);
  ASSERT_EQ(cudaGraphLaunch(replay, stream), cudaSuccess);
  ASSERT_EQ(cudaStreamSynchronize(stream), cudaSuccess);
  const auto once = sums.read(5000, 48);
  const TrainableArrays again(io::Scene{}, 5000, 48, 0);
  check(l4d_cuda_trainable_refresh(trainable.get(), stream));
  views.forward(trainable, stream);
  views.backward(trainable, again.gradients(), nullptr, stream);
  ASSERT_EQ(cudaStreamSynchronize(stream), cudaSuccess);
  const auto launched = again.read(5000, 48);
  for (size_t k = 0; k < 6; ++k) EXPECT_TRUE(equal_bits(once[k], launched[k])) << kArrays[k];
  cudaGraphExecDestroy(replay);
  cudaGraphDestroy(graph);
  cudaStreamDestroy(stream);
}

TEST(TrainableScene, RefusesWhatItCannotDo) {
  l4d_cuda_trainable* none = nullptr;
  l4d_cuda_renderer_options half = L4D_INIT(l4d_cuda_renderer_options);
  half.sh_format = L4D_CUDA_SH_FLOAT16;
  EXPECT_EQ(l4d_cuda_trainable_create(&half, &none), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_cuda_trainable_create(nullptr, nullptr), L4D_ERR_INVALID_ARGUMENT);
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(100, 3);
  const TrainableArrays arrays(scene, 100, 48, 0), sums(io::Scene{}, 100, 48, 0);
  const TrainableHandle trainable = make_trainable();
  EXPECT_EQ(l4d_cuda_trainable_refresh(trainable.get(), nullptr), L4D_ERR_INVALID_STATE);
  l4d_gaussians g = arrays.view(scene);
  l4d_cuda_trainable_rows rows = L4D_INIT(l4d_cuda_trainable_rows);
  for (const uint32_t stride : {44u, 50u, 1028u}) {
    rows.sh_stride = stride;
    EXPECT_EQ(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, &rows),
              L4D_ERR_INVALID_ARGUMENT);
  }
  ++g.sh;
  EXPECT_EQ(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, nullptr),
            L4D_ERR_INVALID_ARGUMENT);
  g.sh = nullptr;
  EXPECT_EQ(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, nullptr),
            L4D_ERR_INVALID_ARGUMENT);
  g = arrays.view(scene);
  check(l4d_cuda_trainable_set_scene(trainable.get(), &g, &scene.timeline, nullptr));
  const l4d_camera camera = ring_camera(64, 48, 1), larger = ring_camera(65, 48, 1);
  reserve(trainable, camera, 100, 1000, 1);
  check(l4d_cuda_trainable_refresh(trainable.get(), nullptr));
  TrainableViews views({camera}, {1.0}), two({camera, camera}, {1.0, 1.0}), large({larger}, {1.0});
  EXPECT_EQ(l4d_cuda_trainable_forward(trainable.get(), two.views.data(), 2, nullptr),
            L4D_ERR_INVALID_STATE);
  EXPECT_EQ(l4d_cuda_trainable_forward(trainable.get(), large.views.data(), 1, nullptr),
            L4D_ERR_INVALID_STATE);
  EXPECT_EQ(l4d_cuda_trainable_forward(trainable.get(), views.views.data(), 0, nullptr),
            L4D_ERR_INVALID_ARGUMENT);
  l4d_gradients gradients = sums.gradients();
  EXPECT_EQ(l4d_cuda_trainable_backward(trainable.get(), views.losses.data(), 1, &gradients,
                                        nullptr, nullptr),
            L4D_ERR_INVALID_STATE);
  views.forward(trainable);
  EXPECT_EQ(l4d_cuda_trainable_backward(trainable.get(), two.losses.data(), 2, &gradients, nullptr,
                                        nullptr),
            L4D_ERR_INVALID_STATE);
  gradients.count = 99;
  EXPECT_EQ(l4d_cuda_trainable_backward(trainable.get(), views.losses.data(), 1, &gradients,
                                        nullptr, nullptr),
            L4D_ERR_INVALID_ARGUMENT);
  gradients.count = 100;
  gradients.view = views.view_gradient[0]->get();
  EXPECT_EQ(l4d_cuda_trainable_backward(trainable.get(), views.losses.data(), 1, &gradients,
                                        nullptr, nullptr),
            L4D_ERR_INVALID_ARGUMENT);
}

}  // namespace
}  // namespace l4d::render
