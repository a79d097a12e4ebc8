// SPDX-License-Identifier: Apache-2.0
#include "cli/http/picture_request.h"

#include <cmath>
#include <cstdio>

namespace l4d::cli {

bool parse_picture(const std::string& name, PictureRequest* out) {
  PictureRequest p;
  int end = 0;
  const int read = std::sscanf(name.c_str(), "%5ux%5u/%30lf/%30lf/%30lf/%30lf%n", &p.width,
                               &p.height, &p.time, &p.angle, &p.rise, &p.zoom, &end);
  if (read != 6 || static_cast<size_t>(end) != name.size()) return false;
  const auto fits = [](uint32_t side) { return side >= 16 && side <= PictureRequest::kMostSide; };
  if (!fits(p.width) || !fits(p.height) || !std::isfinite(p.time)) return false;
  if (!(std::fabs(p.angle) <= 1e6) || !(std::fabs(p.rise) <= 10)) return false;
  if (!(p.zoom >= 0.01 && p.zoom <= 100)) return false;
  *out = p;
  return true;
}

}  // namespace l4d::cli
