// SPDX-License-Identifier: Apache-2.0
// What an l4d_renderer handle is: a source of Gaussians, the instant, and a rasteriser.
#pragma once

#include <memory>
#include <vector>

#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/base/status.h"
#include "render/cpu/rasterizer.h"
#include "render/cuda/scene/device_renderer.h"
#include "render/frame/scene.h"
#include "render/frame/slice_gradient.h"
#include "render/frame/streams.h"

namespace l4d::render {

class Renderer {
 public:
  explicit Renderer(const l4d_renderer_options& options);

  Status set_gaussians(const l4d_gaussians& gaussians, const l4d_timeline& timeline);
  // shifts: null = 0 for all.
  Status set_streams(l4d_decoder* const* decoders, const double* shifts, size_t count,
                     const l4d_operating_point& point);
  // null: as the scene states.
  Status set_rendering(const l4d_rendering* rendering);
  void set_background(const float* rgb) { std::copy_n(rgb, 3, background_); }
  Status set_time(double time);
  Status render(const l4d_camera& camera, const l4d_image& image);
  Status backward(const l4d_camera& camera, const float* rgb_gradient, l4d_gradients* gradients);
  void stats(l4d_render_stats* out) const;

  // What a Gaussian means to a view.
  struct Importance {
    uint32_t id;         // index in the scene
    float coverage;      // sum of alpha times transmittance
    float color[3];      // derivatives by the colour, not clamped
    float direction[3];  // in which the camera sees it
    // Derivatives, not of SH, by opacity in [0, 1]; zero where coverage alone is asked for.
    Gradient4D<float> gradient;
  };
  struct ImportanceInput {
    // What makes the signs with which the channels of pixels count, or NULL: 1.
    const uint64_t* signs = nullptr;
    // Derivatives by attributes as streams code them (positions at t_ref, rotors normalised), not
    // as the scene gives them.
    bool as_coded = false;
    // Not NULL asks for coverage alone, of those not marked (BackwardInput).
    const uint8_t* seen = nullptr;
  };
  // Of all Gaussians of the frame, in its order. Not on a device.
  Status importance(const l4d_camera& camera, const ImportanceInput& input,
                    std::vector<Importance>* out);

  // A device adds importances up itself: DeviceRenderer has these calls.
  bool on_device() const { return cuda_; }
  Status make_importance(uint32_t metric, bool sum_visible_only,
                         std::unique_ptr<DeviceImportance>* out);
  Status add_importance(const l4d_camera& camera, bool squared, uint64_t signs,
                        bool visibility_only, DeviceImportance* sums, bool wait);
  // Waits for views that were added without waiting; they all are in the sums then.
  Status finish_importance();

  const Scene& scene() const { return scene_; }
  bool has_scene() const { return source_ == Source::kGaussians; }
  bool has_background() const {
    return background_[0] != 0 || background_[1] != 0 || background_[2] != 0;
  }
  int threads() const { return threads_; }
  // Whether `bytes` would be allowed beside what is held; LIMIT_EXCEEDED if not.
  double time() const { return time_; }  // of the last set_time, seconds

 private:
  enum class Source { kNone, kGaussians, kStreams };
  // One of the two precisions.
  template <typename T>
  struct Path {
    std::unique_ptr<Rasterizer<T>> rasterizer;
    Frame<T> frame;
    ViewGradients<T> gradients;
  };

  // Calls body(path) with the path in use.
  template <typename Body>
  auto with_path(const Body& body) {
    return double_.rasterizer != nullptr ? body(double_) : body(float_);
  }
  // Calls body, and once more without what earlier calls left where that takes too much room.
  // with_scene: the scene and its instant, too, are of earlier calls.
  template <typename Body>
  Status within_limit(bool with_scene, const Body& body);
  void forget(bool with_scene);
  Status slice(double time);
  const l4d_rendering& rendering() const { return has_given_ ? given_ : stated_; }
  // Whether this backend draws like that.
  Status supports(const l4d_rendering& rendering) const;
  Status ready(const l4d_camera& camera) const;
  // Makes the device ready for a scene; says why not where it cannot.
  Status acquire_device();
  void keep(const DeviceFrameStats& stats);
  void begin_view();  // forgets the figures of the last one, not those of the instant
  template <typename T>
  Instant<T> instant() const;
  template <typename T>
  Gaussian4D<T> attributes(size_t id) const;
  template <typename T>
  void add_gradients(Path<T>& path, const View<double>& view, l4d_gradients* out);
  // The same where nothing but opacities and colours is wanted, which takes no geometry.
  template <typename T>
  void add_light_gradients(Path<T>& path, const View<double>& view, l4d_gradients* out);
  template <typename T>
  void collect(Path<T>& path, const View<double>& view, const ImportanceInput& input,
               std::vector<Importance>* out);

  MemoryBudget memory_;  // of the CPU paths; before those that it counts
  int threads_;
  bool cuda_;
  uint32_t device_number_;
  std::unique_ptr<DeviceRenderer> device_;  // from the first scene on, where it is wanted
  uint64_t device_visible_ = 0;
  Source source_ = Source::kNone;
  Scene scene_;
  Streams streams_;
  Path<float> float_;
  Path<double> double_;   // of the reference; its rasteriser is absent on the fast path
  l4d_rendering stated_;  // by the scene
  l4d_rendering given_;   // by the caller
  bool has_given_ = false;
  float background_[3] = {0, 0, 0};
  bool has_time_ = false;
  double time_ = 0;
  Stats stats_;
};

}  // namespace l4d::render
