// SPDX-License-Identifier: Apache-2.0
#include "render/importance/sensitivity.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <numeric>

#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/sh.h"
#include "render/view/camera.h"

namespace l4d::render {
namespace {

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

int64_t whole_of(double amount, int bits) {
  const double scaled = std::ldexp(amount, bits);
  return scaled < static_cast<double>(kMostWhole) ? static_cast<int64_t>(std::llrint(scaled))
                                                  : kMostWhole;  // NaN too
}
void add_whole(int64_t* sum, int64_t amount) { *sum = std::min(*sum + amount, kMostWhole); }

// Element by element, of arrays of one size or an empty one.
template <typename T, typename Add>
void add_all(const std::vector<T>& from, std::vector<T>* to, const Add& add) {
  if (from.empty()) return;
  to->resize(from.size());
  parallel_for(0, from.size(), kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) add(&(*to)[i], from[i]);
  });
}
void add_double(double* sum, double amount) { *sum += amount; }

// Binary places of number k of a row.
int bits_of(const ImportanceRow& row, size_t k) {
  return k == 0 ? kCoverageBits : k <= row.sh ? kShBits : kGeometryBits;
}

// Sums over all ranks that stay at kMostWhole as if one rank had added all of them up.
Status sum_over(const l4d_process_group& group, std::vector<int64_t>* values) {
  const auto sum = [&group](std::vector<int64_t>* v) {
    return group.sum(group.user, v->data(), v->size()) == 0
               ? Status()
               : Status(L4D_ERR_IO, "the sum over all processes failed");
  };
  if (group.count < 1u << (63 - kWholeBits)) {
    L4D_RETURN_IF_ERROR(sum(values));
    for (int64_t& v : *values) v = std::min(v, kMostWhole);
    return {};
  }
  // So many could pass 2^63: halves of the numbers do not.
  constexpr int kHalf = 32;
  std::vector<int64_t> low(values->size());
  for (size_t i = 0; i < low.size(); ++i) {
    low[i] = (*values)[i] & 0xffffffff;
    (*values)[i] >>= kHalf;
  }
  L4D_RETURN_IF_ERROR(sum(values));
  L4D_RETURN_IF_ERROR(sum(&low));
  for (size_t i = 0; i < low.size(); ++i) {
    const int64_t high = (*values)[i] + (low[i] >> kHalf);
    (*values)[i] = high >= kMostWhole >> kHalf ? kMostWhole : high << kHalf | (low[i] & 0xffffffff);
  }
  return {};
}

}  // namespace

Sensitivity::Sensitivity(const l4d_sensitivity_options& options, size_t count, uint32_t sh_degree,
                         bool fixed_point)
    : options_(options),
      sh_degree_(sh_degree),
      row_(importance_row(options.metric, sh_degree)),
      seen_(count),
      fixed_point_(fixed_point) {}

void Sensitivity::make_host_sums() {
  if (fixed_point_) {
    whole_.resize(count() * row_.width());
    fixed_visible_only_.resize(count());
  } else {
    sums_.resize(count() * row_.width());
    visible_only_.resize(count());
  }
}

Status Sensitivity::check_renderer(const Renderer& renderer) const {
  if (!renderer.has_scene()) {
    return Status(L4D_ERR_INVALID_STATE, "importance needs the scene's Gaussians: set_gaussians");
  }
  if (renderer.scene().count() != count() || renderer.scene().gaussians().sh_degree != sh_degree_) {
    return invalid_argument("the renderer holds a scene of other size or SH degree");
  }
  if (renderer.has_background()) {
    return Status(L4D_ERR_INVALID_STATE, "importance is measured on black: set the background so");
  }
  return {};
}

Status Sensitivity::add_view(Renderer& renderer, const l4d_camera& camera, bool visibility_only,
                             bool wait) {
  L4D_RETURN_IF_ERROR(check_renderer(renderer));
  const uint64_t pixels = uint64_t{camera.width} * camera.height;
  const bool squared = options_.metric == L4D_SENSITIVITY_GAUSS_NEWTON;
  // A sign for every channel: with one for all three, derivatives of the channels would add up
  // before they are squared. A view that is added again has other signs.
  const uint64_t key = view_key(renderer.time(), camera);
  const uint64_t signs = mix(mix(options_.seed) ^ mix(key + (visibility_only ? 0 : repeats_[key])));
  if (renderer.on_device()) {
    if (device_ == nullptr) {
      L4D_RETURN_IF_ERROR(renderer.make_importance(options_.metric, fixed_point_, &device_));
    }
    L4D_RETURN_IF_ERROR(
        renderer.add_importance(camera, squared, signs, visibility_only, device_.get(), wait));
    device_read_ = false;
  } else {
    Renderer::ImportanceInput input;
    if (visibility_only) input.seen = seen_.data();
    input.as_coded = squared && !visibility_only;
    if (input.as_coded) input.signs = &signs;
    L4D_RETURN_IF_ERROR(renderer.importance(camera, input, &items_));
    add_on_host(visibility_only, renderer.threads());
  }
  all_pixels_ += pixels;
  if (!visibility_only) {
    pixels_ += pixels;
    ++repeats_[key];
  }
  return {};
}

void Sensitivity::add_on_host(bool visibility_only, int threads) {
  make_host_sums();
  parallel_for(threads, items_.size(), kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      if (!(items_[i].coverage > 0)) continue;
      if (visibility_only) {
        add_visible_only(items_[i]);
      } else {
        add_item(items_[i]);
      }
    }
  });
}

void Sensitivity::add_visible_only(const Renderer::Importance& item) {
  if (seen_[item.id] != 0) return;
  const double coverage = static_cast<double>(item.coverage);
  // Among ranks, which view comes first depends on who has it: all visibility passes add up.
  if (fixed_point_) {
    add_whole(&fixed_visible_only_[item.id], whole_of(coverage, kCoverageBits));
  } else {
    visible_only_[item.id] += coverage;
    seen_[item.id] = 1;
  }
}

void Sensitivity::add_item(const Renderer::Importance& item) {
  const uint32_t terms = sh_terms(sh_degree_), width = row_.width();
  seen_[item.id] = 1;
  double row[1 + kMaxShTerms + kGeometryNumbers] = {static_cast<double>(item.coverage)};
  float basis[kMaxShTerms];
  sh_basis(sh_degree_, item.direction[0], item.direction[1], item.direction[2], basis);
  double geometry[kGeometryNumbers];
  const Gradient4D<float>& g = item.gradient;
  double* end_of = std::copy_n(g.log_scale, 4, geometry);
  end_of = std::copy_n(g.rotor, 8, end_of);
  end_of = std::copy_n(g.position, 3, end_of);
  *end_of++ = static_cast<double>(g.opacity);
  *end_of = static_cast<double>(g.mean_t);
  if (options_.metric == L4D_SENSITIVITY_GAUSS_NEWTON) {
    // With random signs the channels are three estimates of one square.
    const float* c = item.color;
    const float square = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / 3;
    for (uint32_t k = 0; k < terms; ++k)
      row[1] += static_cast<double>(square * basis[k] * basis[k]);
    for (uint32_t p = 0; p < kNumGeometryParts; ++p) {
      const double* first = geometry + kGeometryParts[p].first;
      row[2 + p] = std::inner_product(first, first + kGeometryParts[p].count, first, 0.0);
    }
  } else {
    for (uint32_t k = 0; k < terms; ++k) {
      row[1 + k] = static_cast<double>(std::fabs(item.color[0] * basis[k]));
    }
    for (uint32_t k = 0; k < kGeometryNumbers; ++k) row[1 + terms + k] = std::fabs(geometry[k]);
  }
  const size_t at = size_t{width} * item.id;
  for (uint32_t k = 0; k < width; ++k) {
    if (fixed_point_) {
      add_whole(&whole_[at + k], whole_of(row[k], bits_of(row_, k)));
    } else {
      sums_[at + k] += row[k];
    }
  }
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
    const bool visible_only = !fixed_visible_only_.empty() && fixed_visible_only_[i] != 0;
    (*out)[i] = (*out)[i] != 0 || seen_[i] != 0 || visible_only ? 1 : 0;
  }
  return {};
}

double Sensitivity::visible_only_unit() { return std::ldexp(1.0, -kCoverageBits); }

Status Sensitivity::visible_only(std::vector<int64_t>* out) const {
  out->clear();
  if (device_ != nullptr) L4D_RETURN_IF_ERROR(device_->read_visible_only(out));
  out->resize(count());
  add_all(fixed_visible_only_, out, add_whole);
  for (size_t i = 0; i < visible_only_.size(); ++i) {
    (*out)[i] += whole_of(visible_only_[i], kCoverageBits);
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
  if (other.device_ != nullptr) {
    if (device_ == nullptr) {
      L4D_RETURN_IF_ERROR(other.device_->clone(&device_));
    } else {
      L4D_RETURN_IF_ERROR(device_->add(*other.device_));
    }
    device_read_ = false;
  }
  for (size_t i = 0; i < seen_.size(); ++i) seen_[i] |= other.seen_[i];
  add_all(other.whole_, &whole_, add_whole);
  add_all(other.fixed_visible_only_, &fixed_visible_only_, add_whole);
  add_all(other.sums_, &sums_, add_double);
  add_all(other.visible_only_, &visible_only_, add_double);
  all_pixels_ += other.all_pixels_;
  pixels_ += other.pixels_;
  for (const auto& [key, times] : other.repeats_) repeats_[key] += times;
  return {};
}

Status Sensitivity::take_from_device() {
  if (device_ == nullptr) return {};
  bool any;
  L4D_RETURN_IF_ERROR(read_device(&any));
  add_all(device_values_.numbers, &whole_, add_whole);
  add_all(device_values_.visible_only, &fixed_visible_only_, add_whole);
  for (size_t i = 0; i < count(); ++i) {
    // What only visibility passes showed counts by its coverage.
    if (device_values_.numbers[row_.width() * i] > 0) seen_[i] = 1;
  }
  device_.reset();
  device_values_ = {};
  device_read_ = false;
  return {};
}

Status Sensitivity::share(const l4d_process_group& group) {
  L4D_RETURN_IF_ERROR(take_from_device());
  if (group.count < 2) return {};
  make_host_sums();  // a rank may have had no view
  L4D_RETURN_IF_ERROR(sum_over(group, &whole_));
  L4D_RETURN_IF_ERROR(sum_over(group, &fixed_visible_only_));
  std::vector<int64_t> rest(seen_.begin(), seen_.end());
  rest.push_back(static_cast<int64_t>(pixels_));
  rest.push_back(static_cast<int64_t>(all_pixels_));
  L4D_RETURN_IF_ERROR(sum_over(group, &rest));
  for (size_t i = 0; i < seen_.size(); ++i) seen_[i] = rest[i] != 0;
  pixels_ = static_cast<uint64_t>(rest[seen_.size()]);
  all_pixels_ = static_cast<uint64_t>(rest[seen_.size() + 1]);
  return {};
}

Status Sensitivity::copy(std::unique_ptr<Sensitivity>* out) const {
  auto made = std::make_unique<Sensitivity>(options_, count(), sh_degree_, fixed_point_);
  L4D_RETURN_IF_ERROR(made->merge(*this));
  L4D_RETURN_IF_ERROR(made->take_from_device());
  *out = std::move(made);
  return {};
}

double Sensitivity::number(size_t gaussian, size_t k) const {
  const size_t at = row_.width() * gaussian + k;
  double sum = sums_.empty() ? 0.0 : sums_[at];
  int64_t whole = whole_.empty() ? 0 : whole_[at];
  if (device_read_) add_whole(&whole, device_values_.numbers[at]);
  if (whole != 0) sum += std::ldexp(static_cast<double>(whole), -bits_of(row_, k));
  return sum;
}

float Sensitivity::light(size_t gaussian) const {
  const double coverage = number(gaussian, 0);
  double visible_only = visible_only_.empty() ? 0.0 : visible_only_[gaussian];
  int64_t whole = fixed_visible_only_.empty() ? 0 : fixed_visible_only_[gaussian];
  bool seen = seen_[gaussian] != 0;
  if (device_read_) {
    add_whole(&whole, device_values_.visible_only[gaussian]);
    seen = seen || device_values_.seen[gaussian] != 0;
  }
  visible_only += std::ldexp(static_cast<double>(whole), -kCoverageBits);
  seen = seen || visible_only > 0;
  const double weight = coverage > 0 ? coverage / static_cast<double>(pixels_)
                                     : visible_only / static_cast<double>(all_pixels_);
  // What is seen at all does not come out as unseen.
  return std::max(static_cast<float>(weight), seen ? FLT_MIN : 0.0f);
}

Status Sensitivity::weights(uint32_t which, float* out) const {
  if (which >= L4D_WEIGHT_COUNT) return invalid_argument("`which` is no L4D_WEIGHT_*");
  if (pixels_ == 0) return Status(L4D_ERR_INVALID_STATE, "no full view has been added");
  bool on_device;
  L4D_RETURN_IF_ERROR(read_device(&on_device));
  const bool squared = options_.metric == L4D_SENSITIVITY_GAUSS_NEWTON;
  // Where its numbers lie in the row, and over how many numbers squares are averaged.
  uint32_t first = 1, numbers = row_.sh, of = sh_terms(sh_degree_);
  for (uint32_t p = 0; p < kNumGeometryParts; ++p) {
    if (kGeometryParts[p].weight != which) continue;
    first = 1 + row_.sh + (squared ? p : kGeometryParts[p].first);
    of = kGeometryParts[p].count;
    numbers = squared ? 1 : of;
  }
  const double pixels = static_cast<double>(pixels_);
  const auto weight = [&](size_t i) {
    if (which == L4D_WEIGHT_ALPHA_T) return light(i);
    if (squared) return static_cast<float>(std::sqrt(number(i, first) / of / pixels));
    double most = 0;
    for (uint32_t k = 0; k < numbers; ++k) most = std::max(most, number(i, first + k));
    return static_cast<float>(most / pixels);
  };
  parallel_for(0, count(), kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) out[i] = weight(i);
  });
  return {};
}

}  // namespace l4d::render
