// SPDX-License-Identifier: Apache-2.0
// How a scene asks to be drawn and shown, as text: "dilation=0.1,compensation=1" and
// "playback=loop,metres_per_unit=2". Comments of PLY files and options of the tool have this form.
#pragma once

#include <string>

#include "l4d/l4d.h"

namespace l4d::io {

// What differs from the defaults; empty if nothing does. Numbers read back as they were.
std::string rendering_text(const l4d_rendering& rendering);
std::string presentation_text(const l4d_presentation& presentation);

// Changes what the text names and keeps the rest. Throws Error with L4D_ERR_INVALID_ARGUMENT on an
// unknown name, an invalid number, and one out of its range.
//
// rendering: dilation, cutoff, min_alpha, max_alpha, compensation (0 or 1).
// presentation: playback (once, loop, ping-pong), bounds (x:y:z:x:y:z), camera
// (position x:y:z, target x:y:z, up x:y:z and the vertical field of view in degrees, all
// separated by ':'), metres_per_unit.
void parse_rendering(const std::string& text, l4d_rendering* rendering);
void parse_presentation(const std::string& text, l4d_presentation* presentation);

}  // namespace l4d::io
