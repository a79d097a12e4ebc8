// SPDX-License-Identifier: Apache-2.0
#include "eval/opacity_fit.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "eval/errors.h"
#include "eval/motion.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::eval {
namespace {

// Below this contrast, of a Gaussian in front of its like, steps would be all rounding.
constexpr float kLeastContrast = 1e-3f;
constexpr float kMostContrast = 3.0f;  // from black to white
// What a step may do to an opacity, and all of them together.
constexpr float kMostDecrease = 0.5f, kMostIncrease = 3.0f;
constexpr float kLeastRatio = 0.1f;
constexpr float kMostOpacity = 0.999f;

// Renders `scene` in all views of the meter. Calls visit(view, image, differentiate), where
// differentiate(image, gradients) is the backward pass of the view; the image may be changed.
template <typename Visit>
void for_each_view(const Rendering& rendering, FidelityMeter& meter, const io::Scene& scene,
                   Observer& observer, const Visit& visit) {
  about("the views of the fit", [&] {
    RendererHandle renderer(&rendering.renderer);
    renderer.set_rendering(&scene.rendering);
    renderer.set_gaussians(scene.view(), scene.timeline);
    const CameraViews& views = meter.views();
    io::Image image;
    for (size_t k = 0; k < views.views.size(); ++k) {
      observer.check();
      observer.update(k, views.views.size(), "fitting opacities");
      const double time = views.views[k].time;
      if (k == 0 || views.views[k - 1].time != time) renderer.set_time(time);
      const l4d_camera& camera = views.camera_of(k).camera;
      if (image.width != camera.width || image.height != camera.height) {
        image = io::Image(camera.width, camera.height);
      }
      renderer.render(camera, image.rgb.data());
      visit(k, image, [&](const io::Image& by_pixel, l4d_gradients* gradients) {
        renderer.check(
            l4d_renderer_backward(renderer.get(), &camera, by_pixel.rgb.data(), gradients));
      });
    }
  });
}

l4d_gradients gradients_of(const io::Scene& scene) {
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  gradients.count = scene.count();
  return gradients;
}

}  // namespace

OpacityFit::OpacityFit(const Rendering& rendering, FidelityMeter& whole, io::Scene part,
                       const std::vector<float>& contrast, Observer& observer)
    : rendering_(rendering), whole_(whole), part_(std::move(part)) {
  given_.resize(part_.count());
  for (size_t i = 0; i < part_.count(); ++i) {
    given_[i] = static_cast<float>(linear_opacity(part_, i));
  }
  part_.flags &= ~static_cast<uint32_t>(L4D_OPACITY_LOGIT);
  part_.opacity = given_;
  ratio_.assign(part_.count(), 1.0f);
  before_ = ratio_;
  weigh(contrast, observer);
}

// A Gaussian changes a pixel by alpha T times its contrast to what lies behind it, and all
// Gaussians of the pixel together by no more than the sum of these. Colours that are the squared
// contrasts make an image of that sum; its product with alpha T is the derivative by the colour.
void OpacityFit::weigh(const std::vector<float>& contrast, Observer& observer) {
  constexpr float kPerColor = static_cast<float>(sh_constant::k0);
  io::Scene scene = part_;
  scene.sh_degree = 0;
  scene.sh.resize(3 * scene.count());
  for (size_t i = 0; i < scene.count(); ++i) {
    const float color = std::clamp(contrast[i], kLeastContrast, kMostContrast);
    std::fill_n(scene.sh.data() + 3 * i, 3, (color - 0.5f) / kPerColor);
  }
  std::vector<float> by_color(3 * scene.count(), 0.0f);
  l4d_gradients gradients = gradients_of(scene);
  gradients.sh = by_color.data();
  for_each_view(rendering_, whole_, scene, observer,
                [&](size_t, const io::Image& image, const auto& differentiate) {
                  differentiate(image, &gradients);
                });
  light_.resize(scene.count());
  for (size_t i = 0; i < scene.count(); ++i) {
    const float sum = by_color[3 * i] + by_color[3 * i + 1] + by_color[3 * i + 2];
    light_[i] = contrast[i] < 0 ? 0 : sum / (3 * kPerColor);
  }
}

void OpacityFit::set_ratios(const std::vector<float>& ratio) {
  for (size_t i = 0; i < given_.size(); ++i) part_.opacity[i] = given_[i] * ratio[i];
}

double OpacityFit::differentiate(std::vector<float>* gradient, Observer& observer) {
  gradient->assign(part_.count(), 0.0f);
  l4d_gradients gradients = gradients_of(part_);
  gradients.opacity = gradient->data();
  double error = 0;
  for_each_view(rendering_, whole_, part_, observer,
                [&](size_t view, io::Image& image, const auto& differentiate) {
                  const io::Image& whole = whole_.original(view);
                  double sum = 0;
                  for (size_t k = 0; k < image.rgb.size(); ++k) {
                    const float off = image.rgb[k] - whole.rgb[k];
                    sum += static_cast<double>(off) * static_cast<double>(off);
                    image.rgb[k] = off;
                  }
                  error += sum;
                  differentiate(image, &gradients);
                });
  for (size_t i = 0; i < given_.size(); ++i) (*gradient)[i] *= given_[i];
  return error;
}

float OpacityFit::within(size_t i, float ratio) const {
  const float most = std::max(1.0f, kMostOpacity / std::max(given_[i], 1e-6f));
  return std::clamp(ratio, kLeastRatio, most);
}

void OpacityFit::step(Observer& observer) {
  const double next_momentum = 0.5 * (1 + std::sqrt(1 + 4 * momentum_ * momentum_));
  const float carried = static_cast<float>((momentum_ - 1) / next_momentum);
  std::vector<float> at = ratio_, gradient;
  for (size_t i = 0; i < at.size(); ++i) {
    if (light_[i] > 0) at[i] = within(i, ratio_[i] + carried * (ratio_[i] - before_[i]));
  }
  set_ratios(at);
  const double error = differentiate(&gradient, observer);
  momentum_ = next_momentum;
  if (least_error_ < 0 || error < least_error_) {
    least_error_ = error;
    best_ = std::move(at);
    best_gradient_ = std::move(gradient);
  } else {
    // Too far: a shorter step from where it was best.
    damping_ /= 2;
    momentum_ = 1;
    ratio_ = best_;
  }
  before_ = ratio_;
  double uphill = 0;
  for (size_t i = 0; i < ratio_.size(); ++i) {
    if (!(light_[i] > 0)) continue;
    const float from = best_[i];
    const float move = std::clamp(-damping_ * best_gradient_[i] / light_[i], -kMostDecrease * from,
                                  kMostIncrease * from);
    ratio_[i] = within(i, from + move);
    uphill += static_cast<double>(best_gradient_[i]) * static_cast<double>(ratio_[i] - before_[i]);
  }
  if (uphill > 0) momentum_ = 1;
  set_ratios(ratio_);
}

}  // namespace l4d::eval
