// SPDX-License-Identifier: Apache-2.0
#include "encoder/plan/tiers.h"

#include <algorithm>
#include <numeric>
#include <set>
#include <utility>

#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

// The tier of each Gaussian of the scene that belongs to level 0, from the shares of them all.
std::vector<uint8_t> tiers_of(const EncoderScene& scene, const std::vector<double>& shares,
                              const std::vector<LayerPlan>& plans) {
  std::vector<uint32_t> order;
  for (const LayerPlan& plan : plans) {
    if (plan.level == 0) order.insert(order.end(), plan.gaussians.begin(), plan.gaussians.end());
  }
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    const float x = scene.light[a], y = scene.light[b];
    return x != y ? x > y : a < b;
  });
  std::vector<uint8_t> tiers(scene.count);
  size_t at = 0;
  for (size_t tier = 0; tier <= shares.size(); ++tier) {
    const double share = tier < shares.size() ? shares[tier] : 1.0;
    const size_t end = static_cast<size_t>(share * static_cast<double>(order.size()));
    for (; at < end; ++at) tiers[order[at]] = static_cast<uint8_t>(tier);
  }
  return tiers;
}

std::vector<LayerPlan> cut(const LayerPlan& plan, const std::vector<uint8_t>& tiers,
                           size_t num_tiers, double least) {
  std::vector<LayerPlan> parts(num_tiers, plan);
  for (size_t tier = 0; tier < num_tiers; ++tier) {
    parts[tier].tier = static_cast<unsigned>(tier);
    parts[tier].gaussians.clear();
  }
  // Few of a tier are shown with the tier before.
  std::vector<size_t> counts(num_tiers);
  for (const uint32_t i : plan.gaussians) ++counts[tiers[i]];
  std::vector<size_t> part_of(num_tiers);
  for (size_t tier = 1; tier < num_tiers; ++tier) {
    part_of[tier] = static_cast<double>(counts[tier]) < least ? part_of[tier - 1] : tier;
  }
  for (const uint32_t i : plan.gaussians) parts[part_of[tiers[i]]].gaussians.push_back(i);
  // The first takes what moves to it from finer levels.
  parts.erase(std::remove_if(parts.begin() + 1, parts.end(),
                             [](const LayerPlan& p) { return p.gaussians.empty(); }),
              parts.end());
  return parts;
}

}  // namespace

std::vector<LayerPlan> cut_into_tiers(const EncoderScene& scene, const EncoderSettings& settings,
                                      double least, std::vector<LayerPlan> plans) {
  std::vector<double> shares = settings.tiers();
  // Gaussians that are stored as they are may take a layer for each level and kind.
  std::set<std::pair<unsigned, bool>> escapes;
  for (const LayerPlan& plan : plans) escapes.insert({plan.level, plan.flat});
  const size_t most = max_layers(scene.timeline.num_frames);
  for (; !shares.empty(); shares.pop_back()) {
    const std::vector<uint8_t> tiers = tiers_of(scene, shares, plans);
    std::vector<LayerPlan> out;
    for (const LayerPlan& plan : plans) {
      if (plan.level > 0) {
        out.push_back(plan);
        continue;
      }
      for (LayerPlan& part : cut(plan, tiers, shares.size() + 1, least)) {
        out.push_back(std::move(part));
      }
    }
    if (out.size() + escapes.size() <= most) return out;
  }
  return plans;
}

}  // namespace l4d
