// SPDX-License-Identifier: Apache-2.0
#include "eval/pair/nearest.h"

#include <algorithm>

namespace l4d::eval {
namespace {

constexpr uint32_t kLeafPoints = 12;
// Of a query whose true neighbour is near, a few hundred are visited.
constexpr size_t kMaxVisited = 6000;

}  // namespace

struct NearestTree::Search {
  const Feature& at;
  size_t k;
  std::vector<Neighbour>& heap;  // largest distance first
  size_t visited = 0;
  Feature offset{};  // distance to the current cell along each axis
  float cell_distance2 = 0;
};

NearestTree::NearestTree(const std::vector<Feature>& points, std::vector<uint32_t> subset)
    : points_(points), index_(std::move(subset)) {
  if (!index_.empty()) build(0, static_cast<uint32_t>(index_.size()));
}

uint32_t NearestTree::build(uint32_t begin, uint32_t end) {
  const auto id = static_cast<uint32_t>(nodes_.size());
  nodes_.push_back({begin, end, 0, 0, 0, 0});
  if (end - begin <= kLeafPoints) return id;
  Feature low = points_[index_[begin]];
  Feature high = low;
  for (uint32_t i = begin; i < end; ++i) {
    for (size_t f = 0; f < kFeatures; ++f) {
      low[f] = std::min(low[f], points_[index_[i]][f]);
      high[f] = std::max(high[f], points_[index_[i]][f]);
    }
  }
  uint32_t axis = 0;
  for (uint32_t f = 1; f < kFeatures; ++f) {
    if (high[f] - low[f] > high[axis] - low[axis]) axis = f;
  }
  if (!(high[axis] > low[axis])) return id;  // all equal
  const uint32_t middle = begin + (end - begin) / 2;
  // Ties by index keep the tree the same on every standard library.
  std::nth_element(index_.begin() + begin, index_.begin() + middle, index_.begin() + end,
                   [&](uint32_t x, uint32_t y) {
                     const float fx = points_[x][axis];
                     const float fy = points_[y][axis];
                     return fx != fy ? fx < fy : x < y;
                   });
  const float split = points_[index_[middle]][axis];
  const uint32_t left = build(begin, middle);
  const uint32_t right = build(middle, end);
  nodes_[id].left = left;
  nodes_[id].right = right;
  nodes_[id].axis = axis;
  nodes_[id].split = split;
  return id;
}

void NearestTree::visit(uint32_t node_id, Search& search) const {
  const Node& node = nodes_[node_id];
  if (node.left == 0) {
    for (uint32_t i = node.begin; i < node.end; ++i) {
      const Feature& p = points_[index_[i]];
      float sum = 0;
      for (size_t f = 0; f < kFeatures; ++f) {
        const float d = p[f] - search.at[f];
        sum += d * d;
      }
      const Neighbour candidate{sum, index_[i]};
      if (search.heap.size() < search.k) {
        search.heap.push_back(candidate);
        std::push_heap(search.heap.begin(), search.heap.end());
      } else if (candidate < search.heap.front()) {
        std::pop_heap(search.heap.begin(), search.heap.end());
        search.heap.back() = candidate;
        std::push_heap(search.heap.begin(), search.heap.end());
      }
    }
    search.visited += node.end - node.begin;
    return;
  }
  const float d = search.at[node.axis] - node.split;
  visit(d < 0 ? node.left : node.right, search);
  // The far side is at least |d| away along this axis, and as far as this cell along the others.
  const float old_offset = search.offset[node.axis];
  const float old_distance2 = search.cell_distance2;
  const float far_distance2 = old_distance2 - old_offset * old_offset + d * d;
  if (search.heap.size() == search.k &&
      (far_distance2 > search.heap.front().distance2 || search.visited > kMaxVisited)) {
    return;
  }
  search.offset[node.axis] = d;
  search.cell_distance2 = far_distance2;
  visit(d < 0 ? node.right : node.left, search);
  search.offset[node.axis] = old_offset;
  search.cell_distance2 = old_distance2;
}

void NearestTree::query(const Feature& at, size_t k, std::vector<Neighbour>& out) const {
  out.clear();
  if (index_.empty()) return;
  Search search{at, std::min(k, index_.size()), out, 0, {}, 0};
  visit(0, search);
  std::sort_heap(out.begin(), out.end());
}

}  // namespace l4d::eval
