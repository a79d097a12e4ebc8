// SPDX-License-Identifier: Apache-2.0
#include "training/sync/align.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/base/threads.h"
#include "training/sync/correlate.h"

namespace l4d::train {
namespace {

constexpr double kMargin = 0.1;
constexpr double kAgree = 0.1;  // s
constexpr int kRounds = 3;

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

class Aligner {
 public:
  Aligner(const std::vector<Signal>& signals, double rate, double most, uint32_t threads)
      : rate_(rate),
        most_(static_cast<std::ptrdiff_t>(std::ceil(most * rate))),
        threads_(static_cast<int>(threads)) {
    for (const Signal& signal : signals) details_.push_back(detail_of(signal, rate));
  }

  std::vector<Offset> run() {
    const size_t n = details_.size();
    std::vector<Offset> offsets(n);
    if (n < 2) return offsets;
    compare();
    std::vector<double> places = placed_without(n), next(n);
    for (int round = 0; round < kRounds; ++round) {
      parallel_for(threads_, n, 1, [&](size_t begin, size_t end) {
        for (size_t i = begin; i < end; ++i) next[i] = with_others(i, places, nullptr).lag;
      });
      places = next;
    }
    // The others are where they fit this one best, so that they fit it in any case. Whether
    // it has anything in common with them shows where it fits them as they are without it.
    const double middle = median(places);
    parallel_for(threads_, n, 1, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const std::vector<double> apart = placed_without(i);
        const Match found = with_others(i, apart, &offsets[i].chance);
        offsets[i].seconds = (middle - places[i]) / rate_;
        offsets[i].correlation = found.peak;
        offsets[i].elsewhere = found.elsewhere;
        const double here = places[i] - median(without(places, i));
        const double there = found.lag - apart[i];
        offsets[i].agrees = std::abs(here - there) <= kAgree * rate_;
      }
    });
    return offsets;
  }

 private:
  static std::vector<double> without(std::vector<double> values, size_t i) {
    values.erase(values.begin() + static_cast<std::ptrdiff_t>(i));
    return values;
  }

  void compare() {
    const size_t n = details_.size();
    pairs_.resize(n * n);
    parallel_for(threads_, n * n, 1, [&](size_t begin, size_t end) {
      for (size_t p = begin; p < end; ++p) {
        const size_t i = p / n, j = p % n;
        if (i < j) pairs_[p] = match(details_[i], {}, details_[j], 0, most_, rate_);
      }
    });
  }

  // Along the pairs that are most alike; `none` of them, which gets the median of the others, is
  // left out.
  std::vector<double> placed_without(size_t none) const {
    const size_t n = details_.size(), first = none == 0 ? 1 : 0;
    std::vector<double> places(n);
    const auto pair = [&](size_t i, size_t j) -> const Match& {
      return pairs_[std::min(i, j) * n + std::max(i, j)];
    };
    std::vector<size_t> near(n, first);  // of those that are placed, the one most alike
    std::vector<bool> placed(n);
    placed[first] = true;
    if (none < n) placed[none] = true;
    for (;;) {
      size_t next = n;
      for (size_t j = 0; j < n; ++j) {
        if (placed[j]) continue;
        if (next == n || pair(near[j], j).peak > pair(near[next], next).peak) next = j;
      }
      if (next == n) break;
      const size_t from = near[next];
      const double lag = pair(from, next).lag;
      places[next] = places[from] + (from < next ? lag : -lag);
      placed[next] = true;
      for (size_t j = 0; j < n; ++j) {
        if (!placed[j] && pair(next, j).peak > pair(near[j], j).peak) near[j] = next;
      }
    }
    if (none < n) places[none] = median(without(places, none));
    return places;
  }

  // Where camera i fits the mean of the others, as these are placed. by_chance: null, or gets the
  // peak that would be chance, where there is one.
  Match with_others(size_t i, const std::vector<double>& places, double* by_chance) const {
    double first = 0, last = 0;
    for (size_t j = 0; j < details_.size(); ++j) {
      first = std::min(first, -places[j]);
      last = std::max(last, static_cast<double>(details_[j].size()) - places[j]);
    }
    const auto begin = static_cast<std::ptrdiff_t>(std::floor(first));
    const auto size = static_cast<size_t>(static_cast<std::ptrdiff_t>(std::ceil(last)) - begin);
    Signal mean(size);
    std::vector<double> count(size);
    for (size_t j = 0; j < details_.size(); ++j) {
      if (j == i) continue;
      for (size_t k = 0; k < size; ++k) {
        const double at = static_cast<double>(begin + static_cast<std::ptrdiff_t>(k)) + places[j];
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
    const std::ptrdiff_t middle = begin + static_cast<std::ptrdiff_t>(std::lround(places[i]));
    Match found = match(mean, has, details_[i], middle, most_, rate_);
    if (found.peak < 0) return {places[i], 0, 0, 0};
    if (by_chance != nullptr) *by_chance = chance(found, mean, has, details_[i], rate_);
    found.lag -= static_cast<double>(begin);
    return found;
  }

  const double rate_;
  const std::ptrdiff_t most_;  // in values
  const int threads_;
  std::vector<Signal> details_;
  std::vector<Match> pairs_;  // [i * n + j], i < j
};

}  // namespace

bool Offset::is_sure() const {
  return agrees && correlation >= chance && correlation - elsewhere >= kMargin;
}

std::vector<Offset> align(const std::vector<Signal>& signals, double rate, double most,
                          uint32_t threads) {
  return Aligner(signals, rate, most, threads).run();
}

}  // namespace l4d::train
