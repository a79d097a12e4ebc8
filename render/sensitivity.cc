// SPDX-License-Identifier: Apache-2.0
#include "render/sensitivity.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "libl4dcodec/base/threads.h"
#include "render/sh.h"

namespace l4d::render {
namespace {

constexpr size_t kGrain = 4096;

// A well-mixed hash of a counter (splitmix64's finaliser): signs that depend on seed, view and pixel
// alone.
uint64_t mix(uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

}  // namespace

Sensitivity::Sensitivity(const l4d_sensitivity_options& options, size_t count, uint32_t sh_degree)
    : options_(options),
      sh_degree_(sh_degree),
      coverage_(count),
      glimpsed_(count),
      seen_(count),
      sh_(count * sh_terms(sh_degree)),
      geometry_(count * kGeometry) {}

Status Sensitivity::add_view(Renderer& renderer, const l4d_camera& camera, bool seen_only) {
  if (!renderer.has_scene()) {
    return Status(L4D_ERR_INVALID_STATE, "importance needs the scene's Gaussians: set_gaussians");
  }
  if (renderer.scene().count() != count() ||
      renderer.scene().gaussians().sh_degree != sh_degree_) {
    return invalid_argument("the renderer holds a scene of other size or SH degree");
  }
  if (renderer.has_background()) {
    return Status(L4D_ERR_INVALID_STATE, "importance is measured on black: set the background so");
  }
  const uint64_t pixels = uint64_t{camera.width} * camera.height;
  const bool squared = options_.measure == L4D_SENSITIVITY_GAUSS_NEWTON;
  const float* signs = nullptr;
  if (squared && !seen_only && camera.width <= 16384 && camera.height <= 16384) {
    signs_.resize(static_cast<size_t>(pixels));
    const uint64_t base = mix(mix(options_.seed) + views_);
    for (size_t p = 0; p < signs_.size(); ++p) signs_[p] = (mix(base + p) & 1) != 0 ? 1.0f : -1.0f;
    signs = signs_.data();
  }
  L4D_RETURN_IF_ERROR(renderer.importance(camera, seen_only ? seen_.data() : nullptr, signs, &items_));
  const size_t terms = sh_terms(sh_degree_);
  const auto add = [squared](float* sum, float derivative) {
    *sum += squared ? derivative * derivative : std::fabs(derivative);
  };
  parallel_for(renderer.threads(), items_.size(), kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const Renderer::Importance& item = items_[i];
      if (!(item.coverage > 0)) continue;
      if (seen_only) {
        glimpsed_[item.id] += seen_[item.id] == 0 ? static_cast<double>(item.coverage) : 0.0;
        seen_[item.id] = 1;
        continue;
      }
      coverage_[item.id] += static_cast<double>(item.coverage);
      seen_[item.id] = 1;
      float basis[kMaxShTerms];
      sh_basis(sh_degree_, item.direction[0], item.direction[1], item.direction[2], basis);
      float* sh = sh_.data() + terms * item.id;
      for (size_t k = 0; k < terms; ++k) add(sh + k, item.color * basis[k]);
      float* geometry = geometry_.data() + kGeometry * item.id;
      for (size_t k = 0; k < 4; ++k) add(geometry + k, item.gradient.log_scale[k]);
      for (size_t k = 0; k < 8; ++k) add(geometry + 4 + k, item.gradient.rotor[k]);
    }
  });
  all_pixels_ += pixels;
  if (!seen_only) {
    pixels_ += pixels;
    ++views_;
  }
  return {};
}

size_t Sensitivity::num_unseen() const {
  return static_cast<size_t>(std::count(seen_.begin(), seen_.end(), uint8_t{0}));
}

Status Sensitivity::merge(const Sensitivity& other) {
  if (other.count() != count() || other.sh_degree_ != sh_degree_ ||
      other.options_.measure != options_.measure) {
    return invalid_argument("the accumulators are for different scenes or measures");
  }
  for (size_t i = 0; i < coverage_.size(); ++i) {
    coverage_[i] += other.coverage_[i];
    glimpsed_[i] += other.glimpsed_[i];
    seen_[i] |= other.seen_[i];
  }
  for (size_t i = 0; i < sh_.size(); ++i) sh_[i] += other.sh_[i];
  for (size_t i = 0; i < geometry_.size(); ++i) geometry_[i] += other.geometry_[i];
  all_pixels_ += other.all_pixels_;
  pixels_ += other.pixels_;
  views_ += other.views_;
  return {};
}

Status Sensitivity::weights(uint32_t which, float* out) const {
  if (which >= L4D_WEIGHT_COUNT) return invalid_argument("`which` is no L4D_WEIGHT_*");
  if (pixels_ == 0) return Status(L4D_ERR_INVALID_STATE, "no full view has been added");
  if (which == L4D_WEIGHT_ALPHA_T) {
    for (size_t i = 0; i < count(); ++i) {
      const double weight = coverage_[i] > 0
                                ? coverage_[i] / static_cast<double>(pixels_)
                                : glimpsed_[i] / static_cast<double>(all_pixels_);
      // What is seen at all does not come out as unseen.
      out[i] = std::max(static_cast<float>(weight), seen_[i] != 0 ? FLT_MIN : 0.0f);
    }
    return {};
  }
  struct Part {
    const std::vector<float>* sums;
    size_t stride, first, count;
  };
  const size_t terms = sh_terms(sh_degree_);
  const Part part = which == L4D_WEIGHT_SH              ? Part{&sh_, terms, 0, terms}
                    : which == L4D_WEIGHT_SCALE         ? Part{&geometry_, kGeometry, 0, 4}
                    : which == L4D_WEIGHT_ROTOR_SPATIAL ? Part{&geometry_, kGeometry, 4, 4}
                                                        : Part{&geometry_, kGeometry, 8, 4};
  const bool squared = options_.measure == L4D_SENSITIVITY_GAUSS_NEWTON;
  for (size_t i = 0; i < count(); ++i) {
    const float* sums = part.sums->data() + part.stride * i + part.first;
    const float most = *std::max_element(sums, sums + part.count);
    const double total = squared ? std::sqrt(static_cast<double>(most)) : static_cast<double>(most);
    out[i] = static_cast<float>(total / static_cast<double>(pixels_));
  }
  return {};
}

}  // namespace l4d::render
