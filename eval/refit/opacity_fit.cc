// SPDX-License-Identifier: Apache-2.0
#include "eval/refit/opacity_fit.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "eval/errors.h"
#include "eval/scene/motion.h"
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

// Smaller subsets move more often; in larger ones each Gaussian is seen by more views.
constexpr size_t kSubsetViews = 9, kMostSubsets = 64;
// Of the mean light of a Gaussian, added to that of a subset: one that sees it at the edge of an
// image moves it little.
constexpr float kMeanLight = 0.3f;
constexpr float kMomentum = 0.5f;
// Steps of pass k are shortened to 1 / (1 + k kShortening): what subsets disagree about averages.
constexpr double kShortening = 0.3;

size_t subsets_of(size_t num_views) {
  return std::clamp<size_t>(num_views / kSubsetViews, 1, kMostSubsets);
}

// Renders `scene` in the views of a subset: every num_subsets-th of the meter, which are in the
// order of time. Calls visit(view, image, differentiate), where differentiate(image, gradients) is
// the backward pass of the view; the image may be changed.
template <typename Visit>
void for_each_view(RendererHandle& renderer, const CameraViews& views, size_t subset,
                   size_t num_subsets, Observer& observer, const Visit& visit) {
  about("the views of the fit", [&] {
    io::Image image;
    std::optional<double> shown;
    for (size_t k = subset; k < views.views.size(); k += num_subsets) {
      observer.check();
      observer.update(k / num_subsets + subset * views.views.size() / num_subsets,
                      views.views.size(), "fitting opacities");
      const double time = views.views[k].time;
      if (shown != time) renderer.set_time(time);
      shown = time;
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

RendererHandle renderer_of(const Rendering& rendering, const io::Scene& scene) {
  RendererHandle renderer(&rendering.renderer);
  renderer.set_rendering(&scene.rendering);
  renderer.set_gaussians(scene.view(), scene.timeline);
  return renderer;
}

l4d_gradients gradients_of(const io::Scene& scene) {
  l4d_gradients gradients = L4D_INIT(l4d_gradients);
  gradients.count = scene.count();
  return gradients;
}

}  // namespace

// A Gaussian changes a pixel by alpha T times its contrast to what lies behind it, and all
// Gaussians of the pixel together by no more than the sum of these. Colours that are the squared
// contrasts make an image of that sum; its product with alpha T is the derivative by the colour.
SharedLight shared_light(const Rendering& rendering, const CameraViews& views,
                         const io::Scene& given, const std::vector<float>& contrast,
                         Observer& observer) {
  constexpr float kPerColor = static_cast<float>(sh_constant::k0);
  io::Scene scene = given;
  scene.sh_degree = 0;
  scene.sh.resize(3 * scene.count());
  for (size_t i = 0; i < scene.count(); ++i) {
    const float color = std::clamp(contrast[i], kLeastContrast, kMostContrast);
    std::fill_n(scene.sh.data() + 3 * i, 3, (color - 0.5f) / kPerColor);
  }
  RendererHandle renderer = renderer_of(rendering, scene);
  std::vector<float> by_color(3 * scene.count());
  l4d_gradients gradients = gradients_of(scene);
  gradients.sh = by_color.data();
  SharedLight light;
  light.of_subset.resize(subsets_of(views.views.size()));
  light.mean.assign(scene.count(), 0.0f);
  for (size_t s = 0; s < light.of_subset.size(); ++s) {
    std::fill(by_color.begin(), by_color.end(), 0.0f);
    for_each_view(renderer, views, s, light.of_subset.size(), observer,
                  [&](size_t, const io::Image& image, const auto& differentiate) {
                    differentiate(image, &gradients);
                  });
    std::vector<float>& own = light.of_subset[s];
    own.resize(scene.count());
    for (size_t i = 0; i < scene.count(); ++i) {
      const float sum = by_color[3 * i] + by_color[3 * i + 1] + by_color[3 * i + 2];
      own[i] = contrast[i] < 0 ? 0 : sum / (3 * kPerColor);
      light.mean[i] += own[i] / static_cast<float>(light.of_subset.size());
    }
  }
  return light;
}

OpacityFit::OpacityFit(const Rendering& rendering, FidelityMeter& whole, const io::Scene& scene,
                       const SharedLight& light, const std::vector<uint8_t>& kept,
                       const std::vector<float>& ratio)
    : rendering_(rendering), whole_(whole), light_(light), part_(scene) {
  part_.keep(kept);
  part_.flags &= ~static_cast<uint32_t>(L4D_OPACITY_LOGIT);
  part_.opacity.resize(part_.count());
  for (size_t i = 0; i < kept.size(); ++i) {
    if (kept[i] == 0) continue;
    part_.opacity[source_.size()] = static_cast<float>(linear_opacity(scene, i)) * ratio[i];
    given_.push_back(static_cast<float>(linear_opacity(scene, i)));
    ratio_.push_back(ratio[i]);
    source_.push_back(static_cast<uint32_t>(i));
  }
  moved_.assign(part_.count(), 0.0f);
}

double OpacityFit::differentiate(size_t subset, std::vector<float>* gradient, Observer& observer) {
  gradient->assign(part_.count(), 0.0f);
  l4d_gradients gradients = gradients_of(part_);
  gradients.opacity = gradient->data();
  double error = 0;
  RendererHandle renderer = renderer_of(rendering_, part_);
  for_each_view(renderer, whole_.views(), subset, num_subsets(), observer,
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

void OpacityFit::move(size_t subset, const std::vector<float>& gradient) {
  const float step = static_cast<float>(damping_ / (1 + kShortening * passes_));
  for (size_t i = 0; i < ratio_.size(); ++i) {
    const float light = light_.of_subset[subset][source_[i]];
    if (!(light > 0)) continue;
    const float from = ratio_[i];
    const float by = std::clamp(
        kMomentum * moved_[i] - step * gradient[i] / (light + kMeanLight * light_.mean[source_[i]]),
        -kMostDecrease * from, kMostIncrease * from);
    const float most = std::max(1.0f, kMostOpacity / std::max(given_[i], 1e-6f));
    ratio_[i] = std::clamp(from + by, kLeastRatio, most);
    moved_[i] = ratio_[i] - from;
    part_.opacity[i] = given_[i] * ratio_[i];
  }
}

void OpacityFit::pass(Observer& observer) {
  // Subsets that follow one another are far apart in time and among cameras.
  const size_t stride = golden_stride(num_subsets());
  double error = 0;
  std::vector<float> gradient;
  for (size_t n = 0; n < num_subsets(); ++n) {
    const size_t subset = (n * stride + passes_) % num_subsets();
    error += differentiate(subset, &gradient, observer);
    move(subset, gradient);
  }
  if (error_ >= 0 && error > error_) damping_ /= 2;
  error_ = error;
  ++passes_;
}

}  // namespace l4d::eval
