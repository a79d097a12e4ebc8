// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/common.h"
#include "eval/refit.h"

namespace l4d::cli {

// Adds "checked", what renders of the stream have of the scene's in views that no fit used; and
// "refit", if there was one.
void describe_refit(const eval::Refit& refit, Outcome* outcome);
// Notes what a refit left out or did not reach.
void note_refit(Context& context, const eval::Refit& refit);

}  // namespace l4d::cli
