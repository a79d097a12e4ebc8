// SPDX-License-Identifier: Apache-2.0
#include "encoder/search/nearest_index.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace l4d {
namespace {

constexpr size_t kFan = NearestIndex::kFan;

// The share of the codebook's energy that may stay behind the leading coordinates. Measured on SH
// of trained scenes: 1 % leaves about two codewords per point to be looked at in full.
constexpr double kTailEnergy = 0.01;
constexpr size_t kMaxLead = 24;

hwy::AlignedFreeUniquePtr<float[]> make_floats(size_t count, float value) {
  auto p = hwy::AllocateAligned<float>(std::max<size_t>(count, 1));
  std::fill_n(p.get(), std::max<size_t>(count, 1), value);
  return p;
}

// [k, dim] coordinates along the axes.
std::vector<double> rotate_codebook(const NearestIndex& index) {
  const size_t dim = index.dim;
  std::vector<double> out(index.k * dim, 0.0);
  for (size_t c = 0; c < index.k; ++c) {
    const float* row = index.codebook + c * dim;
    double* to = out.data() + c * dim;
    if (!index.rotated()) {
      std::copy_n(row, dim, to);
      continue;
    }
    for (size_t d = 0; d < dim; ++d) {
      const double centred = static_cast<double>(row[d]) - static_cast<double>(index.axes.mean[d]);
      const float* axis = index.axes.basis.data() + d * index.axes.stride;
      for (size_t j = 0; j < dim; ++j) to[j] += centred * static_cast<double>(axis[j]);
    }
  }
  return out;
}

void choose_lead(NearestIndex& index, const std::vector<double>& rotated) {
  const size_t dim = index.dim;
  if (index.plain()) {
    index.lead = dim;
    index.box_dim = dim;
    return;
  }
  std::vector<double> mean(dim, 0.0), energy(dim, 0.0);
  for (size_t c = 0; c < index.k; ++c) {
    for (size_t j = 0; j < dim; ++j) mean[j] += rotated[c * dim + j];
  }
  for (double& m : mean) m /= static_cast<double>(index.k);
  for (size_t c = 0; c < index.k; ++c) {
    for (size_t j = 0; j < dim; ++j) {
      const double e = rotated[c * dim + j] - mean[j];
      energy[j] += e * e;
    }
  }
  const double total = std::accumulate(energy.begin(), energy.end(), 0.0);
  double left = total;
  size_t lead = 0;
  while (lead < dim && lead < kMaxLead &&
         (lead < NearestIndex::kMaxBoxDim || left > kTailEnergy * total)) {
    for (size_t j = lead; j < std::min(dim, lead + 4); ++j) left -= energy[j];
    lead = std::min(dim, lead + 4);
  }
  index.lead = lead;
  index.has_tail = lead < dim;
  index.box_dim = std::min(lead, NearestIndex::kMaxBoxDim);
}

// [k, sketch_dim]
std::vector<float> make_sketches(const NearestIndex& index, const std::vector<double>& rotated) {
  const size_t dim = index.dim;
  const size_t width = index.sketch_dim();
  std::vector<float> sketch(index.k * width);
  for (size_t c = 0; c < index.k; ++c) {
    const double* from = rotated.data() + c * dim;
    float* to = sketch.data() + c * width;
    for (size_t j = 0; j < index.lead; ++j) to[j] = static_cast<float>(from[j]);
    if (!index.has_tail) continue;
    double tail = 0;
    for (size_t j = index.lead; j < dim; ++j) tail += from[j] * from[j];
    to[index.lead] = static_cast<float>(std::sqrt(tail));
  }
  // A codeword that is not a number is infinitely far from everything, and must not upset sorting.
  for (float& v : sketch) v = std::isnan(v) ? std::numeric_limits<float>::infinity() : v;
  return sketch;
}

// Orders slots [begin, end), begin a multiple of kFan, so that leaves hold neighbours. Splits keep
// a power of two of leaves on the left: then kFan consecutive nodes are a subtree on every level.
void order_leaves(const std::vector<float>& sketch, size_t width, size_t split_dims, size_t begin,
                  size_t end, std::vector<uint32_t>& order) {
  const size_t leaves = (end - begin + kFan - 1) / kFan;
  if (leaves <= 1) return;
  size_t left = 1;
  while (left * 2 < leaves) left *= 2;

  size_t axis = 0;
  double widest = -1;
  for (size_t j = 0; j < split_dims; ++j) {
    double sum = 0, squares = 0;
    for (size_t s = begin; s < end; ++s) {
      const double v = static_cast<double>(sketch[order[s] * width + j]);
      sum += v;
      squares += v * v;
    }
    const double variance = squares - sum * sum / static_cast<double>(end - begin);
    if (variance > widest) {
      widest = variance;
      axis = j;
    }
  }
  const size_t middle = begin + left * kFan;
  const auto before = [&](uint32_t a, uint32_t b) {
    const float va = sketch[a * width + axis], vb = sketch[b * width + axis];
    return va != vb ? va < vb : a < b;
  };
  std::nth_element(order.begin() + static_cast<std::ptrdiff_t>(begin),
                   order.begin() + static_cast<std::ptrdiff_t>(middle),
                   order.begin() + static_cast<std::ptrdiff_t>(end), before);
  order_leaves(sketch, width, split_dims, begin, middle, order);
  order_leaves(sketch, width, split_dims, middle, end, order);
}

// The [box_dim, 2, kFan] group and lane of node `i` on a level.
float* box_of(float* level, size_t box_dim, size_t i) {
  return level + (i / kFan) * box_dim * 2 * kFan + i % kFan;
}

void build_boxes(NearestIndex& index) {
  const size_t width = index.sketch_dim();
  size_t nodes = index.num_leaves();
  for (size_t level = 0;; ++level) {
    const size_t groups = (nodes + kFan - 1) / kFan;
    index.boxes.push_back(make_floats(groups * index.box_dim * 2 * kFan, 0.0f));
    index.level_size.push_back(nodes);
    float* out = index.boxes.back().get();
    for (size_t i = 0; i < nodes; ++i) {
      for (size_t j = 0; j < index.box_dim; ++j) {
        float low = std::numeric_limits<float>::infinity(), high = -low;
        if (level == 0) {
          const float* values = index.leaves.get() + (i * width + j) * kFan;
          for (size_t c = 0; c < kFan; ++c) {
            low = std::min(low, values[c]);
            high = std::max(high, values[c]);
          }
        } else {
          const size_t below = index.level_size[level - 1];
          for (size_t c = i * kFan; c < std::min(below, (i + 1) * kFan); ++c) {
            const float* child = box_of(index.boxes[level - 1].get(), index.box_dim, c);
            low = std::min(low, child[j * 2 * kFan]);
            high = std::max(high, child[(j * 2 + 1) * kFan]);
          }
        }
        float* box = box_of(out, index.box_dim, i) + j * 2 * kFan;
        box[0] = low;
        box[kFan] = high;
      }
    }
    if (nodes <= kFan) return;
    nodes = groups;
  }
}

}  // namespace

NearestIndex::NearestIndex(const float* entries, size_t num_codewords, size_t dimensions,
                           bool rotate)
    : codebook(entries), k(num_codewords), dim(dimensions) {
  if (!plain() && rotate) axes = find_principal_axes(codebook, k, dim);
  const std::vector<double> coordinates = rotate_codebook(*this);
  choose_lead(*this, coordinates);
  const size_t width = sketch_dim();
  const std::vector<float> sketch = make_sketches(*this, coordinates);

  // Every rotated coordinate is a sum of dim products, off by dim roundings of the vector's length
  // at most. Twice that over all coordinates, to hold the rounding of axes, codewords and lengths
  // too.
  constexpr double kUnitRoundoff = 0x1p-24;
  if (!plain()) {
    error_scale = static_cast<float>(2 * static_cast<double>(dim + 4) *
                                     std::sqrt(static_cast<double>(dim)) * kUnitRoundoff);
  }

  order.resize(num_leaves() * kFan);
  std::iota(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(k), 0u);
  order_leaves(sketch, width, box_dim, 0, k, order);
  std::fill(order.begin() + static_cast<std::ptrdiff_t>(k), order.end(), order[k - 1]);

  leaves = make_floats(num_leaves() * width * kFan, 0.0f);
  for (size_t s = 0; s < order.size(); ++s) {
    for (size_t j = 0; j < width; ++j) {
      leaves[(s / kFan * width + j) * kFan + s % kFan] = sketch[order[s] * width + j];
    }
  }
  if (!plain()) {
    rows.resize(order.size() * dim);
    for (size_t s = 0; s < order.size(); ++s) {
      std::copy_n(entries + order[s] * dim, dim, rows.data() + s * dim);
    }
  }
  build_boxes(*this);
}

}  // namespace l4d
