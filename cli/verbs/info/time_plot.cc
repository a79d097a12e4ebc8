// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "cli/text/units.h"
#include "cli/verbs/info/time_profile.h"
#include "io/image/svg.h"

namespace l4d::cli {
namespace {

using io::axis_ticks;
using io::Svg;
using io::SvgAnchor;
using io::SvgPoint;

constexpr double kWidth = 960, kHeight = 620;
constexpr double kLeft = 80, kRight = 800;  // of both panels
constexpr const char* kGrid = "#dddddd";
constexpr const char* kAxis = "#555555";
constexpr const char* kDirectory = "#999999";
constexpr const char* kGaussians = "#aaaaaa";
constexpr const char* kVisible = "#3b6fb6";

// A rectangle of the image, and what its sides stand for.
struct Panel {
  double top, bottom;
  double time_begin, time_end;
  double most;  // at the top

  double x(double time) const {
    return kLeft + (kRight - kLeft) * (time - time_begin) / (time_end - time_begin);
  }
  double y(double value) const { return bottom - (bottom - top) * std::min(value, most) / most; }
};

// From dark to light, coarse to fine: levels have an order.
std::string level_colour(size_t index, size_t count) {
  constexpr double kAnchors[][3] = {{36, 48, 110}, {38, 120, 142}, {76, 178, 112}, {240, 205, 60}};
  constexpr size_t kLast = std::size(kAnchors) - 1;
  const double at =
      count < 2 ? 0 : static_cast<double>(index * kLast) / static_cast<double>(count - 1);
  const size_t from = std::min(static_cast<size_t>(at), kLast - 1);
  const double share = at - static_cast<double>(from);
  const auto channel = [&](size_t k) {
    return static_cast<int>(
        std::lround(kAnchors[from][k] + share * (kAnchors[from + 1][k] - kAnchors[from][k])));
  };
  return format("#%02x%02x%02x", channel(0), channel(1), channel(2));
}

template <typename Label>
void draw_axes(Svg& svg, const Panel& panel, const std::vector<double>& ticks, const Label& label) {
  for (const double tick : ticks) {
    const double y = panel.y(tick);
    svg.line({kLeft, y}, {kRight, y}, tick == 0 ? kAxis : kGrid);
    svg.text({kLeft - 8, y + 4}, label(tick), SvgAnchor::kEnd);
  }
  const double begin = panel.time_begin;
  for (const double tick : axis_ticks(panel.time_end - begin, 8)) {
    if (begin + tick > panel.time_end * (1 + 1e-9)) break;
    const double x = panel.x(begin + tick);
    svg.line({x, panel.bottom}, {x, panel.bottom + 4}, kAxis);
    svg.text({x, panel.bottom + 18}, format_time(begin + tick), SvgAnchor::kMiddle);
  }
}

// The area between two staircases over the steps.
std::vector<SvgPoint> staircase(const TimeProfile& profile, const Panel& panel,
                                const std::vector<double>& low, const std::vector<double>& high) {
  std::vector<SvgPoint> points, back;
  for (size_t step = 0; step < profile.times.size(); ++step) {
    const double left = panel.x(profile.times[step]);
    const double right =
        panel.x(std::min(profile.times[step] + profile.step_seconds(), panel.time_end));
    points.push_back({left, panel.y(high[step])});
    points.push_back({right, panel.y(high[step])});
    back.push_back({left, panel.y(low[step])});
    back.push_back({right, panel.y(low[step])});
  }
  points.insert(points.end(), back.rbegin(), back.rend());
  return points;
}

void legend(Svg& svg, double y, const std::string& colour, const std::string& text) {
  svg.rect(kRight + 16, y - 9, 11, 11, colour);
  svg.text({kRight + 33, y}, text, SvgAnchor::kStart, 11);
}

void draw_bytes(Svg& svg, const TimeProfile& profile, Panel panel) {
  // The first step fetches the whole scene of that instant, beside which no other could be seen.
  const size_t steps = profile.times.size();
  uint64_t most = 0;
  for (size_t step = steps > 1 ? 1 : 0; step < steps; ++step) {
    most = std::max(most, profile.step_bytes(step));
  }
  if (most == 0) most = profile.step_bytes(0);
  const std::vector<double> ticks = axis_ticks(static_cast<double>(most), 5);
  panel.most = ticks.back();
  draw_axes(svg, panel, ticks, [](double v) { return format_bytes(static_cast<uint64_t>(v)); });

  std::vector<double> low(steps), high(steps);
  const auto stack = [&](const std::vector<uint64_t>& bytes, const std::string& colour,
                         const std::string& name, double legend_y) {
    for (size_t step = 0; step < steps; ++step) high[step] += static_cast<double>(bytes[step]);
    svg.polygon(staircase(profile, panel, low, high), colour);
    low = high;
    legend(svg, legend_y, colour, name);
  };
  double legend_y = panel.top + 10 + 16 * static_cast<double>(profile.levels.size());
  stack(profile.directory_bytes, kDirectory, "directory", legend_y);
  for (size_t l = 0; l < profile.levels.size(); ++l) {
    legend_y -= 16;
    stack(profile.bytes[l], level_colour(l, profile.levels.size()),
          format("level %u, %s s", profile.levels[l],
                 format_number(profile.bucket_widths[l]).c_str()),
          legend_y);
  }
  if (profile.step_bytes(0) > static_cast<uint64_t>(panel.most)) {
    svg.text({kLeft + 10, panel.top + 12},
             "first step: " + format_bytes(profile.step_bytes(0)) + " (cut off)", SvgAnchor::kStart,
             11);
  }
}

void draw_gaussians(Svg& svg, const TimeProfile& profile, Panel panel) {
  const uint64_t most = *std::max_element(profile.gaussians.begin(), profile.gaussians.end());
  const std::vector<double> ticks = axis_ticks(static_cast<double>(most), 5);
  panel.most = ticks.back();
  draw_axes(svg, panel, ticks, [](double v) { return format_count(static_cast<uint64_t>(v)); });
  const auto line = [&](const std::vector<uint64_t>& counts, const char* colour) {
    std::vector<SvgPoint> points;
    for (size_t step = 0; step < counts.size(); ++step) {
      points.push_back({panel.x(profile.times[step]), panel.y(static_cast<double>(counts[step]))});
    }
    svg.polyline(points, colour);
  };
  line(profile.gaussians, kGaussians);
  line(profile.visible, kVisible);
  legend(svg, panel.top + 10, kGaussians, "in fetched buckets");
  legend(svg, panel.top + 26, kVisible, "visible");
}

}  // namespace

std::string TimeProfile::svg(const std::string& title) const {
  Svg image(kWidth, kHeight);
  image.text({kLeft, 28}, title, SvgAnchor::kStart, 16);
  image.text({kLeft, 48}, text());
  const double end = timeline.time_begin + io::duration(timeline);
  const std::string per =
      frames_per_step == 1 ? "frame" : format("%u frames", static_cast<unsigned>(frames_per_step));
  image.text({kLeft, 78}, "Bytes to fetch per " + per + ", by temporal level (and bucket width)");
  draw_bytes(image, *this, {90, 320, timeline.time_begin, end, 1});
  image.text({kLeft, 370}, "Gaussians");
  draw_gaussians(image, *this, {382, 560, timeline.time_begin, end, 1});
  image.text({(kLeft + kRight) / 2, 600}, "seconds", SvgAnchor::kMiddle);
  return image.finish();
}

}  // namespace l4d::cli
