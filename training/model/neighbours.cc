// SPDX-License-Identifier: Apache-2.0
#include "training/model/neighbours.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "libl4dcodec/base/threads.h"

namespace l4d::train {
namespace {

constexpr size_t kLeaf = 8;

// A tree of medians over the points: nodes are ranges of `order`.
class Tree {
 public:
  Tree(const std::vector<float>& positions, size_t dim)
      : positions_(positions), dim_(dim), order_(positions.size() / dim) {
    std::iota(order_.begin(), order_.end(), size_t{0});
    split(0, order_.size(), 0);
  }

  // The k nearest others of point i, in `nearest` [k], ascending.
  void find(size_t i, size_t k, std::vector<Neighbour>* nearest) const {
    nearest->assign(k, {HUGE_VAL, i});
    visit(i, 0, order_.size(), 0, nearest);
  }

 private:
  double at(size_t i, size_t axis) const {
    return static_cast<double>(positions_[dim_ * i + axis]);
  }

  void split(size_t begin, size_t end, size_t axis) {
    if (end - begin <= kLeaf) return;
    const size_t middle = (begin + end) / 2;
    const auto first = order_.begin();
    std::nth_element(first + static_cast<ptrdiff_t>(begin), first + static_cast<ptrdiff_t>(middle),
                     first + static_cast<ptrdiff_t>(end), [&](size_t a, size_t b) {
                       return at(a, axis) != at(b, axis) ? at(a, axis) < at(b, axis) : a < b;
                     });
    split(begin, middle, (axis + 1) % dim_);
    split(middle + 1, end, (axis + 1) % dim_);
  }

  void look(size_t i, size_t other, std::vector<Neighbour>* nearest) const {
    if (i == other) return;
    double square = 0;
    for (size_t c = 0; c < dim_; ++c) {
      square += (at(i, c) - at(other, c)) * (at(i, c) - at(other, c));
    }
    if (square >= nearest->back().square) return;
    nearest->back() = {square, other};
    for (size_t k = nearest->size() - 1; k > 0 && (*nearest)[k].square < (*nearest)[k - 1].square;
         --k) {
      std::swap((*nearest)[k], (*nearest)[k - 1]);
    }
  }

  void visit(size_t i, size_t begin, size_t end, size_t axis,
             std::vector<Neighbour>* nearest) const {
    if (end - begin <= kLeaf) {
      for (size_t k = begin; k < end; ++k) look(i, order_[k], nearest);
      return;
    }
    const size_t middle = (begin + end) / 2;
    look(i, order_[middle], nearest);
    const double d = at(i, axis) - at(order_[middle], axis);
    const size_t next = (axis + 1) % dim_;
    if (d <= 0) {
      visit(i, begin, middle, next, nearest);
      if (d * d < nearest->back().square) visit(i, middle + 1, end, next, nearest);
    } else {
      visit(i, middle + 1, end, next, nearest);
      if (d * d < nearest->back().square) visit(i, begin, middle, next, nearest);
    }
  }

  const std::vector<float>& positions_;
  const size_t dim_;
  std::vector<size_t> order_;
};

}  // namespace

void for_each_neighbourhood(
    const std::vector<float>& positions, size_t dim, size_t k,
    const std::function<void(size_t i, const std::vector<Neighbour>& nearest)>& body) {
  const size_t n = positions.size() / dim;
  const size_t neighbours = std::min<size_t>(k, n > 0 ? n - 1 : 0);
  if (neighbours == 0) return;
  const Tree tree(positions, dim);
  parallel_for(0, n, 1024, [&](size_t begin, size_t end) {
    std::vector<Neighbour> nearest;
    for (size_t i = begin; i < end; ++i) {
      tree.find(i, neighbours, &nearest);
      body(i, nearest);
    }
  });
}

std::vector<float> neighbour_distance(const std::vector<float>& positions, uint32_t k) {
  std::vector<float> out(positions.size() / 3, 0);
  for_each_neighbourhood(positions, 3, k, [&](size_t i, const std::vector<Neighbour>& nearest) {
    double sum = 0;
    for (const Neighbour& n : nearest) sum += n.square;
    out[i] = static_cast<float>(std::sqrt(sum / static_cast<double>(nearest.size())));
  });
  return out;
}

}  // namespace l4d::train
