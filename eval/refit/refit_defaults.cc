// SPDX-License-Identifier: Apache-2.0
#include "eval/refit/refit.h"

namespace l4d::eval {

RefitDefaults refit_defaults(uint32_t backend, double effort) {
  const bool device = backend == L4D_BACKEND_CUDA;
  // On processors two passes bring most of what four do.
  RefitDefaults defaults = device ? RefitDefaults{4, 600, 0, 0} : RefitDefaults{2, 150, 700, 300};
  constexpr double kUsual = 7, kHalf = 4, kTwice = 8;
  if (effort > kUsual) defaults.passes *= effort > kTwice ? 4 : 2;
  if (effort < kUsual) defaults.passes = effort >= kHalf ? defaults.passes / 2 : 1;
  return defaults;
}

bool can_refit(const EncoderHandle& encoder) {
  return has_quality(encoder) && encoder.value(L4D_ENC_PRUNE_COST) > 0 &&
         encoder.value(L4D_ENC_PRUNE_WEIGHT) < 0;
}

}  // namespace l4d::eval
