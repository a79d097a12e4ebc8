// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace l4d::train {

// Runs a program to its end, and writes what it says to the end of the file `log`. Throws
// io::Error(IO): where it is missing, with `missing`; where it fails, with the last line that it
// said; CANCELLED, and ends it, where `cancelled` returns true.
void run_program(const std::vector<std::string>& words, const std::string& log,
                 const std::string& missing, const std::function<bool()>& cancelled);

}  // namespace l4d::train
