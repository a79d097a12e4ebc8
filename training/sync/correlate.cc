// SPDX-License-Identifier: Apache-2.0
#include "training/sync/correlate.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace l4d::train {
namespace {

// Of the mean to each side that is taken off. Slower changes are those of how near something is to
// a camera, in which cameras differ.
constexpr double kWindow = 0.27;       // s
constexpr double kApart = 0.2;         // s, between two places
constexpr double kLeastOverlap = 2;    // s: in less, one event may be chance
constexpr double kLeastEvents = 0.05;  // of what moves, root mean square: what is less is noise,
                                       // or how near something is (basketball has 0.12 to 0.32)
constexpr double kFloor = 0.05;        // of the mean: what is less is noise
constexpr double kFalse = 0.05;        // share of signals with nothing in common

// Less the mean as far to both sides as there are values, `reach` at most, so that what rises
// evenly is 0 near the ends, too: all recordings have ends, which say nothing of clocks.
Signal less_mean(const Signal& signal, std::ptrdiff_t reach) {
  std::vector<double> sums(signal.size() + 1);
  std::partial_sum(signal.begin(), signal.end(), sums.begin() + 1);
  const double* const sum = sums.data();
  Signal out(signal);
  const auto n = static_cast<std::ptrdiff_t>(signal.size());
  for (std::ptrdiff_t k = 0; k < n; ++k) {
    const std::ptrdiff_t side = std::min({reach, k, n - 1 - k});
    out.data()[k] -= (sum[k + side + 1] - sum[k - side]) / static_cast<double>(2 * side + 1);
  }
  return out;
}

// Of a[k] and b[k + lag], where both are there and `has` is set; -1 where those are fewer than
// `least`. By chance a few are more alike than many, as one over the root of their number.
double correlation(const Signal& a, const std::vector<uint8_t>& has, const Signal& b,
                   std::ptrdiff_t lag, double least) {
  const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(0, -lag);
  const auto end =
      std::min(static_cast<std::ptrdiff_t>(a.size()), static_cast<std::ptrdiff_t>(b.size()) - lag);
  double n = 0, sum_a = 0, sum_b = 0, aa = 0, bb = 0, ab = 0;
  for (std::ptrdiff_t k = begin; k < end; ++k) {
    if (!has.empty() && has.data()[k] == 0) continue;
    const double x = a.data()[k], y = b.data()[k + lag];
    ++n;
    sum_a += x;
    sum_b += y;
    aa += x * x;
    bb += y * y;
    ab += x * y;
  }
  if (n < least) return -1;
  const double variances = (aa - sum_a * sum_a / n) * (bb - sum_b * sum_b / n);
  if (!(variances > 0)) return 0;
  const double share = std::min(1.0, n / static_cast<double>(std::min(a.size(), b.size())));
  return (ab - sum_a * sum_b / n) / std::sqrt(variances) * std::sqrt(share);
}

// How many neighbours say one thing, of the values that `correlation` takes; each of those but one
// has no say of its own. (Bartlett, 1946: the variance of the correlation of two signals that have
// nothing in common.)
double values_alike(const Signal& a, const std::vector<uint8_t>& has, const Signal& b,
                    std::ptrdiff_t lag, std::ptrdiff_t reach) {
  const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(0, -lag);
  const auto end =
      std::min(static_cast<std::ptrdiff_t>(a.size()), static_cast<std::ptrdiff_t>(b.size()) - lag);
  Signal x, y;
  for (std::ptrdiff_t k = begin; k < end; ++k) {
    if (has.data()[k] == 0) continue;
    x.push_back(a.data()[k]);
    y.push_back(b.data()[k + lag]);
  }
  const auto n = static_cast<double>(x.size());
  for (Signal* signal : {&x, &y}) {
    const double mean = std::accumulate(signal->begin(), signal->end(), 0.0) / n;
    for (double& value : *signal) value -= mean;
  }
  const auto product = [](const Signal& signal, std::ptrdiff_t apart) {
    return std::inner_product(signal.begin() + apart, signal.end(), signal.begin(), 0.0);
  };
  const double all = product(x, 0) * product(y, 0);
  if (!(all > 0)) return static_cast<double>(x.size());
  double sum = 1;
  for (std::ptrdiff_t k = 1; k <= reach && k < static_cast<std::ptrdiff_t>(x.size()); ++k) {
    sum += 2 * product(x, k) * product(y, k) / all;
  }
  return std::max(1.0, sum);
}

// The correlation that the best of `tries` reaches once in kFalse cases where signals of so many
// values have nothing in common (Fisher's z).
double by_chance(double values, double tries) {
  if (values <= 4) return 1;
  const double tail = kFalse / std::max(1.0, tries);
  double low = 0, high = 10;
  for (int k = 0; k < 40; ++k) {
    const double z = (low + high) / 2;
    (std::erfc(z / std::sqrt(2.0)) / 2 > tail ? low : high) = z;
  }
  return std::tanh(high / std::sqrt(values - 3));
}

}  // namespace

Signal detail_of(const Signal& signal, double rate) {
  const double mean = std::accumulate(signal.begin(), signal.end(), 0.0) /
                      static_cast<double>(std::max<size_t>(1, signal.size()));
  if (!(mean > 0)) return Signal(signal.size(), 0.0);
  Signal logs;
  for (const double value : signal) logs.push_back(std::log(value + kFloor * mean));
  const auto reach = static_cast<std::ptrdiff_t>(std::max(1.0, std::round(kWindow * rate)));
  logs = less_mean(logs, reach);
  const double squares = std::inner_product(logs.begin(), logs.end(), logs.begin(), 0.0);
  const bool is_even = squares < kLeastEvents * kLeastEvents * static_cast<double>(logs.size());
  return is_even ? Signal(signal.size(), 0.0) : logs;
}

Match match(const Signal& a, const std::vector<uint8_t>& has, const Signal& b, std::ptrdiff_t first,
            std::ptrdiff_t most, double rate) {
  const double least =
      std::max(kLeastOverlap * rate, 0.5 * static_cast<double>(std::min(a.size(), b.size())));
  std::vector<double> values(static_cast<size_t>(2 * most + 1));
  double* const found = values.data();
  for (std::ptrdiff_t k = 0; k < 2 * most + 1; ++k) {
    found[k] = correlation(a, has, b, first + k - most, least);
  }
  const auto at = std::max_element(values.begin(), values.end()) - values.begin();
  Match best;
  best.peak = found[at];
  best.lag = static_cast<double>(first + at - most);
  if (!(best.peak > 0)) return Match();
  if (at > 0 && at < 2 * most && found[at - 1] > -1 && found[at + 1] > -1) {
    const double bend = found[at - 1] - 2 * found[at] + found[at + 1];
    if (bend < 0) best.lag += 0.5 * (found[at - 1] - found[at + 1]) / bend;
  }
  const auto apart = static_cast<std::ptrdiff_t>(std::ceil(kApart * rate));
  for (std::ptrdiff_t k = 0; k < 2 * most + 1; ++k) {
    best.tries += found[k] > -1 ? 1 : 0;
    if (std::abs(k - at) >= apart) best.elsewhere = std::max(best.elsewhere, found[k]);
  }
  return best;
}

double chance(const Match& found, const Signal& a, const std::vector<uint8_t>& has, const Signal& b,
              double rate) {
  const double alike = values_alike(a, has, b, std::lround(found.lag),
                                    static_cast<std::ptrdiff_t>(2 * kWindow * rate));
  // A peak of fewer values counts for less, so that by chance all lags have equal ones.
  return by_chance(static_cast<double>(std::min(a.size(), b.size())) / alike, found.tries / alike);
}

}  // namespace l4d::train
