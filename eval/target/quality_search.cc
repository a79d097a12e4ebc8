// SPDX-License-Identifier: Apache-2.0
#include "eval/target/quality_search.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace l4d::eval {
namespace {

// Qualities closer than this are one for all purposes: sizes are within half a per cent.
constexpr double kFinest = 0.05;
// Errors are small enough at this share of the bound: they may be zero, which has no logarithm, and
// a loss negative.
constexpr double kMinShare = 0.1;

// A figure as a height that rises about linearly with the quality.
class Heights {
 public:
  explicit Heights(const Goal& goal)
      : goal_(goal), min_(goal.rises ? 0 : kMinShare * goal.requested) {
    requested = of(goal.requested);
    // Inside the tolerance, on the side that keeps the bound.
    const bool from_below = goal.at_most == goal.rises;
    aim = requested + (from_below ? -0.4 : 0.4) * goal.tolerance;
  }
  double of(double figure) const {
    const double linear = goal_.logarithm ? std::log(std::max(figure, min_)) : figure;
    return goal_.rises ? linear : -linear;
  }
  double requested, aim;

 private:
  const Goal& goal_;
  double min_;
};

struct Point {
  double quality, height;
};

// Between a point below the aim and one above, on the line through both. `side`: how often in a row
// the line has led to the lower side (negative) or the upper: the other end then counts as nearer
// to the aim than it is, half as near each time (the Illinois method).
double between(const Point& low, const Point& high, double aim, int side) {
  const double below = (aim - low.height) * std::ldexp(1, std::min(0, 1 - side));
  const double above = (high.height - aim) * std::ldexp(1, std::min(0, 1 + side));
  double share = below / (below + above);
  if (!std::isfinite(share)) share = 0.5;
  return low.quality + (high.quality - low.quality) * std::clamp(share, 0.1, 0.9);
}

}  // namespace

QualitySearch search_quality(const Goal& goal, const QualityRange& range,
                             const std::function<double(double, size_t)>& measure,
                             const std::function<void()>& keep) {
  const Heights heights(goal);
  QualitySearch search;
  std::optional<Point> low, high;
  double quality = std::clamp(range.start, range.lowest, range.highest);
  double slope = goal.slope;
  // What keeps the bound is better the less it costs; of what does not, the nearest.
  const auto better = [&](const Trial& x, const Trial& y) {
    if (x.met != y.met) return x.met;
    if (!x.met) {
      return std::abs(heights.of(x.figure) - heights.requested) <
             std::abs(heights.of(y.figure) - heights.requested);
    }
    return goal.at_most == goal.rises ? x.quality > y.quality : x.quality < y.quality;
  };
  int side = 0;  // how often in a row the height was too low (negative) or too high
  for (;;) {
    const double figure = measure(quality, search.trials.size());
    const Point point = {quality, heights.of(figure)};
    search.trials.push_back({quality, figure, goal.met(figure)});
    const Trial& trial = search.trials.back();
    const bool near = trial.met && std::abs(point.height - heights.requested) <= goal.tolerance;
    if (near || search.trials.size() == 1 || better(trial, search.result())) {
      search.best = search.trials.size() - 1;
      keep();
    }
    if (near) return search;

    const bool below = point.height < heights.aim;
    side = below ? std::min(side, 0) - 1 : std::max(side, 0) + 1;
    std::optional<Point>& replaced = below ? low : high;
    if (replaced && replaced->quality != quality) {
      const double seen = (point.height - replaced->height) / (quality - replaced->quality);
      // A flat stretch says nothing about what comes after it.
      if (seen > 0) slope = std::clamp(seen, goal.slope / 4, goal.slope * 4);
    }
    replaced = point;
    if ((below && quality >= range.highest) || (!below && quality <= range.lowest)) {
      search.obstacle = QualitySearch::Obstacle::kEndOfRange;
      search.low = search.high = quality;
      return search;
    }
    if (low && high && high->quality - low->quality <= kFinest) {
      search.obstacle = QualitySearch::Obstacle::kNoQualityBetween;
      search.low = low->quality;
      search.high = high->quality;
      return search;
    }
    if (search.trials.size() == goal.most_trials) {
      search.obstacle = QualitySearch::Obstacle::kTooManyTrials;
      return search;
    }
    if (low && high) {
      quality = between(*low, *high, heights.aim, side);
    } else {
      const double step = std::max(0.3, 1.1 * std::abs(heights.aim - point.height) / slope);
      quality = std::clamp(quality + (below ? step : -step), range.lowest, range.highest);
    }
  }
}

}  // namespace l4d::eval
