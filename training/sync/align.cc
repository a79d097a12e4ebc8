// SPDX-License-Identifier: Apache-2.0
#include "training/sync/align.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "libl4dcodec/base/threads.h"

namespace l4d::train {
namespace {

// Of the mean to each side that is taken off. Slower changes are those of how near something is to
// a camera, in which cameras differ.
constexpr double kWindow = 0.27;     // s
constexpr double kApart = 0.2;       // s, between two places
constexpr double kLeastOverlap = 1;  // s
constexpr double kFloor = 0.05;      // of the mean: what is less is noise
constexpr double kSure = 0.35, kMargin = 0.1;
constexpr int kRounds = 3;

// Changes of the logarithm, so that a camera that is near does not outweigh its own quiet times.
Signal detail_of(const Signal& signal, double rate) {
  const auto n = static_cast<std::ptrdiff_t>(signal.size());
  if (n == 0) return {};
  const double mean = std::accumulate(signal.begin(), signal.end(), 0.0) / static_cast<double>(n);
  if (!(mean > 0)) return Signal(signal.size(), 0.0);
  std::vector<double> sums(signal.size() + 1);
  Signal logs(signal.size());
  for (size_t k = 0; k < signal.size(); ++k) {
    logs[k] = std::log(signal[k] + kFloor * mean);
    sums[k + 1] = sums[k] + logs[k];
  }
  double* const log = logs.data();
  const double* const sum = sums.data();
  const auto reach = static_cast<std::ptrdiff_t>(std::max(1.0, std::round(kWindow * rate)));
  for (std::ptrdiff_t k = 0; k < n; ++k) {
    const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(0, k - reach);
    const std::ptrdiff_t end = std::min(n, k + reach + 1);
    log[k] -= (sum[end] - sum[begin]) / static_cast<double>(end - begin);
  }
  return logs;
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

struct Match {
  double lag = 0;  // b[k + lag] looks like a[k]
  double peak = -1, elsewhere = -1;
};

class Aligner {
 public:
  Aligner(const std::vector<Signal>& signals, double rate, double most, uint32_t threads)
      : rate_(rate),
        most_(static_cast<std::ptrdiff_t>(std::ceil(most * rate))),
        threads_(static_cast<int>(threads)),
        places_(signals.size()) {
    for (const Signal& signal : signals) details_.push_back(detail_of(signal, rate));
  }

  std::vector<Offset> run() {
    const size_t n = details_.size();
    std::vector<Offset> offsets(n);
    if (n < 2) return offsets;
    start();
    std::vector<Match> matches(n);
    for (int round = 0; round < kRounds; ++round) {
      parallel_for(threads_, n, 1, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) matches[i] = with_others(i);
      });
      for (size_t i = 0; i < n; ++i) places_[i] = matches[i].lag;
    }
    std::vector<double> sorted = places_;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(n / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    for (size_t i = 0; i < n; ++i) {
      offsets[i] = {(*middle - places_[i]) / rate_, matches[i].peak, matches[i].elsewhere};
    }
    return offsets;
  }

 private:
  // Along the pairs that are most alike.
  void start() {
    const size_t n = details_.size();
    std::vector<Match> pairs(n * n);
    parallel_for(threads_, n * n, 1, [&](size_t begin, size_t end) {
      for (size_t p = begin; p < end; ++p) {
        const size_t i = p / n, j = p % n;
        if (i < j) pairs[p] = match(details_[i], {}, details_[j], 0);
      }
    });
    const auto alike = [&](size_t i, size_t j) {
      return pairs[std::min(i, j) * n + std::max(i, j)].peak;
    };
    std::vector<size_t> near(n, 0);  // of those that are placed, the one most alike
    std::vector<bool> placed(n);
    placed[0] = true;
    for (size_t step = 1; step < n; ++step) {
      size_t next = n;
      for (size_t j = 1; j < n; ++j) {
        if (placed[j]) continue;
        if (next == n || alike(near[j], j) > alike(near[next], next)) next = j;
      }
      const size_t from = near[next];
      const double lag = pairs[std::min(from, next) * n + std::max(from, next)].lag;
      places_[next] = places_[from] + (from < next ? lag : -lag);
      placed[next] = true;
      for (size_t j = 1; j < n; ++j) {
        if (!placed[j] && alike(next, j) > alike(near[j], j)) near[j] = next;
      }
    }
  }

  Match match(const Signal& a, const std::vector<uint8_t>& has, const Signal& b,
              std::ptrdiff_t first) const {
    const double least =
        std::max(kLeastOverlap * rate_, 0.5 * static_cast<double>(std::min(a.size(), b.size())));
    std::vector<double> values(static_cast<size_t>(2 * most_ + 1));
    double* const found = values.data();
    for (std::ptrdiff_t k = 0; k < 2 * most_ + 1; ++k) {
      found[k] = correlation(a, has, b, first + k - most_, least);
    }
    const auto at = std::max_element(values.begin(), values.end()) - values.begin();
    Match best;
    best.peak = found[at];
    best.lag = static_cast<double>(first + at - most_);
    if (best.peak < 0) return Match();
    if (at > 0 && at < 2 * most_ && found[at - 1] > -1 && found[at + 1] > -1) {
      const double bend = found[at - 1] - 2 * found[at] + found[at + 1];
      if (bend < 0) best.lag += 0.5 * (found[at - 1] - found[at + 1]) / bend;
    }
    const auto apart = static_cast<std::ptrdiff_t>(std::ceil(kApart * rate_));
    for (std::ptrdiff_t k = 0; k < 2 * most_ + 1; ++k) {
      if (std::abs(k - at) >= apart) best.elsewhere = std::max(best.elsewhere, found[k]);
    }
    return best;
  }

  // Where camera i fits the mean of the others, as these are placed.
  Match with_others(size_t i) const {
    double first = 0, last = 0;
    for (size_t j = 0; j < details_.size(); ++j) {
      first = std::min(first, -places_[j]);
      last = std::max(last, static_cast<double>(details_[j].size()) - places_[j]);
    }
    const auto begin = static_cast<std::ptrdiff_t>(std::floor(first));
    const auto size = static_cast<size_t>(static_cast<std::ptrdiff_t>(std::ceil(last)) - begin);
    Signal mean(size);
    std::vector<double> count(size);
    for (size_t j = 0; j < details_.size(); ++j) {
      if (j == i) continue;
      for (size_t k = 0; k < size; ++k) {
        const double at = static_cast<double>(begin + static_cast<std::ptrdiff_t>(k)) + places_[j];
        const double low = std::floor(at), part = at - low;
        if (low < 0 || low + 1 >= static_cast<double>(details_[j].size())) continue;
        const auto index = static_cast<size_t>(low);
        mean[k] += (1 - part) * details_[j][index] + part * details_[j][index + 1];
        ++count[k];
      }
    }
    std::vector<uint8_t> has(size);
    for (size_t k = 0; k < size; ++k) {
      has[k] = count[k] > 0 ? 1 : 0;
      if (has[k] != 0) mean[k] /= count[k];
    }
    const std::ptrdiff_t middle = begin + static_cast<std::ptrdiff_t>(std::lround(places_[i]));
    Match found = match(mean, has, details_[i], middle);
    if (found.peak < 0) return {places_[i], 0, 0};
    found.lag -= static_cast<double>(begin);
    return found;
  }

  const double rate_;
  const std::ptrdiff_t most_;  // in values
  const int threads_;
  std::vector<Signal> details_;
  std::vector<double> places_;  // in values: what the first camera has at k, another has at k + its
};

}  // namespace

bool Offset::is_sure() const { return correlation >= kSure && correlation - elsewhere >= kMargin; }

std::vector<Offset> align(const std::vector<Signal>& signals, double rate, double most,
                          uint32_t threads) {
  return Aligner(signals, rate, most, threads).run();
}

}  // namespace l4d::train
