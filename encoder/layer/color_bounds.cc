// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer/color_bounds.h"

#include <algorithm>
#include <cstdio>
#include <mutex>

#include "libl4dcodec/base/threads.h"

namespace l4d {
namespace {

// Coders check a row in double, decoders sum integers and binary32: this share of a bound is left
// to what they differ by.
constexpr double kUsed = 0.995;

bool within(double error, double bound) { return !(bound > 0) || error <= bound; }

}  // namespace

RowCheck color_check(const EncoderScene& scene, const ErrorBounds& bounds) {
  if (!(bounds.base_color > 0 || bounds.directional_color > 0)) return {};
  const double base = kUsed * bounds.base_color, directional = kUsed * bounds.directional_color;
  return [&scene, base, directional](size_t i, const float* decoded) {
    const size_t dim = scene.sh_dim();
    const ColorErrors e = color_errors(scene.sh.data() + dim * i, decoded, dim / 3);
    return within(e.base, base) && within(e.directional, directional);
  };
}

ColorErrors largest_color_errors(const EncoderScene& scene, const CodedComponent& sh, int threads) {
  ColorErrors worst;
  std::mutex mutex;
  const size_t dim = scene.sh_dim();
  const float* decoded = rows_of(sh).decoded.data();
  parallel_for(threads, scene.count, kGrain, [&](size_t begin, size_t end) {
    ColorErrors own;
    for (size_t i = begin; i < end; ++i) {
      const ColorErrors e = color_errors(scene.sh.data() + dim * i, decoded + dim * i, dim / 3);
      own.base = std::max(own.base, e.base);
      own.directional = std::max(own.directional, e.directional);
    }
    std::lock_guard<std::mutex> lock(mutex);
    worst.base = std::max(worst.base, own.base);
    worst.directional = std::max(worst.directional, own.directional);
  });
  return worst;
}

Status check_colors(const ColorErrors& errors, const ErrorBounds& bounds) {
  const auto refuse = [](const char* what, double error, double bound) {
    char text[200];
    std::snprintf(text, sizeof text,
                  "a %s colour comes out %g off, and max-%s-color-error is %g: set a larger bound, "
                  "or 0 for none",
                  what, error, what, bound);
    return Status(L4D_ERR_INVALID_SCENE, text);
  };
  if (!within(errors.base, bounds.base_color)) {
    return refuse("base", errors.base, bounds.base_color);
  }
  if (!within(errors.directional, bounds.directional_color)) {
    return refuse("directional", errors.directional, bounds.directional_color);
  }
  return {};
}

}  // namespace l4d
