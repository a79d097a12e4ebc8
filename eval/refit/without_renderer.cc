// SPDX-License-Identifier: Apache-2.0
// What is here in place of the renderer where it was not built.
#include "eval/refit/refit.h"

namespace l4d::eval {

Refit refit(const RefitInput&, const EncoderHandle&, const RefitCalls&) {
  throw io::Error(L4D_ERR_FEATURE_UNSUPPORTED, "to fit opacities, the renderer must be built");
}

}  // namespace l4d::eval
