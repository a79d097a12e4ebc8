// SPDX-License-Identifier: Apache-2.0
#include "io/image/svg.h"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>

namespace l4d::io {
namespace {

// For short pieces: longer ones are cut off.
[[gnu::format(printf, 1, 2)]] std::string format(const char* pattern, ...) {
  char text[512];
  va_list arguments;
  va_start(arguments, pattern);
  std::vsnprintf(text, sizeof(text), pattern, arguments);
  va_end(arguments);
  return text;
}

std::string list_of(const std::vector<SvgPoint>& points) {
  std::string list;
  for (const SvgPoint& p : points) list += format("%s%.1f,%.1f", list.empty() ? "" : " ", p.x, p.y);
  return list;
}

}  // namespace

std::string escaped_xml(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        // XML has no control characters.
        out += static_cast<unsigned char>(c) < 0x20 ? '?' : c;
    }
  }
  return out;
}

Svg::Svg(double width, double height)
    : body_(format("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
                   "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%g\" height=\"%g\" "
                   "viewBox=\"0 0 %g %g\" font-family=\"sans-serif\">\n",
                   width, height, width, height)) {
  rect(0, 0, width, height, "white");
}

void Svg::rect(double x, double y, double width, double height, const std::string& fill) {
  body_ += format("<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" fill=\"%s\"/>\n", x,
                  y, width, height, fill.c_str());
}

void Svg::line(SvgPoint a, SvgPoint b, const std::string& stroke) {
  body_ += format("<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\"/>\n", a.x,
                  a.y, b.x, b.y, stroke.c_str());
}

void Svg::polyline(const std::vector<SvgPoint>& points, const std::string& stroke) {
  body_ += "<polyline points=\"" + list_of(points) +
           "\" fill=\"none\" stroke-width=\"1.5\" stroke=\"" + stroke + "\"/>\n";
}

void Svg::polygon(const std::vector<SvgPoint>& points, const std::string& fill) {
  body_ += "<polygon points=\"" + list_of(points) + "\" fill=\"" + fill + "\"/>\n";
}

void Svg::text(SvgPoint at, const std::string& text, SvgAnchor anchor, double size) {
  constexpr const char* kAnchors[] = {"start", "middle", "end"};
  body_ +=
      format("<text x=\"%.1f\" y=\"%.1f\" font-size=\"%g\" text-anchor=\"%s\" fill=\"#222222\">",
             at.x, at.y, size, kAnchors[static_cast<size_t>(anchor)]) +
      escaped_xml(text) + "</text>\n";
}

std::vector<double> axis_ticks(double most, size_t count) {
  if (!(most > 0)) return {0, 1};
  const double rough = most / static_cast<double>(count);
  const double decade = std::pow(10, std::floor(std::log10(rough)));
  double step = 10 * decade;
  for (const double factor : {5.0, 2.0, 1.0}) {
    if (factor * decade >= rough) step = factor * decade;
  }
  std::vector<double> ticks = {0};
  while (ticks.back() < most * (1 - 1e-9)) {
    ticks.push_back(step * static_cast<double>(ticks.size()));
  }
  return ticks;
}

}  // namespace l4d::io
