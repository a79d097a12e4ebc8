// SPDX-License-Identifier: Apache-2.0
#include "eval/pair/stated_pairing.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "eval/pair/nearest.h"
#include "eval/parallel.h"
#include "l4d/experimental/inspect.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::eval {
namespace {

// What is measured here and what is stated are rounded to float32.
constexpr double kRounding = 1 + 1e-5;
constexpr size_t kFirstCandidates = 8;
constexpr size_t kMostCandidates = 512;

// Features are in units of what coding usually leaves of them.
constexpr double kSizes = 0.2;   // of positions
constexpr double kTimes = 0.02;  // of the sequence
constexpr double kLogSize = 0.1;
constexpr double kOpacity = 0.05;
constexpr double kColour = 0.05;

// Gaussians of A that one of B may be, from trees over those of about the same size: the scale of
// positions is that of the Gaussians.
class Candidates {
 public:
  Candidates(const PairMeter& meter, const l4d_coding_errors& stated, uint32_t threads)
      : meter_(meter), stated_(stated), min_size_(meter.min_size()), features_(meter.a().count()) {
    std::vector<int> octaves(features_.size());
    for_each_block(features_.size(), threads, [&](size_t, size_t first, size_t last) {
      for (size_t i = first; i < last; ++i) {
        const Motion m = meter.motion_a(i);
        octaves[i] = octave(size_of(m));
        features_[i] = feature_of(meter.a(), i, m, octaves[i]);
      }
    });
    std::map<int, std::vector<uint32_t>> members;
    for (uint32_t i = 0; i < octaves.size(); ++i) members[octaves[i]].push_back(i);
    for (auto& [key, these] : members) trees_.try_emplace(key, features_, std::move(these));
  }

  // Those of the `k` nearest of each size that Gaussian j of B may be, nearest first.
  void find(size_t j, size_t k, std::vector<Neighbour>* out) const {
    out->clear();
    const Motion b = meter_.motion_b(j);
    // A variance changes by the stated factor at most, where minimum sizes are those of the scene.
    const double factor = std::sqrt(stated_.covariance) * kRounding;
    const double size = size_of(b);
    auto tree = trees_.begin(), last = trees_.end();
    if (stated_.own_min_sizes == 0) {
      tree = trees_.lower_bound(octave(size / factor));
      last = trees_.upper_bound(octave(size * factor));
    }
    std::vector<Neighbour> near;
    for (; tree != last; ++tree) {
      tree->second.query(feature_of(meter_.b(), j, b, tree->first), k, near);
      for (const Neighbour& n : near) {
        if (is_within(n.index, j, b)) out->push_back(n);
      }
    }
    std::sort(out->begin(), out->end());
  }

 private:
  static int octave(double size) { return std::ilogb(std::max(size, 1e-30)); }
  double size_of(const Motion& m) const {
    return std::sqrt(m.covariance[0] + m.covariance[3] + m.covariance[5] +
                     3 * min_size_ * min_size_);
  }

  Feature feature_of(const io::Scene& scene, size_t index, const Motion& m, int octave) const {
    const double t = std::clamp(m.mean_t, meter_.begin(), meter_.end());
    const io::Vec3 at = m.at(t);
    Feature f{};
    for (size_t k = 0; k < 3; ++k) {
      f[k] = static_cast<float>(at[k] / std::ldexp(kSizes, octave));
    }
    const double duration = std::max(meter_.end() - meter_.begin(), 1e-30);
    f[3] = static_cast<float>((t - meter_.begin()) / (kTimes * duration));
    f[4] = static_cast<float>(std::log(std::min(m.sigma_t / duration, 1.0) + 1e-9));
    f[5] = static_cast<float>(linear_opacity(scene, index) * falloff(m.lambda, t - m.mean_t) /
                              kOpacity);
    f[6] = static_cast<float>(std::log(size_of(m)) / kLogSize);
    const size_t stride = 3 * scene.sh_coefficients();
    for (size_t k = 0; k < 3; ++k) {
      f[7 + k] = static_cast<float>(sh_constant::k0 *
                                    static_cast<double>(scene.sh[index * stride + k]) / kColour);
    }
    for (float& value : f) {
      if (!std::isfinite(value)) value = 0;
    }
    return f;
  }

  // Whether B's Gaussian differs from A's by no more than is stated; what tells most comes first.
  bool is_within(size_t i, size_t j, const Motion& b) const {
    if (stated_.colors_stated != 0) {
      const ColorErrors colors = meter_.colors(i, j);
      if (!(colors.base <= stated_.base_color * kRounding)) return false;
      if (!(colors.directional <= stated_.directional_color * kRounding)) return false;
    }
    const Motion a = meter_.motion_a(i);
    float distances[kSamples] = {};
    meter_.visible(a, b, distances);
    for (const float d : distances) {
      if (!(static_cast<double>(d) <= stated_.visible * kRounding)) return false;
    }
    const SeenErrors seen = meter_.seen(i, a, j, b);
    return seen.position <= stated_.position * kRounding &&
           seen.covariance <= stated_.covariance * kRounding &&
           seen.opacity <= stated_.opacity * kRounding;
  }

  const PairMeter& meter_;
  const l4d_coding_errors& stated_;
  double min_size_;
  std::vector<Feature> features_;
  std::map<int, NearestTree> trees_;  // by octave
};

struct Edge {
  float distance2;
  uint32_t a, b;
  bool operator<(const Edge& o) const {
    if (distance2 != o.distance2) return distance2 < o.distance2;
    return a != o.a ? a < o.a : b < o.b;
  }
};

// A matching that grows: nearest pairs first, then by paths along which pairs change.
class Matching {
 public:
  Matching(const Candidates& candidates, size_t count_a, size_t count_b)
      : candidates_(candidates),
        edges_(count_b),
        width_(count_b, kFirstCandidates),
        b_of_a_(count_a, kUnmatched),
        a_of_b_(count_b, kUnmatched),
        reached_from_(count_a, kUnmatched),
        reached_in_(count_a) {}

  void pair_nearest(uint32_t threads, const Observer& observer) {
    std::vector<std::vector<Edge>> found(num_blocks(edges_.size()));
    for_each_block(edges_.size(), threads, [&](size_t block, size_t first, size_t last) {
      observer.check();
      std::vector<Neighbour> near;
      for (size_t j = first; j < last; ++j) {
        candidates_.find(j, kFirstCandidates, &near);
        set_edges(j, near);
        for (const Neighbour& n : near) {
          found[block].push_back({n.distance2, n.index, static_cast<uint32_t>(j)});
        }
      }
    });
    std::vector<Edge> all;
    for (std::vector<Edge>& block : found) {
      all.insert(all.end(), block.begin(), block.end());
      block = {};
    }
    std::sort(all.begin(), all.end());
    for (const Edge& e : all) {
      if (b_of_a_[e.a] == kUnmatched && a_of_b_[e.b] == kUnmatched) pair(e.a, e.b);
    }
  }

  // False if one of B's Gaussians has no partner however the others are paired.
  bool complete(const Observer& observer) {
    for (uint32_t j = 0; j < a_of_b_.size(); ++j) {
      while (a_of_b_[j] == kUnmatched) {
        observer.check();
        const std::vector<uint32_t> stuck = augment(j);
        if (!stuck.empty() && !widen(stuck)) return false;
      }
    }
    return true;
  }

  std::vector<uint32_t> take() { return std::move(a_of_b_); }

 private:
  void pair(uint32_t a, uint32_t b) {
    b_of_a_[a] = b;
    a_of_b_[b] = a;
  }
  void set_edges(size_t j, const std::vector<Neighbour>& near) {
    edges_[j].clear();
    for (const Neighbour& n : near) edges_[j].push_back(n.index);
  }

  // Gives j a partner, by the shortest chain of changes. Returns nothing, or, if there is no such
  // chain, all of B's Gaussians whose candidates were of no help.
  std::vector<uint32_t> augment(uint32_t j) {
    ++round_;
    std::vector<uint32_t> queue = {j};
    for (size_t k = 0; k < queue.size(); ++k) {
      for (const uint32_t a : edges_[queue[k]]) {
        if (reached_in_[a] == round_) continue;
        reached_in_[a] = round_;
        reached_from_[a] = queue[k];
        if (b_of_a_[a] != kUnmatched) {
          queue.push_back(b_of_a_[a]);
          continue;
        }
        for (uint32_t free = a;;) {
          const uint32_t b = reached_from_[free], before = a_of_b_[b];
          pair(free, b);
          if (b == j) return {};
          free = before;
        }
      }
    }
    return queue;
  }

  bool widen(const std::vector<uint32_t>& stuck) {
    bool any = false;
    std::vector<Neighbour> near;
    for (const uint32_t j : stuck) {
      if (width_[j] >= kMostCandidates) continue;
      any = true;
      width_[j] *= 4;
      candidates_.find(j, width_[j], &near);
      set_edges(j, near);
    }
    return any;
  }

  const Candidates& candidates_;
  std::vector<std::vector<uint32_t>> edges_;  // of each of B's: Gaussians of A
  std::vector<size_t> width_;
  std::vector<uint32_t> b_of_a_, a_of_b_;
  std::vector<uint32_t> reached_from_, reached_in_;  // by A's, in the round
  uint32_t round_ = 0;
};

}  // namespace

bool pair_as_stated(const PairMeter& meter, const l4d_coding_errors& stated, uint32_t threads,
                    const Observer& observer, Pairing* pairing) {
  if (stated.stated == 0 || meter.b().count() > meter.a().count()) return false;
  const Candidates candidates(meter, stated, threads);
  Matching matching(candidates, meter.a().count(), meter.b().count());
  matching.pair_nearest(threads, observer);
  if (!matching.complete(observer)) return false;
  pairing->match = "stated";
  pairing->a_of_b = matching.take();
  pairing->matched = pairing->a_of_b.size();
  return true;
}

}  // namespace l4d::eval
