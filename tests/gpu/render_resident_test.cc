// SPDX-License-Identifier: Apache-2.0
// Rendering between device arrays.
#include <cuda_runtime_api.h>

#include <memory>

#include "l4d/experimental/cuda_render.h"
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

// The scene's arrays on the device.
struct DeviceScene {
  explicit DeviceScene(const io::Scene& s)
      : scene(s),
        position(s.position),
        mean_t(s.mean_t),
        log_scale(s.log_scale),
        rotor(s.rotor),
        opacity(s.opacity),
        sh(s.sh),
        window(s.window.empty() ? std::vector<uint32_t>(2) : s.window) {}
  l4d_gaussians view() const {
    l4d_gaussians g = scene.view();
    g.position = position.floats();
    g.mean_t = mean_t.floats();
    g.log_scale = log_scale.floats();
    g.rotor = rotor.floats();
    g.opacity = opacity.floats();
    g.sh = sh.floats();
    g.window = scene.window.empty() ? nullptr : window.words();
    return g;
  }
  const io::Scene& scene;
  DeviceCopy position, mean_t, log_scale, rotor, opacity, sh, window;
};

struct Destroy {
  void operator()(l4d_cuda_renderer* r) const { l4d_cuda_renderer_destroy(r); }
};
using Handle = std::unique_ptr<l4d_cuda_renderer, Destroy>;

Handle make(uint32_t sh_format) {
  l4d_cuda_renderer_options options = L4D_INIT(l4d_cuda_renderer_options);
  options.sh_format = sh_format;
  l4d_cuda_renderer* out = nullptr;
  EXPECT_EQ(l4d_cuda_renderer_create(&options, &out), L4D_OK);
  return Handle(out);
}

void check(l4d_status status) { EXPECT_EQ(status, L4D_OK) << l4d_last_error_message(); }

l4d_cuda_frame_capacity capacity_of(const l4d_camera& camera, uint64_t visible,
                                    uint64_t instances) {
  l4d_cuda_frame_capacity capacity = L4D_INIT(l4d_cuda_frame_capacity);
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
  l4d_cuda_image image = L4D_INIT(l4d_cuda_image);
  image.rgb = rgb.floats();
  image.alpha = alpha.floats();
  image.rgba8 = rgba8.words();
  check(l4d_cuda_renderer_render(r.get(), time, &camera, &image, nullptr));
  l4d_cuda_frame_stats stats = L4D_INIT(l4d_cuda_frame_stats);
  check(l4d_cuda_renderer_get_stats(r.get(), nullptr, &stats));
  if (bytes != nullptr) *bytes = rgba8.read<uint32_t>();
  return rgb.read<float>();
}

TEST(ResidentRender, WholeScenesInBothFormats) {
  L4D_SKIP_WITHOUT_DEVICE();
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    // Of an odd degree: with windows.
    const io::Scene plain = with_degree(synth(20000, 3), degree);
    const io::Scene scene = degree % 2 == 1 ? with_windows(plain) : plain;
    const DeviceScene device(scene);
    RendererHandle expected = make_renderer(L4D_BACKEND_CPU);
    expected.set_gaussians(scene.view(), scene.timeline);
    expected.set_time(1.2);
    const l4d_camera camera = ring_camera(240, 170, 0.7);
    const std::vector<float> e = expected.render(camera);
    for (const uint32_t format : {L4D_CUDA_SH_FLOAT32, L4D_CUDA_SH_FLOAT16}) {
      const Handle r = make(format);
      const l4d_gaussians g = device.view();
      check(l4d_cuda_renderer_set_gaussians(r.get(), &g, &scene.timeline));
      const l4d_cuda_frame_capacity capacity = capacity_of(camera, scene.count(), 1 << 20);
      check(l4d_cuda_renderer_reserve(r.get(), &capacity));
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

TEST(ResidentRender, ReportsMissingCapacity) {
  L4D_SKIP_WITHOUT_DEVICE();
  const io::Scene scene = synth(9000, 8);
  const DeviceScene device(scene);
  const l4d_camera camera = ring_camera(200, 150, 2.0), larger = ring_camera(201, 150, 2.0);
  const l4d_gaussians g = device.view();
  const DeviceCopy rgb(std::vector<float>(3 * 200 * 150, 0));
  l4d_cuda_image image = L4D_INIT(l4d_cuda_image);
  image.rgb = rgb.floats();
  uint64_t wanted[2] = {};
  for (const auto& [visible, instances] :
       {std::pair<uint64_t, uint64_t>{9000, 5000}, {700, 1 << 19}, {9000, 1 << 19}}) {
    const Handle r = make(L4D_CUDA_SH_FLOAT32);
    EXPECT_EQ(l4d_cuda_renderer_render(r.get(), 1, &camera, &image, nullptr),
              L4D_ERR_INVALID_STATE);
    check(l4d_cuda_renderer_set_gaussians(r.get(), &g, &scene.timeline));
    const l4d_cuda_frame_capacity capacity = capacity_of(camera, visible, instances);
    check(l4d_cuda_renderer_reserve(r.get(), &capacity));
    EXPECT_EQ(l4d_cuda_renderer_render(r.get(), 1, &larger, &image, nullptr),
              L4D_ERR_INVALID_STATE);
    check(l4d_cuda_renderer_render(r.get(), 1, &camera, &image, nullptr));
    l4d_cuda_frame_stats stats = L4D_INIT(l4d_cuda_frame_stats);
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

}  // namespace
}  // namespace l4d::render
