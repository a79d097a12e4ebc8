// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace l4d::io {

struct SvgPoint {
  double x, y;
};

enum class SvgAnchor { kStart, kMiddle, kEnd };

// Text as XML and HTML have it.
std::string escaped_xml(const std::string& text);

// An SVG image in the making. Coordinates are pixels, y downwards.
class Svg {
 public:
  Svg(double width, double height);

  void rect(double x, double y, double width, double height, const std::string& fill);
  void line(SvgPoint a, SvgPoint b, const std::string& stroke);
  void polyline(const std::vector<SvgPoint>& points, const std::string& stroke);
  void polygon(const std::vector<SvgPoint>& points, const std::string& fill);
  void text(SvgPoint at, const std::string& text, SvgAnchor anchor = SvgAnchor::kStart,
            double size = 12);
  // The complete document.
  std::string finish() const { return body_ + "</svg>\n"; }

 private:
  std::string body_;
};

// Round numbers from 0 to at least `most`, about `count` of them.
std::vector<double> axis_ticks(double most, size_t count);

}  // namespace l4d::io
