// SPDX-License-Identifier: Apache-2.0
#include "render/cpu/reference.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <vector>

#include "render/frame/importance_numbers.h"

namespace l4d::render {
namespace {

// Charges the time since it was made, or last asked, to stages.
class Clock {
 public:
  explicit Clock(Stats* stats) : stats_(stats) {}
  void charge(int stage) {
    const auto now = std::chrono::steady_clock::now();
    if (stats_ != nullptr) {
      stats_->seconds[stage] = std::chrono::duration<double>(now - last_).count();
    }
    last_ = now;
  }

 private:
  Stats* stats_;
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

struct Item {
  size_t index;  // in the frame
  Splat<double> splat;
};

// The splats of a view, nearest first.
std::vector<Item> sorted_splats(const Frame<double>& frame, const View<double>& view, Stats* stats,
                                Clock* clock) {
  std::vector<Item> items;
  items.reserve(frame.count());
  for (size_t i = 0; i < frame.count(); ++i) {
    Item item{i, {}};
    if (!project(view, frame, i, &item.splat)) continue;
    shade(view, frame, i, &item.splat);
    items.push_back(item);
  }
  if (stats != nullptr) {
    stats->projected = items.size();
    stats->instances = 0;
    stats->seconds[L4D_RENDER_PASS_BIN] = 0;
    stats->seconds[L4D_RENDER_PASS_BACKWARD] = 0;
  }
  clock->charge(L4D_RENDER_PASS_PROJECT);
  std::stable_sort(items.begin(), items.end(),
                   [](const Item& a, const Item& b) { return a.splat.depth < b.splat.depth; });
  clock->charge(L4D_RENDER_PASS_SORT);
  return items;
}

size_t num_pixels(const View<double>& view) {
  return static_cast<size_t>(view.width) * static_cast<size_t>(view.height);
}

// A splat where it is blended into a pixel.
struct Fragment {
  size_t pixel;
  double dx, dy;  // from the mean to the pixel's centre
  double alpha;
  bool cut;              // alpha is max_alpha, whatever the splat says
  double transmittance;  // of all that lies before
};

// Indices of the pixels whose centres lie in mean +- extent: [*first, *last).
void pixel_range(double mean, double extent, int size, int* first, int* last) {
  const double end = size;
  *first = static_cast<int>(std::clamp(std::ceil(mean - extent - 0.5), 0.0, end));
  *last = static_cast<int>(std::clamp(std::floor(mean + extent - 0.5) + 1, 0.0, end));
}

// Calls visit(item, fragment) for all that is blended, front to back, and returns the transmittance
// that is left of each pixel.
template <typename Visit>
std::vector<double> blend(const View<double>& view, const std::vector<Item>& items, Visit visit) {
  std::vector<double> transmittance(num_pixels(view), 1.0);
  std::vector<bool> done(num_pixels(view), false);
  for (const Item& item : items) {
    const Splat<double>& s = item.splat;
    int x0, x1, y0, y1;
    pixel_range(s.mean[0], s.extent[0], view.width, &x0, &x1);
    pixel_range(s.mean[1], s.extent[1], view.height, &y0, &y1);
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        Fragment f;
        f.pixel = static_cast<size_t>(y) * static_cast<size_t>(view.width) + static_cast<size_t>(x);
        if (done[f.pixel]) continue;
        f.dx = x + 0.5 - s.mean[0];
        f.dy = y + 0.5 - s.mean[1];
        const double q =
            s.conic[0] * f.dx * f.dx + 2 * s.conic[1] * f.dx * f.dy + s.conic[2] * f.dy * f.dy;
        if (q > view.rules.max_reach) continue;
        f.alpha = s.opacity * std::exp(-q / 2);
        f.cut = f.alpha > view.rules.max_alpha;
        if (f.cut) f.alpha = view.rules.max_alpha;
        if (f.alpha < view.rules.min_alpha) continue;
        f.transmittance = transmittance[f.pixel];
        const double left = f.transmittance * (1 - f.alpha);
        if (left < kMinTransmittance) {
          done[f.pixel] = true;
          continue;
        }
        visit(item, f);
        transmittance[f.pixel] = left;
      }
    }
  }
  return transmittance;
}

// Derivative of the scalar by the three channels of a pixel.
void upstream(const BackwardInput& input, size_t pixel, double* g /* [3] */) {
  const uint64_t bits = input.signs != nullptr ? mix(*input.signs + pixel) : 0;
  for (int c = 0; c < 3; ++c) {
    const float* given = input.rgb_gradient;
    g[c] = given != nullptr         ? static_cast<double>(given[3 * pixel + static_cast<size_t>(c)])
           : input.signs != nullptr ? static_cast<double>(sign_of(bits, c))
                                    : 1;
  }
}

double dot3(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void add_alpha_gradient(const Splat<double>& s, const Fragment& f, double by_alpha,
                        SplatGradient2D<double>* out) {
  // alpha = opacity exp(-q/2)
  out->opacity += by_alpha * f.alpha / s.opacity;
  const double by_q = -by_alpha * f.alpha / 2;
  out->conic[0] += by_q * f.dx * f.dx;
  out->conic[1] += by_q * 2 * f.dx * f.dy;
  out->conic[2] += by_q * f.dy * f.dy;
  out->mean[0] -= by_q * 2 * (s.conic[0] * f.dx + s.conic[1] * f.dy);
  out->mean[1] -= by_q * 2 * (s.conic[1] * f.dx + s.conic[2] * f.dy);
}

// What a call holds at most: splats, half as many again while they are sorted, and numbers for each
// pixel.
Status charge_memory(const Frame<double>& frame, const View<double>& view,
                     uint64_t doubles_per_pixel, MemoryCharge* charge) {
  const uint64_t splats = frame.count() + frame.count() / 2 + 1;
  const uint64_t pixels = num_pixels(view);
  return charge->take(
      splats * sizeof(Item) + pixels * doubles_per_pixel * sizeof(double) + pixels / 8 + 8,
      "rendering by the reference path");
}

class ReferenceRasterizer : public Rasterizer<double> {
 public:
  explicit ReferenceRasterizer(MemoryBudget& memory) : memory_(memory) {}

  Status forward(const Frame<double>& frame, const View<double>& view, const float* background,
                 float* rgb, float* alpha, Stats* stats) override {
    const size_t n = num_pixels(view);
    MemoryCharge room(memory_);
    L4D_RETURN_IF_ERROR(charge_memory(frame, view, 5, &room));
    std::vector<double> wide_rgb(rgb != nullptr ? 3 * n : 0), wide_alpha(alpha != nullptr ? n : 0);
    render_reference(frame, view, background, rgb != nullptr ? wide_rgb.data() : nullptr,
                     alpha != nullptr ? wide_alpha.data() : nullptr, stats);
    const auto narrow = [](double v) { return static_cast<float>(v); };
    if (rgb != nullptr) std::transform(wide_rgb.begin(), wide_rgb.end(), rgb, narrow);
    if (alpha != nullptr) std::transform(wide_alpha.begin(), wide_alpha.end(), alpha, narrow);
    return {};
  }

  Status backward(const Frame<double>& frame, const View<double>& view, const float* background,
                  const BackwardInput& input, ViewGradients<double>* out, Stats* stats) override {
    Clock clock(stats);
    MemoryCharge room(memory_);
    L4D_RETURN_IF_ERROR(charge_memory(frame, view, 3, &room));
    L4D_RETURN_IF_ERROR(renew(memory_, &out->coverage, frame.count(), "gradients"));
    L4D_RETURN_IF_ERROR(
        renew(memory_, &out->splat, input.geometry ? frame.count() : 0, "gradients"));
    const std::vector<Item> items = sorted_splats(frame, view, stats, &clock);
    std::fill(out->coverage.begin(), out->coverage.end(), 0.0);
    std::fill(out->splat.begin(), out->splat.end(), SplatGradient2D<double>{});
    if (!input.geometry) {
      blend(view, items, [&](const Item& item, const Fragment& f) {
        out->coverage[item.index] += f.alpha * f.transmittance;
      });
      clock.charge(L4D_RENDER_PASS_BLEND);
      return {};
    }

    // What each pixel adds to the scalar: first all of it, then what lies behind each splat in
    // turn.
    std::vector<double> behind(num_pixels(view), 0);
    const std::vector<double> left = blend(view, items, [&](const Item& item, const Fragment& f) {
      double g[3];
      upstream(input, f.pixel, g);
      behind[f.pixel] += f.alpha * f.transmittance * dot3(item.splat.color, g);
    });
    const double light[3] = {static_cast<double>(background[0]), static_cast<double>(background[1]),
                             static_cast<double>(background[2])};
    for (size_t pixel = 0; pixel < behind.size(); ++pixel) {
      double g[3];
      upstream(input, pixel, g);
      behind[pixel] += left[pixel] * dot3(light, g);
    }
    clock.charge(L4D_RENDER_PASS_BLEND);

    blend(view, items, [&](const Item& item, const Fragment& f) {
      double g[3];
      upstream(input, f.pixel, g);
      const double weight = f.alpha * f.transmittance;
      const double emitted = dot3(item.splat.color, g);
      SplatGradient2D<double>* splat = &out->splat[item.index];
      for (int c = 0; c < 3; ++c) splat->color[c] += weight * g[c];
      out->coverage[item.index] += weight;
      behind[f.pixel] -= weight * emitted;
      if (f.cut) return;
      const double by_alpha = f.transmittance * emitted - behind[f.pixel] / (1 - f.alpha);
      add_alpha_gradient(item.splat, f, by_alpha, splat);
    });
    clock.charge(L4D_RENDER_PASS_BACKWARD);
    return {};
  }

  void forget() override {}

 private:
  MemoryBudget& memory_;
};

}  // namespace

void render_reference(const Frame<double>& frame, const View<double>& view, const float* background,
                      double* rgb, double* alpha, Stats* stats) {
  Clock clock(stats);
  const std::vector<Item> items = sorted_splats(frame, view, stats, &clock);
  if (rgb != nullptr) std::fill_n(rgb, 3 * num_pixels(view), 0.0);
  const std::vector<double> left = blend(view, items, [&](const Item& item, const Fragment& f) {
    if (rgb == nullptr) return;
    for (size_t c = 0; c < 3; ++c) {
      rgb[3 * f.pixel + c] += f.alpha * f.transmittance * item.splat.color[c];
    }
  });
  for (size_t pixel = 0; pixel < left.size(); ++pixel) {
    if (alpha != nullptr) alpha[pixel] = 1 - left[pixel];
    for (size_t c = 0; rgb != nullptr && c < 3; ++c) {
      rgb[3 * pixel + c] += left[pixel] * static_cast<double>(background[c]);
    }
  }
  clock.charge(L4D_RENDER_PASS_BLEND);
}

std::unique_ptr<Rasterizer<double>> make_reference_rasterizer(MemoryBudget& memory) {
  return std::make_unique<ReferenceRasterizer>(memory);
}

}  // namespace l4d::render
