// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace l4d::eval {

// Features of a Gaussian, scaled so that a distance of 1 means "about as far apart as two random
// Gaussians of the scene are in the features that matter".
constexpr size_t kFeatures = 10;
using Feature = std::array<float, kFeatures>;

struct Neighbour {
  float distance2;
  uint32_t index;
  bool operator<(const Neighbour& other) const {
    return distance2 != other.distance2 ? distance2 < other.distance2 : index < other.index;
  }
};

// A k-d tree over some of the points. Queries visit a bounded number of points, so that scenes with
// nothing in common take no quadratic time; where the bound bites, neighbours are approximate.
class NearestTree {
 public:
  // `points` must outlive the tree; `subset` are the indices to search.
  NearestTree(const std::vector<Feature>& points, std::vector<uint32_t> subset);
  // The k nearest, by rising distance. `out` is overwritten.
  void query(const Feature& at, size_t k, std::vector<Neighbour>& out) const;

 private:
  struct Node {
    uint32_t begin, end;   // range of index_
    uint32_t left, right;  // children; 0 for a leaf
    uint32_t axis;
    float split;
  };
  struct Search;

  uint32_t build(uint32_t begin, uint32_t end);
  void visit(uint32_t node, Search& search) const;

  const std::vector<Feature>& points_;
  std::vector<uint32_t> index_;
  std::vector<Node> nodes_;
};

}  // namespace l4d::eval
