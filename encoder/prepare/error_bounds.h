// SPDX-License-Identifier: Apache-2.0
// What coding may do to a single Gaussian at most, as a viewer sees it, and what it has done.
#pragma once

namespace l4d {

// A Gaussian over time: position + velocity (t - reference), opacity exp(-lambda (t - mean)^2 / 2).
struct SeenGaussian {
  double position[3];
  double velocity[3];
  double reference;  // seconds
  double mean;       // seconds
  double lambda;     // 1/s^2; 0: it does not fade
  double opacity;
  double covariance[6];  // of the slice: xx xy xz yy yz zz
  double min_size;       // scene units: below this its errors do not count
};

struct GaussianErrors {
  double position = 0;    // in sizes, see ErrorBounds
  double covariance = 1;  // factor
  double opacity = 0;
  double visible = 0;    // scene units
  double mean_time = 0;  // in temporal standard deviations
  // See color_errors. Of all Gaussians: errors_of knows no colours.
  double base_color = 0;
  double directional_color = 0;
};

struct ErrorBounds {
  // Distance between where the Gaussian is and where it should be, while it has at least half of
  // the most opacity that it reaches in the sequence, over its size: its own largest standard
  // deviation, or `min_size` where that is larger. 0 = no bound, as in all of these.
  double position = 0;
  // The largest ratio of a principal variance to what it should be, or the other way round; or 1
  // and the largest change of a variance in any direction in parts of the largest variance there
  // is. All with the square of the minimum size added. 1 is no error, and as a bound none.
  double covariance = 0;
  double opacity = 0;  // seen at any instant
  // Distance at any instant at which it is visible at all, in scene units.
  double visible = 0;
  double base_color = 0;  // see color_errors
  double directional_color = 0;

  double min_size = 0;        // scene units, of all; a Gaussian's own counts where it is larger
  double position_slack = 0;  // scene units: what coding positions will add, at most
  double opacity_slack = 0;

  // Of those on place, shape and opacity.
  bool any() const { return position > 0 || covariance > 1 || opacity > 0 || visible > 0; }
};

// Of `decoded` against `original` in a sequence from `begin` to `end`. Slacks count as errors. An
// error of opacity that may be above `interesting_opacity` is that of the worst instant; a smaller
// one, of the worst of some.
GaussianErrors errors_of(const SeenGaussian& original, const SeenGaussian& decoded, double begin,
                         double end, const ErrorBounds& bounds, double interesting_opacity);

// The largest error in parts of its bound: above 1, one is exceeded. What is no number is infinite.
double excess_of(const GaussianErrors& errors, const ErrorBounds& bounds);

}  // namespace l4d
