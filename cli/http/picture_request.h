// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace l4d::cli {

// A picture that a page asks for: the first view turned and brought nearer (io::turned).
struct PictureRequest {
  uint32_t width = 0, height = 0;        // pixels, 16 to kMostSide
  double time = 0;                       // seconds of the presentation
  double angle = 0, rise = 0, zoom = 1;  // radians, radians, 0.01 to 100
  static constexpr uint32_t kMostSide = 4096;
};
// From "WIDTHxHEIGHT/TIME/ANGLE/RISE/ZOOM". False if it is not that, or out of range.
bool parse_picture(const std::string& name, PictureRequest* out);

// What draws in place of the player.
struct Pictures {
  std::string scene;  // JSON: what the page has to know of it
  // PNG. Called by several threads; what it throws is answered with 500.
  std::function<std::string(const PictureRequest&)> draw;
};

}  // namespace l4d::cli
