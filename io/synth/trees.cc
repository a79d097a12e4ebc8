// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "io/synth/place.h"

namespace l4d::io::synth {
namespace {

constexpr int kClumps = 16;

struct Tree {
  Vec3 foot;
  double height, radius;
  int64_t leaves;
  double autumn;  // 0: green, 1: orange
};

Vec3 clump_of(const Place& place, const Tree& tree, uint64_t key, int64_t k) {
  const Vec3 way = unit({place.random(key, k, 1) - 0.5, place.random(key, k, 2) - 0.35,
                         place.random(key, k, 3) - 0.5});
  return tree.foot + kUp * tree.height +
         way * (tree.radius * (0.45 + 0.3 * place.random(key, k, 4)));
}

void grow(Place& place, const Tree& tree, uint64_t key) {
  const Vec3 top = tree.foot + kUp * (tree.height - tree.radius * 0.4);
  place.put(place.tube(tree.foot, top, 0.17 * tree.radius / 1.6, 0.06, 0.12),
            Vec3{0.13, 0.085, 0.055});
  for (int64_t k = 0; k < 5; ++k) {
    place.put(place.tube(top - kUp * 0.5, clump_of(place, tree, key, k), 0.06, 0.025, 0.12),
              Vec3{0.12, 0.08, 0.05});
  }
  const Vec3 heart = tree.foot + kUp * tree.height;
  if (!place.counting) place.light.ball(heart, tree.radius * 0.92, 0.30, {0.1, 0.12, 0.05});
  const double size = 0.046 * std::sqrt(tree.radius / 1.6) * place.density;
  const int64_t leaves = place.detailed(static_cast<double>(tree.leaves));
  if (!place.is_static) return;
  if (place.counting) {
    place.count += static_cast<uint64_t>(leaves);
    return;
  }
  for (int64_t i = 0; i < leaves; ++i) {
    const auto hash = [&](int64_t k) { return place.random(key + 100, i, k); };
    const int64_t which = static_cast<int64_t>(hash(20) * kClumps);
    const Vec3 way = unit({hash(21) - 0.5, hash(22) - 0.5, hash(23) - 0.5});
    const double far = tree.radius * 0.49 * (0.35 + 0.65 * std::sqrt(hash(24)));
    const Vec3 p = clump_of(place, tree, key, which) + way * far * Vec3{1, 0.85, 1};
    const Vec3 outside = unit(p - heart + kUp * 0.4);
    const double deep = smooth(0.35, 1.05, length(p - heart) / tree.radius);
    const double age = clamp(
        tree.autumn + 0.5 * (hash(25) - 0.5) + 0.5 * (place.random(key, which, 5) - 0.5), 0, 1);
    Dot d = place.leaf(p, outside, size, key + 200, i);
    d.n = unit(outside + way * 0.3);
    d.albedo = mix(Vec3{0.10, 0.17, 0.035}, Vec3{0.42, 0.20, 0.03}, age) *
               ((0.35 + 1.15 * deep) * (0.7 + 0.6 * hash(26)));
    place.put({d}, [](Dot&) {});
  }
}

}  // namespace

void make_trees(Place& place) {
  const Tree trees[] = {
      {{-9.3, 0, -6.3}, 3.9, 1.6, 6500, 0.25}, {{9.6, 0, -6.6}, 4.0, 1.6, 6500, 0.55},
      {{-10.2, 0, 4.6}, 4.4, 2.1, 9500, 0.70}, {{10.6, 0, 6.4}, 4.6, 2.2, 9500, 0.35},
      {{-7.0, 0, 11.0}, 4.2, 1.9, 5200, 0.20}, {{4.5, 0, 12.5}, 4.4, 2.0, 5200, 0.50}};
  uint64_t key = 5000;
  for (const Tree& tree : trees) grow(place, tree, key += 1000);
}

}  // namespace l4d::io::synth
