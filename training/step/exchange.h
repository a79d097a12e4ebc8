// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "training/step/phased_backend.h"

namespace l4d::train {

// Adds the sums of back ends that share a step up.
class Exchange {
 public:
  virtual ~Exchange() = default;
  // Gives every member the sums over all members, and the union of flags. members: alike, in the
  // order in which numbers are added, which never depends on what is ready first. Waits for no
  // member whose phases launch work: what it launches is ordered behind that.
  virtual void add_up(const std::vector<StepSums>& members) = 0;
};

}  // namespace l4d::train
