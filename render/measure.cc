// SPDX-License-Identifier: Apache-2.0
// Which views to measure a scene from, and when it has been enough.
#include "render/measure.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace l4d::render {
namespace {

// A round takes this share of an instant's cameras, at least one.
constexpr size_t kRoundShare = 16;
size_t round_share(size_t cameras) { return std::max<size_t>(1, cameras / kRoundShare); }
// Asking ends with a round that shows fewer than one in so many Gaussians for the first time.
constexpr uint64_t kFew = 2000;
// Ranks of this many Gaussians tell how well halves agree to three digits.
constexpr size_t kMostRanked = 1 << 17;
constexpr uint64_t kSecondHalf = uint64_t{1} << 63;

// Ranks of what is not zero in either half: weights that both call zero would agree for free.
std::vector<double> ranks(const std::vector<float>& values, const std::vector<uint32_t>& chosen) {
  std::vector<uint32_t> order(chosen.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto value = [&](uint32_t i) { return values[chosen[i]]; };
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return value(a) != value(b) ? value(a) < value(b) : a < b;
  });
  std::vector<double> rank(chosen.size());
  for (size_t i = 0; i < order.size();) {
    size_t end = i;
    while (end < order.size() && value(order[end]) == value(order[i])) ++end;
    for (size_t k = i; k < end; ++k) rank[order[k]] = 0.5 * static_cast<double>(i + end - 1);
    i = end;
  }
  return rank;
}

// Spearman's rank correlation, over Gaussians with a weight in either.
double rank_correlation(const std::vector<float>& a, const std::vector<float>& b) {
  std::vector<uint32_t> chosen;
  for (size_t i = 0; i < a.size(); ++i) {
    if (a[i] > 0 || b[i] > 0) chosen.push_back(static_cast<uint32_t>(i));
  }
  if (chosen.size() < 2) return 1;
  if (chosen.size() > kMostRanked) {
    for (size_t k = 0; k < kMostRanked; ++k) chosen[k] = chosen[k * chosen.size() / kMostRanked];
    chosen.resize(kMostRanked);
  }
  const std::vector<double> ra = ranks(a, chosen), rb = ranks(b, chosen);
  const double mean = 0.5 * static_cast<double>(chosen.size() - 1);
  double ab = 0, aa = 0, bb = 0;
  for (size_t i = 0; i < ra.size(); ++i) {
    ab += (ra[i] - mean) * (rb[i] - mean);
    aa += (ra[i] - mean) * (ra[i] - mean);
    bb += (rb[i] - mean) * (rb[i] - mean);
  }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 1;
}

// All views of one instant, in the order in which they get their turn.
struct InstantViews {
  double time;
  std::vector<uint32_t> cameras;
  size_t done = 0;
};

// The items in an order any prefix of which lies evenly among them: a walk around them from `first` by
// strides near the golden section.
template <typename Item>
std::vector<Item> spread(const std::vector<Item>& items, size_t first) {
  const size_t n = items.size();
  size_t stride = std::max<size_t>(1, static_cast<size_t>(0.618 * static_cast<double>(n)));
  while (std::gcd(stride, n) != 1) ++stride;
  std::vector<Item> out;
  out.reserve(n);
  for (size_t i = 0; i < n; ++i) out.push_back(items[(first + i * stride) % n]);
  return out;
}

// The cameras of neighbouring instants begin at different places, so that every round sees the scene
// from everywhere, and instants take turns too, so that a round that ends early has seen all times.
std::vector<InstantViews> schedule(const l4d_view* views, size_t num_views) {
  std::vector<size_t> order(num_views);
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return views[a].time != views[b].time ? views[a].time < views[b].time
                                          : views[a].camera < views[b].camera;
  });
  std::vector<InstantViews> instants;
  for (const size_t i : order) {
    if (instants.empty() || instants.back().time != views[i].time) {
      instants.push_back({views[i].time, {}, 0});
    }
    instants.back().cameras.push_back(views[i].camera);
  }
  for (size_t k = 0; k < instants.size(); ++k) {
    instants[k].cameras = spread(instants[k].cameras, k * 7);
  }
  return spread(instants, 0);
}

}  // namespace

Status measure(Renderer& renderer, const l4d_camera* cameras, uint32_t num_cameras,
               const l4d_view* views, size_t num_views, const l4d_measure_options& options,
               l4d_progress_fn progress, void* user, l4d_measure_report* report,
               std::unique_ptr<Sensitivity>* out) {
  if (!renderer.has_scene()) {
    return Status(L4D_ERR_INVALID_STATE, "importance needs the scene's Gaussians: set_gaussians");
  }
  if (num_views == 0) return invalid_argument("no views");
  for (size_t i = 0; i < num_views; ++i) {
    if (views[i].camera >= num_cameras) return invalid_argument("a view names a camera beyond the last");
    if (!std::isfinite(views[i].time)) return invalid_argument("the time of a view is not finite");
  }
  const Scene& scene = renderer.scene();
  l4d_sensitivity_options half_options = options.sensitivity;
  const bool whole = options.ranks != nullptr;
  const l4d_ranks ranks = whole ? *options.ranks : l4d_ranks{sizeof(l4d_ranks), 0, 1, nullptr, nullptr};
  auto first = std::make_unique<Sensitivity>(half_options, scene.count(),
                                             scene.gaussians().sh_degree, whole);
  half_options.seed ^= kSecondHalf;  // other signs
  Sensitivity second(half_options, scene.count(), scene.gaussians().sh_degree, whole);

  std::vector<InstantViews> instants = schedule(views, num_views);
  const bool can_stop = options.agreement <= 1;
  const bool in_rounds = can_stop || options.max_share < 1;
  const size_t most = std::max<size_t>(
      1, static_cast<size_t>(std::ceil(options.max_share * static_cast<double>(num_views))));
  const auto proceed = [&](const char* stage) {
    const uint64_t done = report->views_measured + report->views_asked;
    return progress == nullptr || progress(user, done, num_views, stage) == 0
               ? Status()
               : Status(L4D_ERR_CANCELLED, "cancelled");
  };
  report->views = num_views;
  bool more = true;
  while (more && !(report->agreed != 0) && report->views_measured < most) {
    more = false;
    for (size_t k = 0; k < instants.size() && report->views_measured < most; ++k) {
      InstantViews& instant = instants[k];
      const size_t share = in_rounds ? round_share(instant.cameras.size()) : instant.cameras.size();
      const size_t end = std::min(instant.cameras.size(), instant.done + share);
      const bool own = k % ranks.count == ranks.rank;
      if (own && instant.done < end) L4D_RETURN_IF_ERROR(renderer.set_time(instant.time));
      for (; instant.done < end && report->views_measured < most; ++instant.done) {
        // Halves take turns in cameras and in instants, so that neither sees a part of the scene alone.
        // A camera's turn comes at every other parity of k, so k counts by twos here.
        Sensitivity& half = ((k >> 1) + instant.done) % 2 == 0 ? *first : second;
        const l4d_camera& camera = cameras[instant.cameras[instant.done]];
        if (own) L4D_RETURN_IF_ERROR(half.add_view(renderer, camera, false));
        ++report->views_measured;
        L4D_RETURN_IF_ERROR(proceed("sensitivity"));
      }
      more = more || instant.done < instant.cameras.size();
    }
    ++report->rounds;
    if (!can_stop || report->views_measured < 2) continue;
    std::vector<float> a(scene.count()), b(scene.count());
    const Sensitivity* halves[2] = {first.get(), &second};
    std::unique_ptr<Sensitivity> shared[2];
    for (int half = 0; whole && half < 2; ++half) {
      L4D_RETURN_IF_ERROR(halves[half]->copy(&shared[half]));
      L4D_RETURN_IF_ERROR(shared[half]->share(ranks));
      halves[half] = shared[half].get();
    }
    double least = 1;
    for (uint32_t component = 0; component < L4D_COMPONENT_COUNT; ++component) {
      // The weights of a component have its number. A half without views has none yet.
      if (!halves[0]->weights(component, a.data()).ok() ||
          !halves[1]->weights(component, b.data()).ok()) {
        least = 0;
        break;
      }
      report->agreement[component] = rank_correlation(a, b);
      least = std::min(least, report->agreement[component]);
    }
    report->agreed = least >= options.agreement ? 1 : 0;
  }
  L4D_RETURN_IF_ERROR(first->merge(second));
  if (whole) L4D_RETURN_IF_ERROR(first->share(ranks));
  if (options.skip_unseen == 0) {
    std::unique_ptr<Sensitivity> asked;  // of this rank
    if (whole) {
      asked = std::make_unique<Sensitivity>(options.sensitivity, scene.count(),
                                            scene.gaussians().sh_degree, whole);
      asked->look_past(*first);
    }
    uint64_t unseen = 0;
    L4D_RETURN_IF_ERROR(first->count_unseen(&unseen));
    bool found_more = true;
    for (more = true; more && found_more;) {
      more = false;
      for (size_t k = 0; k < instants.size(); ++k) {
        InstantViews& instant = instants[k];
        if (instant.done == instant.cameras.size()) continue;
        const size_t end = options.ask_all != 0
                               ? instant.cameras.size()
                               : std::min(instant.cameras.size(),
                                          instant.done + round_share(instant.cameras.size()));
        const bool own = k % ranks.count == ranks.rank;
        if (own) L4D_RETURN_IF_ERROR(renderer.set_time(instant.time));
        for (; instant.done < end; ++instant.done) {
          const l4d_camera& camera = cameras[instant.cameras[instant.done]];
          if (own) L4D_RETURN_IF_ERROR((whole ? *asked : *first).add_view(renderer, camera, true));
          ++report->views_asked;
          L4D_RETURN_IF_ERROR(proceed("coverage"));
        }
        more = more || instant.done < instant.cameras.size();
      }
      if (!more) break;
      std::vector<int64_t> seen;
      L4D_RETURN_IF_ERROR((whole ? *asked : *first).seen(&seen));
      if (whole && ranks.sum != nullptr &&
          ranks.sum(ranks.user, seen.data(), seen.size()) != 0) {
        return Status(L4D_ERR_IO, "adding up what all ranks have seen failed");
      }
      const uint64_t before = unseen;
      unseen = static_cast<uint64_t>(std::count(seen.begin(), seen.end(), 0));
      found_more = (before - unseen) * kFew >= seen.size() && before > unseen;
    }
    if (whole) {
      L4D_RETURN_IF_ERROR(asked->share(ranks));
      L4D_RETURN_IF_ERROR(first->merge(*asked));
    }
  }
  L4D_RETURN_IF_ERROR(first->count_unseen(&report->unseen));
  *out = std::move(first);
  return {};
}

}  // namespace l4d::render
