// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "training/capture/capture.h"
#include "training/run/report/run_report.h"

namespace l4d::train {

// A report as one page of HTML that needs no other file: scores, those of each camera, the worst
// views as pictures, where the cameras are, and curves, an SVG; "" = none.
std::string page_of(const RunReport& report, const Capture& capture, const std::string& curves);

// The cameras from above, as an SVG: blue ones train, large red ones test.
std::string map_of(const Capture& capture);

}  // namespace l4d::train
