// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/scene/device_renderer.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "libl4dcodec/base/checked.h"
#include "libl4dcodec/scene/prepare.h"
#include "render/cuda/importance/in_flight_views.h"
#include "render/frame/view_gradient.h"

namespace l4d::render {
namespace {

Status upload(const void* from, size_t bytes, cuda::DeviceMemory* to) {
  L4D_RETURN_IF_ERROR(to->reserve(std::max<size_t>(bytes, 1)));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpy(to->data(), from, bytes, cudaMemcpyHostToDevice));
  return {};
}

Status clear(size_t bytes, cuda::DeviceMemory* memory) {
  L4D_RETURN_IF_ERROR(memory->reserve(std::max<size_t>(bytes, 1)));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemset(memory->data(), 0, bytes));
  return {};
}

// Adds an array of the device to one of the host.
Status add_to(size_t count, const float* device, float* host) {
  std::vector<float> sums(count);
  L4D_RETURN_IF_CUDA_ERROR(
      cudaMemcpy(sums.data(), device, count * sizeof(float), cudaMemcpyDeviceToHost));
  for (size_t i = 0; i < count; ++i) host[i] += sums[i];
  return {};
}

class Implementation : public DeviceRenderer {
 public:
  explicit Implementation(const DeviceRendererOptions& options) : options_(options) {}
  Status create() {
    L4D_RETURN_IF_ERROR(l4d::cuda::use_device(options_.device));
    return frame_.create();
  }
  ~Implementation() override { static_cast<void>(use()); }

  Status set_gaussians(const l4d_gaussians& gaussians, const l4d_timeline& timeline) override {
    L4D_RETURN_IF_ERROR(use());
    const size_t n = static_cast<size_t>(gaussians.count);
    l4d_gaussians device = gaussians;
    Status status;
    size_t next = 0;
    for_each_attribute(
        [&](const AttributeInfo& a, const float* from, const float*& to) {
          cuda::DeviceMemory& memory = attributes_[next++];
          if (status.ok() && from != nullptr) {  // times may be given as double alone
            status = upload(from, n * a.numbers(gaussians.sh_degree) * sizeof(float), &memory);
          }
          to = memory.as<float>();
        },
        gaussians, device);
    L4D_RETURN_IF_ERROR(status);
    if (gaussians.mean_t_double != nullptr) {
      L4D_RETURN_IF_ERROR(upload(gaussians.mean_t_double, n * sizeof(double), &double_times_));
      device.mean_t_double = double_times_.as<double>();
    }
    if (gaussians.window != nullptr) {
      L4D_RETURN_IF_ERROR(upload(gaussians.window, n * sizeof(FrameWindow), &windows_));
      device.window = windows_.as<uint32_t>();
    }
    return set_device_gaussians(device, timeline);
  }

  Status set_device_gaussians(const l4d_gaussians& gaussians,
                              const l4d_timeline& timeline) override {
    L4D_RETURN_IF_ERROR(use());
    forget_scene();
    StoreShape shape = shape_of(gaussians, timeline);
    shape.sh_degree = gaussians.sh_degree;
    shape.half_sh = options_.half_sh;
    L4D_RETURN_IF_ERROR(reserve_store(shape));
    L4D_RETURN_IF_ERROR(store_.store_scene(gaussians));
    gaussians_ = gaussians;
    return {};
  }

  Status set_splats(const HostSplats& splats) override;

  Status render(double time, const l4d_camera& camera, const float* background,
                const l4d_image& image, DeviceFrameStats* stats) override {
    L4D_RETURN_IF_ERROR(use());
    const size_t pixels = size_t{camera.width} * camera.height;
    ImageTarget target{};
    if (image.rgb != nullptr) {
      L4D_RETURN_IF_ERROR(rgb_.reserve(3 * pixels * sizeof(float)));
      target.rgb = rgb_.as<float>();
    }
    if (image.alpha != nullptr) {
      L4D_RETURN_IF_ERROR(alpha_.reserve(pixels * sizeof(float)));
      target.alpha = alpha_.as<float>();
    }
    L4D_RETURN_IF_ERROR(whole_frame(time, camera, background, false, target, false, stats,
                                    [] { return Status(); }));
    if (image.rgb != nullptr) {
      L4D_RETURN_IF_CUDA_ERROR(
          cudaMemcpy(image.rgb, target.rgb, 3 * pixels * sizeof(float), cudaMemcpyDeviceToHost));
    }
    if (image.alpha != nullptr) {
      L4D_RETURN_IF_CUDA_ERROR(
          cudaMemcpy(image.alpha, target.alpha, pixels * sizeof(float), cudaMemcpyDeviceToHost));
    }
    return frame_.pass_seconds(stats->seconds);
  }

  Status backward(double time, const l4d_camera& camera, const float* background,
                  const float* rgb_gradient, l4d_gradients* gradients,
                  DeviceFrameStats* stats) override;
  Status make_importance(uint32_t metric, bool sum_visible_only,
                         std::unique_ptr<DeviceImportance>* out) override {
    L4D_RETURN_IF_ERROR(use());
    auto memory = std::make_unique<ImportanceMemory>();
    L4D_RETURN_IF_ERROR(memory->create(static_cast<size_t>(gaussians_.count),
                                       importance_row(metric, gaussians_.sh_degree),
                                       sum_visible_only));
    *out = std::move(memory);
    return {};
  }
  Status add_importance(double time, const l4d_camera& camera, bool squared, uint64_t signs,
                        bool visibility_only, DeviceImportance* sums,
                        DeviceFrameStats* stats) override;
  Status finish_importance() override {
    L4D_RETURN_IF_ERROR(use());
    return views_ == nullptr ? Status() : views_->finish();
  }

  Status reserve(uint32_t width, uint32_t height, uint64_t visible, uint64_t instances) override {
    L4D_RETURN_IF_ERROR(use());
    FrameCapacity capacity;
    capacity.width = static_cast<int>(width);
    capacity.height = static_cast<int>(height);
    capacity.visible = saturate32(visible);
    capacity.instances = saturate32(instances);
    L4D_RETURN_IF_ERROR(back_.reserve(capacity, &frame_));
    return frame_.reserve_slices(store_);
  }
  Status launch(double time, const l4d_camera& camera, const float* background,
                const ImageTarget& image, void* stream) override {
    L4D_RETURN_IF_ERROR(use());
    return frame_.draw(store_, time, camera, background, false, image,
                       static_cast<cudaStream_t>(stream));
  }
  Status stats(void* stream, DeviceFrameStats* out, uint64_t* required_visible,
               uint64_t* required_instances) override {
    L4D_RETURN_IF_ERROR(use());
    FrameStats f;
    L4D_RETURN_IF_ERROR(frame_.stats(static_cast<cudaStream_t>(stream), &f));
    out->visible = f.visible;
    out->projected = f.projected;
    out->instances = f.instances;
    *required_visible = f.required_visible;
    *required_instances = f.required_instances;
    L4D_RETURN_IF_ERROR(frame_.pass_seconds(out->seconds));
    return f.check_whole();
  }
  Status time_passes() override {
    L4D_RETURN_IF_ERROR(use());
    return frame_.time_passes();
  }

 private:
  Status use() const {
    L4D_RETURN_IF_CUDA_ERROR(cudaSetDevice(options_.device));
    return {};
  }
  Status reserve_store(const StoreShape& shape) {
    L4D_RETURN_IF_ERROR(store_.reserve(shape));
    return frame_.reserve_slices(store_);
  }
  void forget_scene() { views_.reset(); }
  // Renders until all instances fit, and waits. rest(): what is to be launched after the frame;
  // it must do no harm after frames that lack instances.
  template <class Rest>
  Status whole_frame(double time, const l4d_camera& camera, const float* background, bool backward,
                     const ImageTarget& target, bool backward_capacity, DeviceFrameStats* stats,
                     const Rest& rest);

  DeviceRendererOptions options_;
  SceneStore store_;
  DeviceFrame frame_;
  BackwardPass back_;
  l4d_gaussians gaussians_{};  // device arrays
  cuda::DeviceMemory double_times_, windows_;
  cuda::DeviceMemory attributes_[kNumAttributes], gradients_[kNumAttributes], by_view_;
  cuda::DeviceMemory rgb_, alpha_, upstream_;
  cuda::PinnedMemory staging_;
  // Of the scene, from the first view nobody waits for on; goes before what its views read.
  std::unique_ptr<InFlightViews> views_;
};

template <class Rest>
Status Implementation::whole_frame(double time, const l4d_camera& camera, const float* background,
                                   bool backward, const ImageTarget& target, bool backward_capacity,
                                   DeviceFrameStats* stats, const Rest& rest) {
  FrameCapacity capacity = first_capacity(store_, camera, backward_capacity);
  FrameStats f{};
  do {
    L4D_RETURN_IF_ERROR(back_.reserve(capacity, &frame_));
    ImageTarget into = target;
    if (backward && into.rgb == nullptr) into.rgb = back_.scratch_image();
    L4D_RETURN_IF_ERROR(frame_.draw(store_, time, camera, background, backward, into, nullptr));
    L4D_RETURN_IF_ERROR(rest());
    L4D_RETURN_IF_CUDA_ERROR(cudaGetLastError());
    L4D_RETURN_IF_ERROR(frame_.stats(nullptr, &f));
    if (f.overflow) capacity = more_capacity(capacity, f);
  } while (f.overflow);
  stats->visible = f.visible;
  stats->projected = f.projected;
  stats->instances = f.instances;
  return {};
}

Status Implementation::set_splats(const HostSplats& splats) {
  L4D_RETURN_IF_ERROR(use());
  forget_scene();
  const size_t n = splats.count;
  StoreShape shape;
  shape.slots = n;
  shape.sh_degree = splats.sh_degree;
  L4D_RETURN_IF_ERROR(reserve_store(shape));
  const ResidentGaussians& slots = store_.resident();
  const size_t numbers = size_t{3} * sh_terms(splats.sh_degree);
  const size_t stride = sh_stride(splats.sh_degree, false);
  L4D_RETURN_IF_ERROR(staging_.reserve(std::max<size_t>(n, 1) * stride * sizeof(float)));
  const auto send = [&](void* to, size_t bytes) -> Status {
    L4D_RETURN_IF_CUDA_ERROR(cudaMemcpy(to, staging_.data(), bytes, cudaMemcpyHostToDevice));
    return {};
  };
  // Still slots: all that slicing would do has been done.
  float* f = staging_.as<float>();
  for (size_t i = 0; i < n; ++i) {
    f[2 * i] = -std::numeric_limits<float>::infinity();
    f[2 * i + 1] = std::numeric_limits<float>::infinity();
  }
  L4D_RETURN_IF_ERROR(send(slots.interval, n * sizeof(VisibleInterval)));
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = 0; k < 3; ++k) f[4 * i + k] = splats.position[k][i];
    f[4 * i + 3] = splats.opacity[i];
  }
  L4D_RETURN_IF_ERROR(send(slots.place, n * sizeof(float4)));
  for (size_t i = 0; i < n; ++i) {
    for (size_t k = 0; k < 4; ++k) f[4 * i + k] = splats.covariance[k][i];
  }
  L4D_RETURN_IF_ERROR(send(slots.shape0, n * sizeof(float4)));
  for (size_t i = 0; i < n; ++i) {
    f[4 * i] = splats.covariance[4][i];
    f[4 * i + 1] = splats.covariance[5][i];
    f[4 * i + 2] = f[4 * i + 3] = 0;
  }
  L4D_RETURN_IF_ERROR(send(slots.shape1, n * sizeof(float4)));
  for (size_t i = 0; i < n; ++i) {
    std::copy_n(splats.sh[i], numbers, f + stride * i);
    std::fill_n(f + stride * i + numbers, stride - numbers, 0.0f);
  }
  L4D_RETURN_IF_ERROR(send(slots.sh, n * stride * sizeof(float)));
  uint32_t* ids = staging_.as<uint32_t>();
  for (size_t i = 0; i < n; ++i) ids[i] = static_cast<uint32_t>(i);
  L4D_RETURN_IF_ERROR(send(slots.id, n * sizeof(uint32_t)));
  const Batch all{0, static_cast<uint32_t>(n), kStill};
  return store_.set_batches(&all, n > 0 ? 1 : 0, nullptr);
}

Status Implementation::backward(double time, const l4d_camera& camera, const float* background,
                                const float* rgb_gradient, l4d_gradients* gradients,
                                DeviceFrameStats* stats) {
  L4D_RETURN_IF_ERROR(use());
  const size_t n = static_cast<size_t>(gaussians_.count);
  const size_t pixels = size_t{camera.width} * camera.height;
  L4D_RETURN_IF_ERROR(upstream_.reserve(3 * pixels * sizeof(float)));
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpy(upstream_.data(), rgb_gradient, 3 * pixels * sizeof(float),
                                      cudaMemcpyHostToDevice));
  l4d_gradients out{};
  out.struct_size = sizeof out;
  out.count = gaussians_.count;
  if (gradients->view != nullptr) {
    L4D_RETURN_IF_ERROR(clear(kViewNumbers * sizeof(double), &by_view_));
    out.view = by_view_.as<double>();
  }
  Status status;
  size_t next = 0;
  for_each_attribute(
      [&](const AttributeInfo& a, const float* wanted, float*& to) {
        cuda::DeviceMemory& memory = gradients_[next++];
        if (wanted == nullptr || !status.ok()) return;
        status = clear(n * a.numbers(gaussians_.sh_degree) * sizeof(float), &memory);
        to = memory.as<float>();
      },
      *gradients, out);
  L4D_RETURN_IF_ERROR(status);
  const auto backward = [&]() -> Status {
    const BackwardTask task{Upstream::kGiven, upstream_.as<float>(), 0, back_.scratch_image()};
    L4D_RETURN_IF_ERROR(back_.run(&frame_, task, nullptr));
    launch_gradients(gradient_input(store_, gaussians_, time, camera), task, store_.resident(),
                     frame_.memory(), back_.memory(), out, {}, nullptr);
    return {};
  };
  L4D_RETURN_IF_ERROR(whole_frame(time, camera, background, true, {}, true, stats, backward));
  for_each_attribute(
      [&](const AttributeInfo& a, float* wanted, const float* from) {
        if (wanted == nullptr || !status.ok()) return;
        status = add_to(n * a.numbers(gaussians_.sh_degree), from, wanted);
      },
      *gradients, out);
  L4D_RETURN_IF_ERROR(status);
  if (gradients->view != nullptr) {
    double by_view[kViewNumbers];
    L4D_RETURN_IF_CUDA_ERROR(
        cudaMemcpy(by_view, by_view_.data(), sizeof by_view, cudaMemcpyDeviceToHost));
    for (int k = 0; k < kViewNumbers; ++k) gradients->view[k] += by_view[k];
  }
  return frame_.pass_seconds(stats->seconds);
}

Status Implementation::add_importance(double time, const l4d_camera& camera, bool squared,
                                      uint64_t signs, bool visibility_only, DeviceImportance* sums,
                                      DeviceFrameStats* stats) {
  L4D_RETURN_IF_ERROR(use());
  const ImportanceView view{time,  camera,          squared,
                            signs, visibility_only, static_cast<const ImportanceMemory*>(sums)};
  if (stats == nullptr) {
    if (views_ == nullptr) {
      auto views = std::make_unique<InFlightViews>();
      L4D_RETURN_IF_ERROR(views->create(store_, gaussians_));
      views_ = std::move(views);
    }
    return views_->add(view);
  }
  L4D_RETURN_IF_ERROR(finish_importance());
  const float black[3] = {0, 0, 0};
  return whole_frame(time, camera, black, !visibility_only, {}, true, stats, [&]() -> Status {
    return launch_view_sums(store_, gaussians_, view, nullptr, nullptr, &frame_, &back_);
  });
}

}  // namespace

Status make_device_renderer(const DeviceRendererOptions& options,
                            std::unique_ptr<DeviceRenderer>* out) {
  auto renderer = std::make_unique<Implementation>(options);
  L4D_RETURN_IF_ERROR(renderer->create());
  *out = std::move(renderer);
  return {};
}

}  // namespace l4d::render
