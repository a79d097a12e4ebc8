// SPDX-License-Identifier: Apache-2.0
// Rendering between device arrays.
#include <cuda_runtime_api.h>

#include <memory>

#include "l4d/cuda_render.h"
#include "tests/gpu/render_support.h"

namespace l4d::render {
namespace {

// A copy of host numbers on the device.
class DeviceCopy {
 public:
  template <typename T>
  explicit DeviceCopy(const std::vector<T>& from) : bytes_(from.size() * sizeof(T)) {
    EXPECT_EQ(cudaMalloc(&data_, std::max<size_t>(bytes_, 1)), cudaSuccess);
    EXPECT_EQ(cudaMemcpy(data_, from.data(), bytes_, cudaMemcpyHostToDevice), cudaSuccess);
  }
  ~DeviceCopy() { cudaFree(data_); }
  DeviceCopy(const DeviceCopy&) = delete;
  DeviceCopy& operator=(const DeviceCopy&) = delete;
  float* floats() const { return static_cast<float*>(data_); }
  uint32_t* words() const { return static_cast<uint32_t*>(data_); }
  template <typename T>
  std::vector<T> read() const {
    std::vector<T> out(bytes_ / sizeof(T));
    EXPECT_EQ(cudaMemcpy(out.data(), data_, bytes_, cudaMemcpyDeviceToHost), cudaSuccess);
    return out;
  }

 private:
  void* data_ = nullptr;
  size_t bytes_;
};

// The scene's arrays on the device, and a view of rows [first, first + count).
struct DeviceScene {
  explicit DeviceScene(const io::Scene& s)
      : scene(s),
        position(s.position),
        mean_t(s.mean_t),
        log_scale(s.log_scale),
        rotor(s.rotor),
        opacity(s.opacity),
        sh(s.sh) {}
  l4d_gaussians view(size_t first, size_t count) const {
    l4d_gaussians g = scene.view();
    g.count = count;
    g.position = position.floats() + 3 * first;
    g.mean_t = mean_t.floats() + first;
    g.log_scale = log_scale.floats() + 4 * first;
    g.rotor = rotor.floats() + 8 * first;
    g.opacity = opacity.floats() + first;
    g.sh = sh.floats() + 3 * scene.sh_coefficients() * first;
    return g;
  }
  const io::Scene& scene;
  DeviceCopy position, mean_t, log_scale, rotor, opacity, sh;
};

struct Destroy {
  void operator()(l4d_cuda_renderer* r) const { l4d_cuda_renderer_destroy(r); }
};
using Handle = std::unique_ptr<l4d_cuda_renderer, Destroy>;

Handle make(uint32_t sh_format) {
  l4d_cuda_renderer_options options;
  l4d_cuda_renderer_options_init(&options);
  options.sh_format = sh_format;
  l4d_cuda_renderer* out = nullptr;
  EXPECT_EQ(l4d_cuda_renderer_create(&options, &out), L4D_OK);
  return Handle(out);
}

void check(const Handle& r, l4d_status status) {
  EXPECT_EQ(status, L4D_OK) << l4d_cuda_renderer_error_message(r.get());
}

l4d_cuda_frame_capacity capacity_of(const l4d_camera& camera, uint64_t visible,
                                    uint64_t instances) {
  l4d_cuda_frame_capacity capacity;
  l4d_cuda_frame_capacity_init(&capacity);
  capacity.width = camera.width;
  capacity.height = camera.height;
  capacity.visible = visible;
  capacity.instances = instances;
  return capacity;
}

std::vector<float> render(const Handle& r, const l4d_camera& camera, double time,
                          std::vector<uint32_t>* bytes = nullptr) {
  const size_t pixels = size_t{camera.width} * camera.height;
  const DeviceCopy rgb(std::vector<float>(3 * pixels, -7)), alpha(std::vector<float>(pixels, -7));
  const DeviceCopy rgba8(std::vector<uint32_t>(pixels, 0x55555555u));
  l4d_cuda_image image;
  l4d_cuda_image_init(&image);
  image.rgb = rgb.floats();
  image.alpha = alpha.floats();
  image.rgba8 = rgba8.words();
  check(r, l4d_cuda_renderer_render(r.get(), time, &camera, &image, nullptr));
  l4d_cuda_frame_stats stats;
  l4d_cuda_frame_stats_init(&stats);
  check(r, l4d_cuda_renderer_get_stats(r.get(), nullptr, &stats));
  if (bytes != nullptr) *bytes = rgba8.read<uint32_t>();
  return rgb.read<float>();
}

TEST(ResidentRender, WholeScenesInBothFormats) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    const io::Scene scene = with_degree(synth(20000, 3), degree);
    const DeviceScene device(scene);
    RendererHandle expected = make_renderer(L4D_BACKEND_CPU);
    expected.set_gaussians(scene.view(), scene.timeline);
    expected.set_time(1.2);
    const l4d_camera camera = ring_camera(240, 170, 0.7);
    const std::vector<float> e = expected.render(camera);
    for (const uint32_t format : {L4D_CUDA_SH_FLOAT32, L4D_CUDA_SH_FLOAT16}) {
      const Handle r = make(format);
      const l4d_gaussians g = device.view(0, scene.count());
      check(r, l4d_cuda_renderer_set_gaussians(r.get(), &g, &scene.timeline));
      const l4d_cuda_frame_capacity capacity = capacity_of(camera, scene.count(), 1 << 20);
      check(r, l4d_cuda_renderer_reserve(r.get(), &capacity));
      std::vector<uint32_t> bytes;
      const std::vector<float> image = render(r, camera, 1.2, &bytes);
      const ImageDifference d = difference_of(image, e, 1.0 / 255);
      std::cout << "degree " << degree << ", format " << format << ": largest " << d.largest
                << ", beyond a step " << d.beyond << "\n";
      EXPECT_LE(d.beyond, 4u) << degree << " " << format;
      for (size_t pixel = 0; pixel < bytes.size(); ++pixel) {
        for (size_t c = 0; c < 3; ++c) {
          const double v = std::min(std::max(static_cast<double>(image[3 * pixel + c]), 0.0), 1.0);
          ASSERT_NEAR(static_cast<double>(bytes[pixel] >> (8 * c) & 255), 255 * v, 0.5001);
        }
      }
    }
  }
}

// Parts of a scene in batches, out of order in the store, look as the whole does.
TEST(ResidentRender, BatchesAreAScene) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(9000, 8);
  const DeviceScene device(scene);
  const l4d_camera camera = ring_camera(200, 150, 2.0);
  const Handle whole = make(L4D_CUDA_SH_FLOAT32), parts = make(L4D_CUDA_SH_FLOAT32);
  const l4d_gaussians g = device.view(0, scene.count());
  const l4d_cuda_frame_capacity capacity = capacity_of(camera, scene.count(), 1 << 19);
  check(whole, l4d_cuda_renderer_set_gaussians(whole.get(), &g, &scene.timeline));
  check(whole, l4d_cuda_renderer_reserve(whole.get(), &capacity));
  check(parts, l4d_cuda_renderer_reserve_slots(parts.get(), 12000, 3, &scene.timeline));
  check(parts, l4d_cuda_renderer_reserve(parts.get(), &capacity));
  const uint32_t cuts[4] = {0, 1700, 1701, 9000}, places[3] = {9000, 0, 300};
  l4d_cuda_batch batches[3];
  for (size_t k = 0; k < 3; ++k) {
    const l4d_gaussians part = device.view(cuts[k], cuts[k + 1] - cuts[k]);
    check(parts, l4d_cuda_renderer_store_gaussians(parts.get(), places[k], &part, nullptr));
    batches[k] = {places[k], cuts[k + 1] - cuts[k], L4D_CUDA_MOTION_MOVING, 0};
  }
  check(parts, l4d_cuda_renderer_set_batches(parts.get(), batches, 3, nullptr));
  for (const double time : {0.4, 2.6}) {
    const ImageDifference d =
        difference_of(render(parts, camera, time), render(whole, camera, time), 1.0 / 255);
    EXPECT_LE(d.beyond, 2u) << time;
  }
  // Without a part the image is another one.
  check(parts, l4d_cuda_renderer_set_batches(parts.get(), batches, 1, nullptr));
  EXPECT_GT(difference_of(render(parts, camera, 0.4), render(whole, camera, 0.4), 0.1).beyond,
            100u);
  batches[0].count = 5000;
  EXPECT_EQ(l4d_cuda_renderer_set_batches(parts.get(), batches, 1, nullptr),
            L4D_ERR_INVALID_ARGUMENT);
}

TEST(ResidentRender, ReportsMissingCapacity) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(9000, 8);
  const DeviceScene device(scene);
  const l4d_camera camera = ring_camera(200, 150, 2.0), larger = ring_camera(201, 150, 2.0);
  const l4d_gaussians g = device.view(0, scene.count());
  const DeviceCopy rgb(std::vector<float>(3 * 200 * 150, 0));
  l4d_cuda_image image;
  l4d_cuda_image_init(&image);
  image.rgb = rgb.floats();
  uint64_t wanted[2] = {};
  for (const auto& [visible, instances] :
       {std::pair<uint64_t, uint64_t>{9000, 5000}, {700, 1 << 19}, {9000, 1 << 19}}) {
    const Handle r = make(L4D_CUDA_SH_FLOAT32);
    EXPECT_EQ(l4d_cuda_renderer_render(r.get(), 1, &camera, &image, nullptr),
              L4D_ERR_INVALID_STATE);
    check(r, l4d_cuda_renderer_set_gaussians(r.get(), &g, &scene.timeline));
    const l4d_cuda_frame_capacity capacity = capacity_of(camera, visible, instances);
    check(r, l4d_cuda_renderer_reserve(r.get(), &capacity));
    EXPECT_EQ(l4d_cuda_renderer_render(r.get(), 1, &larger, &image, nullptr),
              L4D_ERR_INVALID_STATE);
    check(r, l4d_cuda_renderer_render(r.get(), 1, &camera, &image, nullptr));
    l4d_cuda_frame_stats stats;
    l4d_cuda_frame_stats_init(&stats);
    const l4d_status status = l4d_cuda_renderer_get_stats(r.get(), nullptr, &stats);
    if (instances == 5000) {
      EXPECT_EQ(status, L4D_ERR_LIMIT_EXCEEDED);
      EXPECT_EQ(stats.instances, 5000u);
      wanted[0] = stats.required_instances;
    } else if (visible == 700) {
      EXPECT_EQ(status, L4D_ERR_LIMIT_EXCEEDED);
      EXPECT_EQ(stats.visible, 700u);
      wanted[1] = stats.required_visible;
    } else {
      EXPECT_EQ(status, L4D_OK);
      EXPECT_EQ(stats.instances, wanted[0]);
      EXPECT_EQ(stats.visible, wanted[1]);
    }
  }
}

TEST(ResidentRender, GradientsAreThoseOfTheRenderer) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(5000, 9);
  const DeviceScene device(scene);
  const l4d_camera camera = ring_camera(150, 110, 3.3);
  const size_t n = scene.count();
  const std::vector<float> upstream(size_t{3} * 150 * 110, 0.7f);
  RendererHandle expected = make_device();
  expected.set_gaussians(scene.view(), scene.timeline);
  expected.set_time(0.9);
  std::vector<float> position(3 * n), sh(scene.sh.size());
  l4d_gradients host;
  l4d_gradients_init(&host);
  host.count = n;
  host.position = position.data();
  host.sh = sh.data();
  expected.check(l4d_renderer_backward(expected.get(), &camera, upstream.data(), &host));

  const Handle r = make(L4D_CUDA_SH_FLOAT32);
  const l4d_gaussians g = device.view(0, n);
  check(r, l4d_cuda_renderer_set_gaussians(r.get(), &g, &scene.timeline));
  l4d_cuda_frame_capacity capacity = capacity_of(camera, n, 1 << 19);
  capacity.backward = 1;
  check(r, l4d_cuda_renderer_reserve(r.get(), &capacity));
  const DeviceCopy device_upstream(upstream), by_position(std::vector<float>(3 * n, 0)),
      by_sh(std::vector<float>(sh.size(), 0));
  l4d_gradients out = host;
  out.position = by_position.floats();
  out.sh = by_sh.floats();
  l4d_cuda_image image;
  l4d_cuda_image_init(&image);
  check(r, l4d_cuda_renderer_backward(r.get(), 0.9, &camera, &image, device_upstream.floats(), &out,
                                      nullptr));
  EXPECT_TRUE(equal_bits(by_position.read<float>(), position));
  EXPECT_TRUE(equal_bits(by_sh.read<float>(), sh));
}

}  // namespace
}  // namespace l4d::render
