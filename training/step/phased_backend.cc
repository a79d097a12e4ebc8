// SPDX-License-Identifier: Apache-2.0
#include "training/step/phased_backend.h"

namespace l4d::train {

StepOutput PhasedBackend::step(const StepInput& input) {
  const ViewRange all{0, input.views.size()};
  StepOutput output;
  do {
    render_views(input, all);
    update(input);
  } while (!finish(input, all, &output));
  return output;
}

}  // namespace l4d::train
