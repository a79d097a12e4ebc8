// SPDX-License-Identifier: Apache-2.0
#include "render/sensitivity.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <numeric>

#include "libl4dcodec/base/threads.h"
#include "render/sh.h"

namespace l4d::render {
namespace {

constexpr size_t kGrain = 4096;

// A well-mixed hash of a counter (splitmix64's finaliser): signs that depend on seed, view, pixel
// and channel alone.
uint64_t mix(uint64_t x) {
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

// What tells views apart: instant and camera, not when they are added, so that the order of views
// and how they are dealt out to accumulators change no sign.
uint64_t view_key(double time, const l4d_camera& camera) {
  double numbers[19] = {time,
                        static_cast<double>(camera.width),
                        static_cast<double>(camera.height),
                        camera.fx,
                        camera.fy,
                        camera.cx,
                        camera.cy};
  std::copy_n(camera.world_to_camera, 12, numbers + 7);
  uint64_t key = 0;
  for (const double number : numbers) {
    uint64_t bits;
    std::memcpy(&bits, &number, sizeof bits);
    key = mix(key ^ bits);
  }
  return key;
}

// Binary places of whole numbers, as devices have them (cuda/gradient.h).
constexpr int kCoverageBits = 24;
constexpr int kShBits = 30;
constexpr int kGeometryBits = 28;
constexpr int64_t kMostWhole = int64_t{1} << 61;

// What does not fit stays at the largest number.
void add_whole(int64_t* sum, double amount, int bits) {
  const double scaled = std::ldexp(amount, bits);
  const int64_t whole = scaled < 0x1p61 ? static_cast<int64_t>(std::llrint(scaled)) : kMostWhole;
  *sum = std::min(*sum + whole, kMostWhole);
}

}  // namespace

Sensitivity::Sensitivity(const l4d_sensitivity_options& options, size_t count, uint32_t sh_degree,
                         bool whole_numbers)
    : options_(options), sh_degree_(sh_degree), seen_(count), whole_numbers_(whole_numbers) {
  const size_t terms = sh_terms(sh_degree);
  if (whole_numbers) {
    whole_.resize(count * (2 + terms + kGeometry));
    return;
  }
  coverage_.resize(count);
  glimpsed_.resize(count);
  sh_.resize(count * terms);
  geometry_.resize(count * kGeometry);
}

Status Sensitivity::add_view(Renderer& renderer, const l4d_camera& camera, bool seen_only) {
  if (!renderer.has_scene()) {
    return Status(L4D_ERR_INVALID_STATE, "importance needs the scene's Gaussians: set_gaussians");
  }
  if (renderer.scene().count() != count() || renderer.scene().gaussians().sh_degree != sh_degree_) {
    return invalid_argument("the renderer holds a scene of other size or SH degree");
  }
  if (renderer.has_background()) {
    return Status(L4D_ERR_INVALID_STATE, "importance is measured on black: set the background so");
  }
  const uint64_t pixels = uint64_t{camera.width} * camera.height;
  const bool squared = options_.measure == L4D_SENSITIVITY_GAUSS_NEWTON;
  // A sign for every channel: with one for all three, derivatives of the channels would add up
  // before they are squared. A view that is added again has other signs.
  const uint64_t key = view_key(renderer.time(), camera);
  const uint64_t signs = mix(mix(options_.seed) ^ mix(key + (seen_only ? 0 : repeats_[key])));
  if (renderer.on_device()) {
    if (device_ == nullptr) L4D_RETURN_IF_ERROR(renderer.make_importance(whole_numbers_, &device_));
    L4D_RETURN_IF_ERROR(renderer.add_importance(camera, squared, signs, seen_only, device_.get()));
    device_read_ = false;
    all_pixels_ += pixels;
    if (!seen_only) {
      pixels_ += pixels;
      ++repeats_[key];
    }
    return {};
  }
  Renderer::ImportanceInput input;
  if (seen_only) input.seen = seen_.data();
  if (squared && !seen_only && camera.width <= 16384 && camera.height <= 16384) {
    signs_.resize(static_cast<size_t>(3 * pixels));
    parallel_for(renderer.threads(), static_cast<size_t>(pixels), kGrain,
                 [&](size_t begin, size_t end) {
                   for (size_t p = begin; p < end; ++p) {
                     const uint64_t bits = mix(signs + p);
                     for (size_t c = 0; c < 3; ++c) {
                       signs_[3 * p + c] = (bits >> c & 1) != 0 ? 1.0f : -1.0f;
                     }
                   }
                 });
    input.rgb_gradient = signs_.data();
    input.as_coded = true;
  }
  L4D_RETURN_IF_ERROR(renderer.importance(camera, input, &items_));
  const size_t terms = sh_terms(sh_degree_);
  const size_t n = count();
  // At a place of one of the arrays of floats, or behind `first` of the whole numbers.
  const auto add = [this, squared](std::vector<float>& sums, size_t first, int bits, size_t at,
                                   float derivative) {
    const float amount = squared ? derivative * derivative : std::fabs(derivative);
    if (whole_numbers_) {
      add_whole(&whole_[first + at], static_cast<double>(amount), bits);
    } else {
      sums[at] += amount;
    }
  };
  const auto add_coverage = [this](std::vector<double>& sums, size_t first, size_t at,
                                   double amount) {
    if (whole_numbers_) {
      add_whole(&whole_[first + at], amount, kCoverageBits);
    } else {
      sums[at] += amount;
    }
  };
  parallel_for(renderer.threads(), items_.size(), kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const Renderer::Importance& item = items_[i];
      if (!(item.coverage > 0)) continue;
      if (seen_only) {
        if (seen_[item.id] == 0)
          add_coverage(glimpsed_, n, item.id, static_cast<double>(item.coverage));
        // Among ranks, which view comes first depends on who has it: all that glimpse add up.
        if (!whole_numbers_) seen_[item.id] = 1;
        continue;
      }
      add_coverage(coverage_, 0, item.id, static_cast<double>(item.coverage));
      seen_[item.id] = 1;
      float basis[kMaxShTerms];
      sh_basis(sh_degree_, item.direction[0], item.direction[1], item.direction[2], basis);
      // The channels have one derivative, or, with random signs, three estimates of its square.
      float color = item.color[0];
      if (squared) {
        const float* c = item.color;
        color = std::sqrt((c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / 3);
      }
      for (size_t k = 0; k < terms; ++k) {
        add(sh_, 2 * n, kShBits, terms * item.id + k, color * basis[k]);
      }
      const auto add_geometry = [&](size_t k, float derivative) {
        add(geometry_, (2 + terms) * n, kGeometryBits, kGeometry * item.id + k, derivative);
      };
      for (size_t k = 0; k < 4; ++k) add_geometry(k, item.gradient.log_scale[k]);
      for (size_t k = 0; k < 8; ++k) add_geometry(4 + k, item.gradient.rotor[k]);
      for (size_t k = 0; k < 3; ++k) add_geometry(12 + k, item.gradient.position[k]);
      add_geometry(15, item.gradient.opacity);
      add_geometry(16, item.gradient.mean_t);
    }
  });
  all_pixels_ += pixels;
  if (!seen_only) {
    pixels_ += pixels;
    ++repeats_[key];
  }
  return {};
}

Status Sensitivity::read_device(bool* any) const {
  *any = device_ != nullptr;
  if (device_ == nullptr || device_read_) return {};
  L4D_RETURN_IF_ERROR(device_->read(&device_values_));
  device_read_ = true;
  return {};
}

Status Sensitivity::seen(std::vector<uint8_t>* out) const {
  out->clear();
  if (device_ != nullptr) L4D_RETURN_IF_ERROR(device_->read_seen(out));
  out->resize(count());
  for (size_t i = 0; i < count(); ++i) {
    const bool glimpsed = whole_numbers_ && whole_[count() + i] != 0;
    (*out)[i] = (*out)[i] != 0 || seen_[i] != 0 || glimpsed ? 1 : 0;
  }
  return {};
}

double Sensitivity::glimpse_unit() { return std::ldexp(1.0, -kCoverageBits); }

Status Sensitivity::glimpsed(std::vector<int64_t>* out) const {
  static_assert(kCoverageBits == 24, "the unit of devices");
  out->clear();
  if (device_ != nullptr) L4D_RETURN_IF_ERROR(device_->read_glimpsed(out));
  out->resize(count());
  for (size_t i = 0; i < count(); ++i) {
    (*out)[i] += whole_numbers_ ? whole_[count() + i]
                                : std::llround(std::ldexp(glimpsed_[i], kCoverageBits));
  }
  return {};
}

Status Sensitivity::count_unseen(uint64_t* out) const {
  std::vector<uint8_t> flags;
  L4D_RETURN_IF_ERROR(seen(&flags));
  *out = static_cast<uint64_t>(std::count(flags.begin(), flags.end(), 0));
  return {};
}

Status Sensitivity::merge(const Sensitivity& other) {
  if (other.count() != count() || other.sh_degree_ != sh_degree_ ||
      other.options_.measure != options_.measure || other.whole_numbers_ != whole_numbers_) {
    return invalid_argument("the accumulators are for different scenes or measures");
  }
  if (other.device_ != nullptr) {
    if (device_ == nullptr) {
      L4D_RETURN_IF_ERROR(other.device_->clone(&device_));
    } else {
      L4D_RETURN_IF_ERROR(device_->add(*other.device_));
    }
    device_read_ = false;
  }
  for (size_t i = 0; i < seen_.size(); ++i) seen_[i] |= other.seen_[i];
  for (size_t i = 0; i < whole_.size(); ++i)
    whole_[i] = std::min(whole_[i] + other.whole_[i], kMostWhole);
  for (size_t i = 0; i < coverage_.size(); ++i) {
    coverage_[i] += other.coverage_[i];
    glimpsed_[i] += other.glimpsed_[i];
  }
  for (size_t i = 0; i < sh_.size(); ++i) sh_[i] += other.sh_[i];
  for (size_t i = 0; i < geometry_.size(); ++i) geometry_[i] += other.geometry_[i];
  all_pixels_ += other.all_pixels_;
  pixels_ += other.pixels_;
  for (const auto& [key, times] : other.repeats_) repeats_[key] += times;
  return {};
}

Status Sensitivity::take_from_device() {
  if (device_ == nullptr) return {};
  bool any;
  L4D_RETURN_IF_ERROR(read_device(&any));
  const size_t n = count(), terms = sh_terms(sh_degree_);
  const auto take = [this](const std::vector<double>& values, size_t first, int bits) {
    for (size_t i = 0; i < values.size(); ++i) add_whole(&whole_[first + i], values[i], bits);
  };
  take(device_values_.coverage, 0, kCoverageBits);
  take(device_values_.glimpsed, n, kCoverageBits);
  take(device_values_.sh, 2 * n, kShBits);
  take(device_values_.geometry, (2 + terms) * n, kGeometryBits);
  for (size_t i = 0; i < n; ++i) {
    // What was only glimpsed is told by its coverage.
    if (device_values_.coverage[i] > 0) seen_[i] = 1;
  }
  device_.reset();
  device_read_ = false;
  return {};
}

Status Sensitivity::share(const l4d_ranks& ranks) {
  L4D_RETURN_IF_ERROR(take_from_device());
  if (ranks.count < 2) return {};
  const auto sum = [&ranks](std::vector<int64_t>& values) {
    return ranks.sum(ranks.user, values.data(), values.size()) == 0
               ? Status()
               : Status(L4D_ERR_IO, "adding up sums of all ranks failed");
  };
  // Each of them has that much room, whatever the others have.
  for (int64_t& v : whole_) v = std::min(v, kMostWhole / static_cast<int64_t>(ranks.count));
  L4D_RETURN_IF_ERROR(sum(whole_));
  std::vector<int64_t> rest(seen_.begin(), seen_.end());
  rest.push_back(static_cast<int64_t>(pixels_));
  rest.push_back(static_cast<int64_t>(all_pixels_));
  L4D_RETURN_IF_ERROR(sum(rest));
  for (size_t i = 0; i < seen_.size(); ++i) seen_[i] = rest[i] != 0;
  pixels_ = static_cast<uint64_t>(rest[seen_.size()]);
  all_pixels_ = static_cast<uint64_t>(rest[seen_.size() + 1]);
  return {};
}

Status Sensitivity::copy(std::unique_ptr<Sensitivity>* out) const {
  auto made = std::make_unique<Sensitivity>(options_, count(), sh_degree_, whole_numbers_);
  L4D_RETURN_IF_ERROR(made->merge(*this));
  L4D_RETURN_IF_ERROR(made->take_from_device());
  *out = std::move(made);
  return {};
}

Status Sensitivity::weights(uint32_t which, float* out) const {
  if (which >= L4D_WEIGHT_COUNT) return invalid_argument("`which` is no L4D_WEIGHT_*");
  if (pixels_ == 0) return Status(L4D_ERR_INVALID_STATE, "no full view has been added");
  bool on_device;
  L4D_RETURN_IF_ERROR(read_device(&on_device));
  if (which == L4D_WEIGHT_ALPHA_T) {
    for (size_t i = 0; i < count(); ++i) {
      double coverage = 0, glimpsed = 0;
      if (whole_numbers_) {
        coverage = std::ldexp(static_cast<double>(whole_[i]), -kCoverageBits);
        glimpsed = std::ldexp(static_cast<double>(whole_[count() + i]), -kCoverageBits);
      } else {
        coverage = coverage_[i];
        glimpsed = glimpsed_[i];
      }
      bool seen = seen_[i] != 0 || glimpsed > 0;
      if (on_device) {
        coverage += device_values_.coverage[i];
        glimpsed += device_values_.glimpsed[i];
        seen = seen || device_values_.seen[i] != 0;
      }
      const double weight = coverage > 0 ? coverage / static_cast<double>(pixels_)
                                         : glimpsed / static_cast<double>(all_pixels_);
      // What is seen at all does not come out as unseen.
      out[i] = std::max(static_cast<float>(weight), seen ? FLT_MIN : 0.0f);
    }
    return {};
  }
  struct Part {
    size_t first, count;  // of the numbers in geometry_
  };
  constexpr Part kParts[L4D_WEIGHT_COUNT] = {{}, {0, 4},  {4, 4},  {8, 4},
                                             {}, {12, 3}, {15, 1}, {16, 1}};
  const bool is_sh = which == L4D_WEIGHT_SH;
  const size_t stride = is_sh ? sh_terms(sh_degree_) : kGeometry;
  const Part part = is_sh ? Part{0, stride} : kParts[which];
  const double pixels = static_cast<double>(pixels_);
  const size_t base = (is_sh ? 2 : 2 + sh_terms(sh_degree_)) * count();  // among whole numbers
  const double unit = std::ldexp(1.0, is_sh ? -kShBits : -kGeometryBits);
  parallel_for(0, count(), kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const size_t first = stride * i + part.first;
      double sums[kGeometry] = {};  // more than there are SH terms
      for (size_t k = 0; k < part.count; ++k) {
        sums[k] = whole_numbers_ ? static_cast<double>(whole_[base + first + k]) * unit
                                 : static_cast<double>((is_sh ? sh_ : geometry_)[first + k]);
        if (on_device) sums[k] += (is_sh ? device_values_.sh : device_values_.geometry)[first + k];
      }
      if (options_.measure == L4D_SENSITIVITY_GAUSS_NEWTON) {
        const double sum = std::accumulate(sums, sums + part.count, 0.0);
        out[i] = static_cast<float>(std::sqrt(sum / static_cast<double>(part.count) / pixels));
      } else {
        out[i] = static_cast<float>(*std::max_element(sums, sums + part.count) / pixels);
      }
    }
  });
  return {};
}

}  // namespace l4d::render
