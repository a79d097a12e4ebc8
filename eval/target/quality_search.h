// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

namespace l4d::eval {

// What is wanted of an encode, as a bound on one figure of it that quality moves one way.
struct Goal {
  double requested = 0;    // bound on the figure
  bool at_most = false;    // of figures: at most that, or at least
  bool rises = false;      // with the quality
  bool logarithm = false;  // whether the figure's logarithm is about linear in the quality
  double slope = 1;        // of figure or logarithm over quality, about; positive
  double tolerance = 0;    // in figure or logarithm: how far from the bound is near enough
  size_t most_trials = 16;

  bool met(double figure) const { return at_most ? figure <= requested : figure >= requested; }
};

struct Trial {
  double quality = 0;
  double figure = 0;
  bool met = false;
};

struct QualitySearch {
  std::vector<Trial> trials;
  size_t best = 0;  // the nearest to the bound that keeps it, or the nearest
  // Why the best is not near enough.
  enum class Obstacle { kNone, kEndOfRange, kNoQualityBetween, kTooManyTrials };
  Obstacle obstacle = Obstacle::kNone;
  double low = 0, high = 0;  // the end of the range; or the qualities on either side

  const Trial& result() const { return trials[best]; }
};

struct QualityRange {
  double lowest, highest, start;
};

// Looks for the quality that meets the goal at the least cost. measure(quality, trial) tells the
// figure; keep() is called after each that is the best so far.
QualitySearch search_quality(const Goal& goal, const QualityRange& range,
                             const std::function<double(double quality, size_t trial)>& measure,
                             const std::function<void()>& keep);

}  // namespace l4d::eval
