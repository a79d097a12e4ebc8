// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <vector>

#include "training/step/exchange.h"

namespace l4d::train {

// A back end of several members of one kind, which share the views of each step. All members have
// the same model: they update it from the same sums and change its density by the same rule, so
// that their models stay equal bit for bit. The result depends on the number of members, since
// sums of numbers are rounded by member, and never on timing.
//
// The group fails with DEVICE where members have come apart: `save` compares hashes of their
// models. When a call throws, every member has ended its part of it.
std::unique_ptr<Backend> make_group_backend(std::vector<std::unique_ptr<PhasedBackend>> members,
                                            std::unique_ptr<Exchange> exchange);

// The views of one of `members` members: as many as those of any other, or one less or more.
ViewRange views_of_member(size_t views, size_t member, size_t members);

}  // namespace l4d::train
