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
  void set_decoder(const DecoderHandle& decoder, const l4d_operating_point& point = {}) {
    l4d_decoder* const stream = decoder.get();
    check(l4d_renderer_set_streams(get(), &stream, nullptr, 1, &point));
  }
  // Likewise; shifts: one for each, or empty.
  void set_streams(const std::vector<l4d_decoder*>& decoders, const std::vector<double>& shifts,
                   const l4d_operating_point& point = {}) {
    check(l4d_renderer_set_streams(get(), decoders.data(), shifts.empty() ? nullptr : shifts.data(),
                                   static_cast<uint32_t>(decoders.size()), &point));
  }
  void set_rendering(const l4d_rendering* rendering) {
    check(l4d_renderer_set_rendering(get(), rendering));
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
  l4d_render_stats stats() const {
    l4d_render_stats s = L4D_INIT(l4d_render_stats);
    check(l4d_renderer_get_stats(get(), &s));
    return s;
  }
  void check(l4d_status status) const {
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }

 private:
  struct Destroy {
    void operator()(l4d_renderer* r) const noexcept { l4d_renderer_destroy(r); }
  };
  std::unique_ptr<l4d_renderer, Destroy> handle_;
};

}  // namespace l4d
#endif  // L4D_RENDER_HPP
