// SPDX-License-Identifier: Apache-2.0
// Which views to measure a scene from, and when it has been enough.
#include "render/importance/measure.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "libl4dcodec/base/threads.h"

namespace l4d::render {
namespace {

// A round takes this share of an instant's cameras, at least one.
constexpr size_t kRoundShare = 16;
size_t round_share(size_t cameras) { return std::max<size_t>(1, cameras / kRoundShare); }
// The visibility pass ends where less than this of the light comes from Gaussians that are shown
// for the first time.
constexpr double kHardlyAny = 1e-4;
// Ranks of this many Gaussians give the agreement of halves to three digits.
constexpr size_t kMostRanked = 1 << 17;
constexpr uint64_t kSecondHalf = uint64_t{1} << 63;

// Ranks of what is not zero in either half: weights that both call zero would agree for free.
std::vector<double> group(const std::vector<float>& values, const std::vector<uint32_t>& chosen) {
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
  const std::vector<double> ra = group(a, chosen), rb = group(b, chosen);
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

// The items in an order any prefix of which lies evenly among them: a walk around them from `first`
// by strides near the golden section.
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

// The cameras of neighbouring instants begin at different places, so that every round sees the
// scene from everywhere, and instants take turns too, so that a round that ends early has seen all
// times.
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

// What the sums of a measurement are of.
l4d_sensitivity_options sums_of(const l4d_measure_options& options) {
  l4d_sensitivity_options sums{};
  sums.metric = options.metric;
  sums.seed = options.seed;
  return sums;
}

l4d_process_group one_process() {
  l4d_process_group group{};
  group.count = 1;
  return group;
}

// One call of l4d_measure_importance whose arguments are in order.
class Measurement {
 public:
  Measurement(Renderer& renderer, const l4d_camera* cameras, const l4d_view* views,
              size_t num_views, const l4d_measure_options& options, l4d_measure_report* report)
      : renderer_(renderer),
        cameras_(cameras),
        options_(options),
        whole_(options.group != nullptr),
        group_(whole_ ? *options.group : one_process()),
        instants_(schedule(views, num_views)),
        report_(*report) {
    report_.views = num_views;
    l4d_sensitivity_options half = sums_of(options);
    first_ = make_sums(half);
    half.seed ^= kSecondHalf;  // other signs
    second_ = make_sums(half);
  }

  // Sums must not go while a device is at them.
  ~Measurement() { static_cast<void>(renderer_.finish_importance()); }
  Measurement(const Measurement&) = delete;
  Measurement& operator=(const Measurement&) = delete;

  Status run(std::unique_ptr<Sensitivity>* out) {
    L4D_RETURN_IF_ERROR(measure_views());
    L4D_RETURN_IF_ERROR(first_->merge(*second_));
    if (whole_) L4D_RETURN_IF_ERROR(first_->share(group_));
    if (options_.skip_visibility == 0) L4D_RETURN_IF_ERROR(visibility_pass());
    L4D_RETURN_IF_ERROR(first_->count_unseen(&report_.unseen));
    *out = std::move(first_);
    return {};
  }

 private:
  std::unique_ptr<Sensitivity> make_sums(const l4d_sensitivity_options& options) const {
    const Scene& scene = renderer_.scene();
    return std::make_unique<Sensitivity>(options, scene.count(), scene.gaussians().sh_degree,
                                         whole_);
  }
  bool is_own(size_t instant) const { return instant % group_.count == group_.rank; }
  Status proceed(const char* stage) const {
    const uint64_t done = report_.views_measured + report_.views_visibility_only;
    const bool goes_on = options_.progress == nullptr ||
                         options_.progress(options_.progress_user, done, report_.views, stage) == 0;
    return goes_on ? Status() : Status(L4D_ERR_CANCELLED, "cancelled");
  }

  // Rounds of views with derivatives, until the halves agree.
  Status measure_views() {
    const bool can_stop = options_.agreement <= 1;
    const bool in_rounds = can_stop || options_.max_share < 1;
    const double most_views = std::ceil(options_.max_share * static_cast<double>(report_.views));
    const size_t most = std::max<size_t>(1, static_cast<size_t>(most_views));
    bool more = true;
    while (more && report_.agreed == 0 && report_.views_measured < most) {
      more = false;
      for (size_t k = 0; k < instants_.size() && report_.views_measured < most; ++k) {
        InstantViews& instant = instants_[k];
        const size_t all = instant.cameras.size();
        const size_t end = std::min(all, instant.done + (in_rounds ? round_share(all) : all));
        if (is_own(k) && instant.done < end) {
          L4D_RETURN_IF_ERROR(renderer_.set_time(instant.time));
        }
        for (; instant.done < end && report_.views_measured < most; ++instant.done) {
          // Halves take turns in cameras and in instants, so that neither sees a part of the scene
          // alone. A camera's turn comes at every other parity of k, so k counts by twos here.
          Sensitivity& half = ((k >> 1) + instant.done) % 2 == 0 ? *first_ : *second_;
          const l4d_camera& camera = cameras_[instant.cameras[instant.done]];
          if (is_own(k)) L4D_RETURN_IF_ERROR(half.add_view(renderer_, camera, false, false));
          ++report_.views_measured;
          L4D_RETURN_IF_ERROR(proceed("sensitivity"));
        }
        more = more || instant.done < all;
      }
      ++report_.rounds;
      L4D_RETURN_IF_ERROR(renderer_.finish_importance());
      if (can_stop && report_.views_measured >= 2) L4D_RETURN_IF_ERROR(compare_halves());
    }
    return {};
  }

  Status compare_halves() {
    const Sensitivity* halves[2] = {first_.get(), second_.get()};
    std::unique_ptr<Sensitivity> shared[2];
    for (int half = 0; whole_ && half < 2; ++half) {
      L4D_RETURN_IF_ERROR(halves[half]->copy(&shared[half]));
      L4D_RETURN_IF_ERROR(shared[half]->share(group_));
      halves[half] = shared[half].get();
    }
    // The weights of a component have its number. A half without views has none yet.
    std::vector<float> weights[L4D_COMPONENT_COUNT][2];
    for (uint32_t component = 0; component < L4D_COMPONENT_COUNT; ++component) {
      for (int half = 0; half < 2; ++half) {
        std::vector<float>& w = weights[component][half];
        w.resize(first_->count());
        if (!halves[half]->weights(component, w.data()).ok()) return {};
      }
    }
    parallel_for(renderer_.threads(), L4D_COMPONENT_COUNT, 1, [&](size_t component, size_t) {
      report_.agreement[component] = rank_correlation(weights[component][0], weights[component][1]);
    });
    const double least =
        *std::min_element(report_.agreement, report_.agreement + L4D_COMPONENT_COUNT);
    report_.agreed = least >= options_.agreement ? 1 : 0;
    return {};
  }

  // What the views that are left show, until that is hardly any light of Gaussians not seen before.
  Status visibility_pass() {
    std::unique_ptr<Sensitivity> own;  // of this rank
    if (whole_) {
      own = make_sums(sums_of(options_));
      own->exclude_seen(*first_);
    }
    Sensitivity& sums = whole_ ? *own : *first_;
    std::vector<uint8_t> known;
    std::vector<int64_t> shown;
    L4D_RETURN_IF_ERROR(first_->seen(&known));
    double news = 1;  // share of the light of a round's images
    for (bool more = true; more && news >= kHardlyAny;) {
      more = false;
      double pixels = 0;
      for (size_t k = 0; k < instants_.size(); ++k) {
        InstantViews& instant = instants_[k];
        const size_t all = instant.cameras.size();
        if (instant.done == all) continue;
        const size_t end =
            std::min(all, instant.done + (options_.visibility_all != 0 ? all : round_share(all)));
        if (is_own(k)) L4D_RETURN_IF_ERROR(renderer_.set_time(instant.time));
        for (; instant.done < end; ++instant.done) {
          const l4d_camera& camera = cameras_[instant.cameras[instant.done]];
          if (is_own(k)) L4D_RETURN_IF_ERROR(sums.add_view(renderer_, camera, true, false));
          pixels += static_cast<double>(camera.width) * camera.height;
          ++report_.views_visibility_only;
          L4D_RETURN_IF_ERROR(proceed("coverage"));
        }
        more = more || instant.done < all;
      }
      if (!more) break;
      L4D_RETURN_IF_ERROR(renderer_.finish_importance());
      L4D_RETURN_IF_ERROR(sums.visible_only(&shown));
      if (group_.count > 1 && group_.sum(group_.user, shown.data(), shown.size()) != 0) {
        return Status(L4D_ERR_IO, "adding up what all ranks have seen failed");
      }
      double light = 0;
      for (size_t i = 0; i < known.size(); ++i) {
        if (known[i] != 0 || shown[i] == 0) continue;
        known[i] = 1;
        light += static_cast<double>(shown[i]);
      }
      news = light * Sensitivity::visible_only_unit() / pixels;
    }
    L4D_RETURN_IF_ERROR(renderer_.finish_importance());
    if (!whole_) return {};
    L4D_RETURN_IF_ERROR(own->share(group_));
    return first_->merge(*own);
  }

  Renderer& renderer_;
  const l4d_camera* const cameras_;
  const l4d_measure_options& options_;
  const bool whole_;  // sums are whole numbers
  const l4d_process_group group_;
  std::vector<InstantViews> instants_;
  std::unique_ptr<Sensitivity> first_, second_;  // halves of the views
  l4d_measure_report& report_;
};

}  // namespace

Status measure(Renderer& renderer, const l4d_camera* cameras, uint32_t num_cameras,
               const l4d_view* views, size_t num_views, const l4d_measure_options& options,
               l4d_measure_report* report, std::unique_ptr<Sensitivity>* out) {
  if (!renderer.has_scene()) {
    return Status(L4D_ERR_INVALID_STATE, "importance needs the scene's Gaussians: set_gaussians");
  }
  if (num_views == 0) return invalid_argument("no views");
  for (size_t i = 0; i < num_views; ++i) {
    if (views[i].camera >= num_cameras)
      return invalid_argument("a view names a camera beyond the last");
    if (!std::isfinite(views[i].time)) return invalid_argument("the time of a view is not finite");
  }
  return Measurement(renderer, cameras, views, num_views, options, report).run(out);
}

}  // namespace l4d::render
