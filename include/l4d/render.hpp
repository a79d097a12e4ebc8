// SPDX-License-Identifier: Apache-2.0
// render.hpp: owning handles over render.h, header-only C++17, beside those of l4d.hpp. Functions
// that can fail throw l4d::Error.
#ifndef L4D_RENDER_HPP
#define L4D_RENDER_HPP

#include <memory>
#include <vector>

#include "l4d/l4d.hpp"
#include "l4d/render.h"

namespace l4d {

class RendererHandle {
 public:
  explicit RendererHandle(const l4d_renderer_options* options = nullptr) {
    l4d_renderer* r = nullptr;
    const l4d_status status = l4d_renderer_create(options, &r);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
    handle_.reset(r);
  }
  l4d_renderer* get() const noexcept { return handle_.get(); }

  // Borrows the arrays until another scene is set.
  void set_gaussians(const l4d_gaussians& gaussians, const l4d_timeline& timeline) {
    check(l4d_renderer_set_gaussians(get(), &gaussians, &timeline));
  }
  // Borrows the decoder likewise.
  void set_decoder(const DecoderHandle& decoder) {
    check(l4d_renderer_set_decoder(get(), decoder.get()));
  }
  // Likewise; shifts: one for each, or empty.
  void set_decoders(const std::vector<l4d_decoder*>& decoders, const std::vector<double>& shifts) {
    check(l4d_renderer_set_decoders(get(), decoders.data(),
                                    shifts.empty() ? nullptr : shifts.data(),
                                    static_cast<uint32_t>(decoders.size())));
  }
  void set_rendering(const l4d_rendering* rendering) {
    check(l4d_renderer_set_rendering(get(), rendering));
  }
  void set_time(double seconds) { check(l4d_renderer_set_time(get(), seconds)); }
  // rgb: [height, width, 3].
  void render(const l4d_camera& camera, float* rgb) const {
    l4d_image image;
    l4d_image_init(&image);
    image.rgb = rgb;
    check(l4d_renderer_render(get(), &camera, &image));
  }
  std::vector<float> render(const l4d_camera& camera) const {
    std::vector<float> rgb(size_t{3} * camera.width * camera.height);
    render(camera, rgb.data());
    return rgb;
  }
  l4d_render_stats stats() const {
    l4d_render_stats s;
    l4d_render_stats_init(&s);
    check(l4d_renderer_get_stats(get(), &s));
    return s;
  }
  void check(l4d_status status) const {
    if (status != L4D_OK) throw Error(status, l4d_renderer_error_message(get()));
  }

 private:
  struct Destroy {
    void operator()(l4d_renderer* r) const noexcept { l4d_renderer_destroy(r); }
  };
  std::unique_ptr<l4d_renderer, Destroy> handle_;
};

class SensitivityHandle {
 public:
  // options may be null.
  SensitivityHandle(const l4d_sensitivity_options* options, uint64_t count, uint32_t sh_degree)
      : count_(count) {
    l4d_sensitivity* s = nullptr;
    const l4d_status status = l4d_sensitivity_create(options, count, sh_degree, &s);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
    handle_.reset(s);
  }
  // Takes over what l4d_measure_importance made of a scene of `count` Gaussians.
  SensitivityHandle(l4d_sensitivity* measured, uint64_t count) : count_(count), handle_(measured) {}
  l4d_sensitivity* get() const noexcept { return handle_.get(); }

  // visibility_only as in l4d_sensitivity_add_view.
  void add_view(const RendererHandle& renderer, const l4d_camera& camera,
                bool visibility_only = false) {
    renderer.check(
        l4d_sensitivity_add_view(get(), renderer.get(), &camera, visibility_only ? 1 : 0));
  }
  void merge(const SensitivityHandle& other) { check(l4d_sensitivity_merge(get(), other.get())); }
  std::vector<float> weights(uint32_t which) const {
    std::vector<float> out(static_cast<size_t>(count_));
    check(l4d_sensitivity_get_weights(get(), which, out.data(), count_));
    return out;
  }

 private:
  static void check(l4d_status status) {
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }
  struct Destroy {
    void operator()(l4d_sensitivity* s) const noexcept { l4d_sensitivity_destroy(s); }
  };
  uint64_t count_;
  std::unique_ptr<l4d_sensitivity, Destroy> handle_;
};

}  // namespace l4d
#endif  // L4D_RENDER_HPP
