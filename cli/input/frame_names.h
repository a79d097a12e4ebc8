// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/command/context.h"

namespace l4d::cli {

// Sorts the files of a sequence as people count their names: by the number in them if they differ
// in nothing else, be it a decimal fraction or below 0, and else as name_is_before() does.
void order_frames(std::vector<std::string>* files);

// Notes what names of ordered files say that may not be meant: names of several kinds, numbers that
// are left out or there twice. `where` is what they were found by.
void note_frame_names(Context& context, const std::string& where,
                      const std::vector<std::string>& files);

// Notes if files are listed in another order than that of the numbers in which alone their names
// differ.
void note_listed_order(Context& context, const std::vector<std::string>& files);

}  // namespace l4d::cli
