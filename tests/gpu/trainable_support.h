// SPDX-License-Identifier: Apache-2.0
// What the tests of trainable scenes share: arrays of fixed capacity on the device.
#pragma once

#include <cuda_runtime_api.h>

#include <algorithm>
#include <memory>

#include "l4d/experimental/cuda_train.h"
#include "tests/gpu/render_support.h"

namespace l4d::render {

// Numbers on the device.
template <typename T>
class DeviceArray {
 public:
  explicit DeviceArray(const std::vector<T>& from) : size_(from.size()) {
    EXPECT_EQ(cudaMalloc(&data_, std::max<size_t>(size_, 1) * sizeof(T)), cudaSuccess);
    write(from);
  }
  DeviceArray(size_t size, T value) : DeviceArray(std::vector<T>(size, value)) {}
  ~DeviceArray() { cudaFree(data_); }
  DeviceArray(const DeviceArray&) = delete;
  DeviceArray& operator=(const DeviceArray&) = delete;
  T* get() const { return static_cast<T*>(data_); }
  void write(const std::vector<T>& from) const {
    EXPECT_EQ(from.size(), size_);
    EXPECT_EQ(cudaMemcpy(data_, from.data(), size_ * sizeof(T), cudaMemcpyHostToDevice),
              cudaSuccess);
  }
  std::vector<T> read() const {
    std::vector<T> out(size_);
    EXPECT_EQ(cudaMemcpy(out.data(), data_, size_ * sizeof(T), cudaMemcpyDeviceToHost),
              cudaSuccess);
    return out;
  }

 private:
  void* data_ = nullptr;
  size_t size_;
};

// Rows of `numbers`, `stride` apart, `capacity` of them; those beyond the last are `filler`.
inline std::vector<float> spread(const std::vector<float>& from, size_t numbers, size_t stride,
                                 size_t capacity, float filler) {
  std::vector<float> out(capacity * stride, filler);
  const size_t rows = std::min(from.size() / numbers, capacity);
  for (size_t i = 0; i < rows; ++i) {
    for (size_t k = 0; k < numbers; ++k) out[stride * i + k] = from[numbers * i + k];
  }
  return out;
}
inline std::vector<float> gather(const std::vector<float>& from, size_t numbers, size_t stride,
                                 size_t count) {
  std::vector<float> out(count * numbers);
  for (size_t i = 0; i < count; ++i) {
    for (size_t k = 0; k < numbers; ++k) out[numbers * i + k] = from[stride * i + k];
  }
  return out;
}

// Six arrays of a scene or of derivatives, of a capacity.
struct TrainableArrays {
  // Rows beyond the scene's are filled with `filler`.
  TrainableArrays(const io::Scene& scene, size_t rows, size_t sh_stride, float filler)
      : capacity(rows),
        stride(sh_stride),
        position(spread(scene.position, 3, 3, rows, filler)),
        mean_t(spread(scene.mean_t, 1, 1, rows, filler)),
        log_scale(spread(scene.log_scale, 4, 4, rows, filler)),
        rotor(spread(scene.rotor, 8, 8, rows, filler)),
        opacity(spread(scene.opacity, 1, 1, rows, filler)),
        sh(spread(scene.sh, 3 * scene.sh_coefficients(), sh_stride, rows, filler)),
        window(2 * rows, 0u) {
    std::vector<uint32_t> windows = scene.window;
    windows.resize(2 * rows);
    window.write(windows);
  }
  l4d_gaussians view(const io::Scene& scene) const {
    l4d_gaussians g = scene.view();
    g.count = capacity;
    g.mean_t_double = nullptr;  // of the host
    g.position = position.get();
    g.mean_t = mean_t.get();
    g.log_scale = log_scale.get();
    g.rotor = rotor.get();
    g.opacity = opacity.get();
    g.sh = sh.get();
    g.window = scene.window.empty() ? nullptr : window.get();
    return g;
  }
  l4d_gradients gradients() const {
    l4d_gradients g = L4D_INIT(l4d_gradients);
    g.count = capacity;
    g.position = position.get();
    g.mean_t = mean_t.get();
    g.log_scale = log_scale.get();
    g.rotor = rotor.get();
    g.opacity = opacity.get();
    g.sh = sh.get();
    return g;
  }
  // The arrays of the first `count` rows, SH close together.
  std::vector<std::vector<float>> read(size_t count, size_t sh_numbers) const {
    return {gather(position.read(), 3, 3, count),  gather(mean_t.read(), 1, 1, count),
            gather(log_scale.read(), 4, 4, count), gather(rotor.read(), 8, 8, count),
            gather(opacity.read(), 1, 1, count),   gather(sh.read(), sh_numbers, stride, count)};
  }
  size_t capacity, stride;
  DeviceArray<float> position, mean_t, log_scale, rotor, opacity, sh;
  DeviceArray<uint32_t> window;
};

struct DestroyTrainable {
  void operator()(l4d_cuda_trainable* trainable) const { l4d_cuda_trainable_destroy(trainable); }
};
using TrainableHandle = std::unique_ptr<l4d_cuda_trainable, DestroyTrainable>;

inline TrainableHandle make_trainable() {
  l4d_cuda_trainable* out = nullptr;
  EXPECT_EQ(l4d_cuda_trainable_create(nullptr, &out), L4D_OK);
  return TrainableHandle(out);
}
inline void check(l4d_status status) { EXPECT_EQ(status, L4D_OK) << l4d_last_error_message(); }

inline void reserve(const TrainableHandle& trainable, const l4d_camera& camera, uint64_t visible,
                    uint64_t instances, uint32_t views) {
  l4d_cuda_frame_capacity capacity = L4D_INIT(l4d_cuda_frame_capacity);
  capacity.width = camera.width;
  capacity.height = camera.height;
  capacity.visible = visible;
  capacity.instances = instances;
  check(l4d_cuda_trainable_reserve(trainable.get(), &capacity, views));
}

// Views of one step with the arrays that they are drawn into and derived from.
struct TrainableViews {
  TrainableViews(const std::vector<l4d_camera>& all, const std::vector<double>& times)
      : cameras(all) {
    for (size_t v = 0; v < cameras.size(); ++v) {
      const size_t pixels = size_t{cameras[v].width} * cameras[v].height;
      rgb.push_back(std::make_unique<DeviceArray<float>>(3 * pixels, -7.0f));
      upstream.push_back(std::make_unique<DeviceArray<float>>(3 * pixels, 0.0f));
      error.push_back(std::make_unique<DeviceArray<float>>(pixels, 0.0f));
      view_gradient.push_back(std::make_unique<DeviceArray<double>>(9, 0.0));
      l4d_cuda_trainable_view view = L4D_INIT(l4d_cuda_trainable_view);
      view.camera = &cameras[v];
      view.time = times[v];
      view.background[0] = 0.2f;
      view.background[1] = 0.1f;
      view.background[2] = 0.4f;
      view.rgb = rgb[v]->get();
      views.push_back(view);
      l4d_cuda_trainable_loss loss = L4D_INIT(l4d_cuda_trainable_loss);
      loss.rgb_gradient = upstream[v]->get();
      loss.error = error[v]->get();
      loss.view_gradient = view_gradient[v]->get();
      losses.push_back(loss);
    }
  }
  uint32_t count() const { return static_cast<uint32_t>(views.size()); }
  void forward(const TrainableHandle& trainable, void* stream = nullptr) const {
    check(l4d_cuda_trainable_forward(trainable.get(), views.data(), count(), stream));
  }
  void backward(const TrainableHandle& trainable, const l4d_gradients& gradients,
                const l4d_cuda_trainable_statistics* statistics, void* stream = nullptr) const {
    check(l4d_cuda_trainable_backward(trainable.get(), losses.data(), count(), &gradients,
                                      statistics, stream));
  }
  std::vector<l4d_camera> cameras;
  std::vector<std::unique_ptr<DeviceArray<float>>> rgb, upstream, error;
  std::vector<std::unique_ptr<DeviceArray<double>>> view_gradient;
  std::vector<l4d_cuda_trainable_view> views;
  std::vector<l4d_cuda_trainable_loss> losses;
};

inline l4d_cuda_trainable_report report_of(const TrainableHandle& trainable) {
  l4d_cuda_trainable_report report = L4D_INIT(l4d_cuda_trainable_report);
  check(l4d_cuda_trainable_copy_report(trainable.get(), nullptr));
  check(l4d_cuda_trainable_get_report(trainable.get(), 1, &report));
  return report;
}

}  // namespace l4d::render
