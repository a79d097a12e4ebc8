// SPDX-License-Identifier: Apache-2.0
// render.hpp: render.h for C++17. Functions that can fail throw l4d::Error.
#ifndef L4D_RENDER_HPP
#define L4D_RENDER_HPP

#include <array>
#include <vector>

#include "l4d/decode.hpp"
#include "l4d/render.h"

namespace l4d {

class RendererHandle : public Handle<l4d_renderer, l4d_renderer_destroy> {
 public:
  explicit RendererHandle(const l4d_renderer_options* options = nullptr)
      : Handle([&](l4d_renderer** out) { return l4d_renderer_create(options, out); }) {}

  // Borrows the arrays until another scene is set.
  void set_gaussians(const l4d_gaussians& gaussians, const l4d_timeline& timeline) {
    check(l4d_renderer_set_gaussians(get(), &gaussians, &timeline));
  }
  // Borrows the decoder likewise.
  void set_decoder(const DecoderHandle& decoder, const l4d_operating_point& point = {}) {
    l4d_decoder* const stream = decoder.get();
    check(l4d_renderer_set_streams(get(), &stream, nullptr, 1, &point));
  }
  // Likewise; shifts: one for each, or empty.
  void set_streams(ArrayView<l4d_decoder* const> decoders, ArrayView<const double> shifts,
                   const l4d_operating_point& point = {}) {
    check(l4d_renderer_set_streams(get(), decoders.data(), shifts.empty() ? nullptr : shifts.data(),
                                   static_cast<uint32_t>(decoders.size()), &point));
  }
  void set_rendering(const l4d_rendering* rendering) {
    check(l4d_renderer_set_rendering(get(), rendering));
  }
  // red, green, blue
  void set_background(const std::array<float, 3>& rgb) {
    check(l4d_renderer_set_background(get(), rgb.data()));
  }
  void set_time(double seconds) { check(l4d_renderer_set_time(get(), seconds)); }
  // rgb: [height, width, 3].
  void render(const l4d_camera& camera, float* rgb) const {
    l4d_image image = L4D_INIT(l4d_image);
    image.rgb = rgb;
    check(l4d_renderer_render(get(), &camera, &image));
  }
  std::vector<float> render(const l4d_camera& camera) const {
    std::vector<float> rgb(size_t{3} * camera.width * camera.height);
    render(camera, rgb.data());
    return rgb;
  }
  // What l4d_renderer_backward says of both.
  void backward(const l4d_camera& camera, ArrayView<const float> rgb_gradient,
                l4d_gradients* gradients) const {
    check(l4d_renderer_backward(get(), &camera, rgb_gradient.data(), gradients));
  }
  // As l4d_measure_importance. weights: [L4D_WEIGHT_COUNT] arrays of `count` or null; options and
  // report may be null.
  void measure_importance(ArrayView<const l4d_camera> cameras, ArrayView<const l4d_view> views,
                          const l4d_measure_options* options, float* const* weights, uint64_t count,
                          l4d_measure_report* report = nullptr) {
    check(l4d_measure_importance(get(), cameras.data(), static_cast<uint32_t>(cameras.size()),
                                 views.data(), views.size(), options, weights, count, report));
  }
  l4d_render_stats stats() const {
    return detail::filled<l4d_render_stats>(
        [&](l4d_render_stats* s) { return l4d_renderer_get_stats(get(), s); });
  }
};

}  // namespace l4d
#endif  // L4D_RENDER_HPP
